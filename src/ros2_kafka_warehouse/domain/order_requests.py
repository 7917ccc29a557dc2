"""What customers may ask for: orders, and changes of orders that were taken."""

from datetime import UTC
from typing import Final

from msgspec.structs import replace

from ros2_kafka_warehouse.domain.site import Site
from ros2_kafka_warehouse.messages.orders import (
    Line,
    LineStatus,
    Order,
    OrderEvent,
    OrderLine,
    OrderRequest,
    OrderStatus,
)

_MOST_LINES: Final = 100
_PRIORITIES: Final = range(10)
_UPDATES: Final = range(2**32)  # uint32 in VDA 5050
_QUANTITIES: Final = range(1, 10_001)
_ID_LENGTH: Final = 200
_REASON_LENGTH: Final = 500


def answer(
    request: OrderRequest, status: OrderStatus, now_s: float, reason: str = ''
) -> OrderEvent:
    """What is said of a request."""
    return OrderEvent(
        shortened(request.order_id),
        request.order_update_id,
        status,
        now_s,
        reason=shortened(reason, _REASON_LENGTH),
    )


def shortened(text: str, length: int = _ID_LENGTH) -> str:
    """A text of a customer as it is repeated to everybody who looks on."""
    return text if len(text) <= length else f'{text[: length - 1]}…'


def unusable(request: OrderRequest) -> str:
    """Why a request does not even name an order, or ''."""
    if not 0 < len(request.order_id) <= _ID_LENGTH:
        return f'VALIDATION_FAILURE: orderId must have 1 to {_ID_LENGTH} characters'
    if request.order_update_id not in _UPDATES:
        return f'VALIDATION_FAILURE: orderUpdateId goes from 0 to {_UPDATES[-1]}'
    return ''


def wrong(request: OrderRequest, site: Site) -> str:
    """What is wrong with an order, or ''."""
    if request.station not in site.stations:
        known = ', '.join(site.stations)
        return f'no station is called {request.station!r}; there are {known}'
    if not 0 < len(request.lines) <= _MOST_LINES:
        return f'an order needs at least one line, and has at most {_MOST_LINES}'
    if request.priority not in _PRIORITIES:
        return f'priority is {request.priority}; it goes from 0 to 9'
    line_ids = [line.line_id for line in request.lines]
    if len(set(line_ids)) < len(line_ids):
        return 'two lines have the same lineId'
    return next((bad for line in request.lines if (bad := _wrong_line(line, site))), '')


def _wrong_line(line: Line, site: Site) -> str:
    if not 0 < len(line.line_id) <= _ID_LENGTH or '/' in line.line_id:
        return f"lineId must have 1 to {_ID_LENGTH} characters and no '/'"
    if line.product not in site.products:
        return f'line {line.line_id}: no product is called {line.product!r}'
    if line.quantity not in _QUANTITIES:
        return f'line {line.line_id}: quantity must be from 1 to {_QUANTITIES[-1]}'
    return ''


def new_order(request: OrderRequest, now_s: float) -> Order:
    """The order that a request asks for."""
    due = request.due_time
    if due is not None and due.tzinfo is None:
        due = due.replace(tzinfo=UTC)
    return Order(
        order_id=request.order_id,
        order_update_id=request.order_update_id,
        station=request.station,
        lines=tuple(
            OrderLine(line.line_id, line.product, line.quantity) for line in request.lines
        ),
        released_s=now_s,
        priority=request.priority,
        due_s=None if due is None else due.timestamp(),
    )


def too_late(order: Order, request: OrderRequest, *, is_picking: bool) -> str:
    """Why an order can no longer be changed so, or ''.

    It must follow from what was asked and said alone, or a desk that remembers would answer
    otherwise than before.

    Args:
        order: As it stands.
        request: The change.
        is_picking: It was said before that a robot picks one of its lines.
    """
    is_picked = is_picking or any(line.status is LineStatus.DELIVERED for line in order.lines)
    if is_picked and request.station != order.station:
        return f'the station is still {order.station!r}: loads are on their way there'
    withdrawn = {line.line_id for line in order.lines if line.withdrawn}
    again = next((line.line_id for line in request.lines if line.line_id in withdrawn), None)
    if again is not None:
        return f'line {again} was withdrawn by an earlier update: give it another lineId'
    return ''


def changed(order: Order, wanted: Order) -> Order:
    """The order with a later update: lines that have ended stay, others are as wanted now.

    A line that is no longer wanted is withdrawn; if its load is on its way already, it comes.
    """
    new = {line.line_id: line for line in wanted.lines}
    lines = [
        line if line.status is not LineStatus.OPEN else _changed_line(line, new.get(line.line_id))
        for line in order.lines
    ]
    known = {line.line_id for line in order.lines}
    lines += [line for line in wanted.lines if line.line_id not in known]
    return replace(wanted, lines=tuple(lines), released_s=order.released_s, status=order.status)


def _changed_line(line: OrderLine, wanted: OrderLine | None) -> OrderLine:
    if wanted is None:
        return replace(line, withdrawn=True)
    return replace(line, product=wanted.product, quantity=wanted.quantity, withdrawn=False)
