"""How much of what anybody has put into Kafka is kept and shown."""

from collections import OrderedDict
from collections.abc import Iterable, Iterator
from typing import Any

import msgspec

from ros2_kafka_warehouse.domain.order_requests import shortened
from ros2_kafka_warehouse.messages.orders import Line, OrderEvent, OrderRequest

SHOWN_LINES = 100
_SHOWN_SENTENCE = 500
_SHOWN_NUMBER = 10**9


def short_request(request: OrderRequest) -> OrderRequest:
    """A request with texts and numbers no longer than the desk takes them."""
    lines = (
        Line(shortened(line.line_id), shortened(line.product), _small(line.quantity))
        for line in request.lines[:SHOWN_LINES]
    )
    return msgspec.structs.replace(
        request,
        order_id=shortened(request.order_id),
        station=shortened(request.station),
        lines=tuple(lines),
        priority=_small(request.priority),
    )


def _small(number: int) -> int:
    return max(-_SHOWN_NUMBER, min(number, _SHOWN_NUMBER))


def short_event(event: OrderEvent) -> OrderEvent:
    """An event with texts no longer than the desk writes them."""
    return msgspec.structs.replace(
        event,
        order_id=shortened(event.order_id),
        line_id=shortened(event.line_id),
        reason=shortened(event.reason, _SHOWN_SENTENCE),
        robot=shortened(event.robot),
    )


def within(most_bytes: int, rows: Iterable[msgspec.Raw]) -> Iterator[msgspec.Raw]:
    """The first rows, as many as fit."""
    for row in rows:
        most_bytes -= len(memoryview(row))
        if most_bytes < 0:
            return
        yield row


def keep(kept: OrderedDict[Any, Any], key: Any, value: Any, most: int) -> None:
    """Keep a value as the newest; the oldest go."""
    kept[key] = value
    kept.move_to_end(key)
    while len(kept) > most:
        kept.popitem(last=False)
