"""A floor with its rules, and what a referee finds in frames of it."""

from typing import Any

from ros2_kafka_warehouse.domain.referee import Referee
from ros2_kafka_warehouse.domain.rules import Frame, Job, Limits, Rules, Seen
from ros2_kafka_warehouse.messages.message import Cell

ROWS = (
    '......',
    '.@@.@.',
    '......',
    '.@.@@.',
    '......',
)
TYPES = {
    'carrier': Limits(1, 30, frozenset({'small'})),
    'hauler': Limits(2, 120, frozenset({'small', 'large'})),
}
HOMES = {'a': (0, 0), 'b': (5, 0), 'c': (0, 4), 'h': (5, 4)}
RULES = Rules(ROWS, TYPES, HOMES)
FREE = [(x, y) for y, row in enumerate(ROWS) for x, mark in enumerate(row) if mark != '@']


def robot(name: str, *cells: Cell, **more: Any) -> Seen:
    kind = 'hauler' if name.startswith('h') else 'carrier'
    return Seen(name, cells, type=kind)._replace(**more)


def judged(*frames: tuple[Seen, ...], jobs: tuple[Job, ...] = (), **more: Any) -> list[str]:
    """The rules that are broken by frames, a step each."""
    referee = Referee(RULES)
    for job in jobs:
        referee.loads.know(job)
    found: list[str] = []
    for step, robots in enumerate(frames):
        frame = Frame(step, float(step), robots)._replace(**more)
        found += [violation.rule for violation in referee.check(frame)]
    return found


TEA = Job('1/tea', frozenset({(0, 2)}), (5, 2), released_s=1.0, weight_kg=5, size='small')


AT_STOCK = robot('a', (0, 2))
WITH_TEA = robot('a', (0, 2), loads=('1/tea',))
