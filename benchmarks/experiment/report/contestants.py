"""Who was measured: how each is called, what it is, and how it is drawn."""

from typing import Final, Literal, NamedTuple


class Contestant(NamedTuple):
    """How one appears in the report.

    Args:
        colour: Told apart by colour-blind readers (the palette of Okabe and Ito).
        line: Style of its lines, by matplotlib's names.
    """

    title: str
    what: str
    colour: str
    line: Literal['-', '--', '-.', ':']
    marker: str


CONTESTANTS: Final = {
    'paper': Contestant(
        "the paper's bridge",
        'Algorithms 1 and 2 as they are printed, two processes, RELIABLE and KEEP_LAST with the '
        'depth given at both ends.',
        '#d55e00',
        '-',
        'o',
    ),
    'bridge': Contestant(
        'ours',
        'ros2-kafka-bridge with its default settings: RELIABLE and KEEP_ALL, confirmed offsets, '
        'idempotent production. It has no depth to choose.',
        '#0072b2',
        '-',
        's',
    ),
    'keep_last': Contestant(
        'ours, KEEP_LAST',
        'ros2-kafka-bridge, told to use KEEP_LAST with the depth given at both ends: what is left '
        'of it when its readers overwrite their own queue.',
        '#009e73',
        '--',
        '^',
    ),
    'bare': Contestant(
        'bare loops',
        "A loop around the same two clients in each direction, without a bridge's guarantees: "
        'the yardstick for latency.',
        '#595959',
        ':',
        'D',
    ),
    'recording': Contestant(
        'recording',
        "The paper's nodes with a queue that loses nothing. From its backlog the loss of each "
        'depth is predicted.',
        '#cc79a7',
        '-.',
        'v',
    ),
}
ORDER: Final = tuple(CONTESTANTS)


def contestant(name: str) -> Contestant:
    """Find a contestant; one that is not known is drawn in grey under its own name."""
    return CONTESTANTS.get(name) or Contestant(name, '', '#8a8a8a', '-', 'x')


def place(name: str) -> int:
    """Where it stands in tables and legends; those that are not known come last."""
    return ORDER.index(name) if name in ORDER else len(ORDER)


def title(name: str, depth: int | None) -> str:
    """As the report calls it: `the paper's bridge, depth 10`."""
    words = contestant(name).title
    return words if depth is None else f'{words}, depth {depth}'
