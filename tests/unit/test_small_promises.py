"""Small things that were learned the hard way."""

from contextlib import ExitStack
from typing import Any

import pytest
from confluent_kafka import Message

from ros2_kafka_bridge.dedup import place_of
from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.kafka.properties import refusal
from ros2_kafka_bridge.wiring import _open

GID = bytes(range(16))


def place(gid: bytes, seq: bytes) -> tuple[bytes, int] | None:
    return place_of(Message(headers=[('ros.gid', gid), ('ros.seq', seq)]))


def test_a_record_tells_publisher_and_number() -> None:
    assert place(GID.hex().encode(), b'42') == (GID, 42)


@pytest.mark.parametrize(
    ('gid', 'seq'), [(b'\xff\x00', b'1'), (b'xyz', b'1'), (GID.hex().encode(), b'one')]
)
def test_headers_that_others_wrote_say_nothing(gid: bytes, seq: bytes) -> None:
    assert place(gid, seq) is None


def test_an_end_that_fails_to_open_is_closed() -> None:
    class End:
        closed = False

        def open(self) -> None:
            raise RouteError('refused')

        def close(self) -> None:
            self.closed = True

    end: Any = End()
    with pytest.raises(RouteError), ExitStack() as stack:
        stack.enter_context(_open(end))
    assert end.closed


@pytest.mark.parametrize('name', ['group.instance.id', 'partition.assignment.strategy'])
def test_what_the_bridge_must_set_itself_is_refused(name: str) -> None:
    assert refusal(name) is not None
