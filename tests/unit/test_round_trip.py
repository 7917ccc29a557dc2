"""examples/round_trip.py, the check that the README shows: what comes twice hides nothing."""

import importlib.util
from pathlib import Path
from typing import Any, NamedTuple

from ros2_kafka_bridge.testing.orders import encode, orders

EXAMPLE = Path(__file__).parents[2] / 'examples' / 'round_trip.py'


class Record(NamedTuple):
    """What a consumer gives."""

    content: bytes

    def value(self) -> bytes:
        return self.content

    def error(self) -> None:
        return None


class Returned:
    """A consumer of records that come one at a time.

    Args:
        values: Theirs.
    """

    def __init__(self, values: list[bytes]) -> None:
        self._ahead = iter(values)

    def consume(self, _count: int, _timeout_s: float) -> list[Record]:
        return [Record(value) for value in [next(self._ahead, None)] if value is not None]


def example() -> Any:
    spec = importlib.util.spec_from_file_location('round_trip', EXAMPLE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_what_comes_behind_repeats_is_not_taken_for_lost() -> None:
    sent = [encode(order) for order, _ in zip(orders(seed=1), range(10), strict=False)]
    returned = [*sent[:5], *sent[:5], *sent[5:]]
    assert example().receive(Returned(returned), sent, 60.0) == returned
