"""Numbered orders as bytes, good ones and hostile ones, and how a number is found again."""

import itertools
import re
import struct
from collections.abc import Callable, Iterator, Sequence
from typing import Final, NamedTuple

from benchmarks.faults.streams import LARGEST_BYTES
from ros2_kafka_bridge.testing.orders import encode, orders

NUMBER_HEADER: Final = 'order'
_NUMBER: Final = re.compile(rb'\{"order_id":(\d+)[,}]')
_KINDS: Final = 500  # different orders; the number is put in front
_MANY_HEADERS: Final = 3000
_HUGE_KEY_BYTES: Final = 100_000
_DEEP: Final = 20_000


class Hostile(NamedTuple):
    """A record that is no good order, or comes with what nobody expects.

    Args:
        make: Number -> value; None is a tombstone.
        key: Its key in Kafka.
        headers: So many headers more, in Kafka.
        refused: Whether it can never be delivered as text: a dead letter, then.
        is_ros: Whether a ROS publisher can send it, too.
    """

    name: str
    make: Callable[[int], bytes | None]
    key: bytes | None = None
    headers: int = 0
    refused: bool = True
    is_ros: bool = True


def numbered(seed: int) -> Callable[[int], bytes]:
    """Make the function from a number to an order with that number."""
    tails = [encode(order).partition(b',')[2] for order in itertools.islice(orders(seed), _KINDS)]
    return lambda number: b'{"order_id":%d,%s' % (number, tails[number % _KINDS])


def number_of(value: bytes) -> int | None:
    """The number in a value; None where it is none of ours."""
    found = _NUMBER.match(value)
    return int(found[1]) if found else None


def _with(tail: bytes) -> Callable[[int], bytes]:
    return lambda number: b'{"order_id":%d,%s' % (number, tail)


HOSTILE: Final[Sequence[Hostile]] = (
    Hostile('not UTF-8', _with(b'"poison":"\xff\xfe\xc3"}')),
    Hostile('NUL', _with(b'"poison":"\0"}')),
    Hostile('oversize', _with(b'"large":"' + b'x' * LARGEST_BYTES + b'"}')),
    Hostile('deep JSON', _with(b'"deep":' + b'[' * _DEEP + b']' * _DEEP + b'}'), refused=False),
    Hostile('tombstone', lambda _: None, is_ros=False),
    Hostile(
        'many headers', _with(b'"a":1}'), headers=_MANY_HEADERS, refused=False, is_ros=False
    ),
    Hostile(
        'huge key', _with(b'"a":1}'), key=b'k\0' * (_HUGE_KEY_BYTES // 2), refused=False,
        is_ros=False,
    ),
)  # fmt: skip


def to_cdr(text: bytes) -> bytes:
    """The bytes of a std_msgs/String, whatever the text is."""
    return struct.pack('<4sI', b'\0\1\0\0', len(text) + 1) + text + b'\0'


def from_cdr(message: bytes) -> bytes:
    """The text of a std_msgs/String, with what may stand behind it."""
    return message[8:]


def in_turn(kinds: Sequence[Hostile]) -> Iterator[Hostile]:
    """Each hostile kind in turn, without end."""
    return itertools.cycle(kinds)
