"""What can happen to a bridge with a spool, for worlds of the way over the disk."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from support.worlds import flights
from support.worlds.pipeline_with_spool import (
    GID,
    House,
    come_back,
    fill,
    go_away,
    made_ns,
    make_room,
)

from ros2_kafka_bridge.endpoints import Message, Outgoing
from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.threads.stop import Stop

BATCH = 5
LONGEST_BYTES = 200
SMALL, LARGE = 6_000, 1_000_000  # what is in flight alone does not fill a small spool


Event = tuple[str, int]
KINDS = ('good', 'bad', 'long', 'too large')


def numbers(records: Iterable[Outgoing]) -> list[int]:
    """The numbers of the messages that records, or dead letters, were made of."""
    return [int(dict(record.headers)['ros.seq'] or 0) for record in records]


def is_full(house: House) -> bool:
    return 'append' in house.spool.__dict__


def does(house: House, what: str, how: int) -> None:
    """Let something happen to the ends of a house."""
    match what:
        case 'steps':
            house.steps(how)
        case 'away':
            go_away(house)
        case 'back':
            come_back(house)
        case 'deaf':
            house.sink.answering = False
        case 'refuse':
            house.sink.refusals = how
        case 'late':
            house.sink.delivered_at_close = how
        case 'full':
            fill(house)
        case 'not full':
            make_room(house)
            house.steps(1)  # it is seen at the next try
        case 'letters stand' | 'letters fail' | 'letters go':
            house.letters.answering = what != 'letters stand'
            house.letters.forbidden = what == 'letters fail'
        case _:
            assert what == 'fail'
            house.fail_and_run_again()


def stop(house: House) -> str:
    """Stop as a bridge does that has no time; returns what it says it has given up."""
    asked, told = Stop(), ''
    asked.ask()
    try:
        house.pipeline._drain(asked)
    except RouteError as error:
        told = str(error)
    house.check_balance()
    house._opened.__exit__(None, None, None)
    return told


class Given:
    """What one publisher has published; it never repeats itself."""

    def __init__(self) -> None:
        self.number = 0
        self.of: dict[str, set[int]] = {kind: set() for kind in KINDS}

    def give(self, house: House, kind: str, count: int) -> None:
        for _ in range(count):
            self.number += 1
            self.of[kind].add(self.number)
            padding = b'-' * (LONGEST_BYTES if kind == 'long' else 0)
            cdr = b'%s %d %s' % (kind.encode(), self.number, padding)
            message = Message(cdr, GID, self.number, made_ns(self.number))
            house.source.waiting.append(message)

    @property
    def all(self) -> set[int]:
        return set(range(1, self.number + 1))


@contextmanager
def small_and_quick() -> Iterator[Path]:
    with TemporaryDirectory() as place, pytest.MonkeyPatch.context() as patch:
        flights.check_steps(patch)
        patch.setattr('ros2_kafka_bridge.spool.backlog._AGAIN_S', 0.0)
        patch.setattr('ros2_kafka_bridge.threads.backoff._FIRST_S', 0.0)
        patch.setattr('ros2_kafka_bridge.ros_to_kafka.BATCH', BATCH)
        patch.setattr('ros2_kafka_bridge.spool.spooling.BATCH', BATCH)
        yield Path(place)
