"""Spools as earlier versions of the bridge have left them: files, and what they hold.

`tests/unit/spool/golden` has a folder for each version of the format. Those of version 1 were made
by the code that was the first to have a spool (commit fce99a9): 20 rows, of which the first four
were deleted, in a spool that was closed in order; ten more behind them, which are in the log
alone, in one whose process was killed. Up to commit e66f716 each route gave the numbers, and began
at 1 again where none was left: one held 30 rows before those twenty.
"""

import shutil
from pathlib import Path
from typing import Final

from ros2_kafka_bridge.endpoints import Outgoing
from ros2_kafka_bridge.spool.rows import Row

GOLDEN: Final = Path(__file__).parent / 'unit' / 'spool' / 'golden'
STATES: Final = {
    'closed': range(5, 21), 'killed': range(5, 31), 'counted_anew': range(5, 21),
}  # fmt: skip
VERSIONS: Final = tuple(int(folder.name) for folder in sorted(GOLDEN.iterdir()))

_BEFORE: Final = {'counted_anew': 30}  # rows of which nothing is left
_NAME: Final = 'bridge.route.spool'
_WITHOUT_VALUE: Final = 7
_LETTER: Final = 9


def put(version: int, state: str, file: Path) -> None:
    """Lay a copy there, with all that lay beside it."""
    file.parent.mkdir(exist_ok=True)
    for source in (GOLDEN / str(version) / state).iterdir():
        shutil.copy(source, file.with_name(source.name.replace(_NAME, file.name)))


def held(state: str) -> list[Row]:
    """What it holds."""
    before = _BEFORE.get(state, 0)
    return [_row(number)._replace(number=before + number) for number in STATES[state]]


def _row(number: int) -> Row:
    headers: list[tuple[str, str | bytes | None]] = [
        ('ros.topic', b'/orders'),
        ('ros.seq', b'%d' % number),
        ('text', 'ünï'),
        ('none', None),
    ]
    is_letter = number == _LETTER
    record = Outgoing(
        'orders.dead-letters' if is_letter else 'orders',
        None if number % 5 == 0 else b'/orders',
        None if number == _WITHOUT_VALUE else b'order %d' % number,
        headers,
    )
    taken_ns = 1_700_000_000_000_000_000 + number
    return Row(number, taken_ns, is_letter, bytes(range(16)), number, record)
