"""The fault bench in a short form: real processes die, and a checker finds every order.

The whole of it, with every fault: `make faults`.
"""

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from support.processes.terminal import finished

ROOT = Path(__file__).parents[2]
SEED = 3
FAULTS = ('hostile', 'publisher_kill', 'bridge_kill', 'broker_kill')
STREAMS = ('to_ros', 'latched', 'volatile', 'spooled_always')


def test_no_order_is_lost_that_the_guarantees_cover_while_things_break(
    ros_domain: int, tmp_path: Path
) -> None:
    status, said = _run(ros_domain, tmp_path)
    assert status == 0, said
    found = json.loads((tmp_path / f'seed-{SEED}' / 'faults.json').read_text())
    assert {step['fault'] for step in found['plan']} == set(FAULTS)
    assert [window['fault'] for window in found['windows']] == [
        step['fault'] for step in found['plan']
    ]
    rows = {(row['stream'], row['fault']): row for row in found['rows']}
    for stream in STREAMS:
        for fault in FAULTS:
            assert rows[stream, fault]['sent'] > 0
            assert rows[stream, fault]['wrong'] == []
    assert [row['lost'] for row in found['rows'] if row['stream'] in {'to_ros', 'latched'}] == (
        [0] * (len(FAULTS) + 1) * 2
    )
    assert 'longest stall' in said
    assert f'--seed {SEED}' in said, 'how to run it again'


@pytest.mark.parametrize('stream', ['to_ros', 'latched'])
def test_a_run_of_one_stream_needs_nothing_of_the_others(
    stream: str, ros_domain: int, tmp_path: Path
) -> None:
    status, said = _run(ros_domain, tmp_path, '--standby', streams=[stream], faults=['hostile'])
    assert status == 0, said
    found = json.loads((tmp_path / f'seed-{SEED}' / 'faults.json').read_text())
    assert {row['stream'] for row in found['rows']} == {stream}
    assert [window['fault'] for window in found['windows']] == ['hostile']


def _run(
    ros_domain: int,
    place: Path,
    *more: str,
    streams: Sequence[str] = STREAMS,
    faults: Sequence[str] = FAULTS,
) -> tuple[int, str]:
    options: dict[str, Any] = {
        '--minutes': 0.1,
        '--seed': SEED,
        '--rate': 40,
        '--brokers': 1,
        '--hosts': 'no',
        '--faults': ','.join(faults),
        '--streams': ','.join(streams),
        '--domain': ros_domain,
        '--out': place,
    }
    words = [*more, *(str(word) for option in options.items() for word in option)]
    done = finished([sys.executable, '-m', 'benchmarks.faults', *words], cwd=ROOT, timeout_s=400)
    return done.returncode, done.stdout + done.stderr
