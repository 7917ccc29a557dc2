"""What a browser may ask for: bodies of requests, checked, as messages of the warehouse."""

from datetime import UTC, datetime, timedelta
from typing import Annotated, Any, Final, TypeVar

import msgspec

from ros2_kafka_warehouse.domain.site import WALL, Site
from ros2_kafka_warehouse.messages.message import Cell
from ros2_kafka_warehouse.messages.monitor import OperatorCommand
from ros2_kafka_warehouse.messages.orders import Line, OrderRequest

_OF_A_ROBOT: Final = frozenset({'failRobot', 'repairRobot', 'removeRobot', 'rejoinRobot'})
_OF_A_CELL: Final = frozenset({'blockCell', 'unblockCell'})
_OF_ALL: Final = frozenset({'pause', 'resume', 'acknowledge'})
COMMANDS: Final = _OF_A_ROBOT | _OF_A_CELL | _OF_ALL

_Name = Annotated[str, msgspec.Meta(min_length=1, max_length=80)]


class BadForm(ValueError):  # noqa: N818 (the user's mistake, not the program's)
    """A body that is not what it should be; says which field and what would be right."""


class _Form(msgspec.Struct, rename='camel', forbid_unknown_fields=True):
    pass


class _Line(_Form):
    product: _Name
    quantity: Annotated[int, msgspec.Meta(ge=1, le=1000)] = 1


class _Order(_Form):
    station: _Name
    lines: Annotated[list[_Line], msgspec.Meta(min_length=1, max_length=20)]
    priority: Annotated[int, msgspec.Meta(ge=0, le=9)] = 0
    due_in_s: Annotated[float, msgspec.Meta(gt=0, le=86_400)] | None = None


class _Command(_Form):
    command: _Name
    robot: Annotated[str, msgspec.Meta(max_length=80)] = ''
    failure: Annotated[str, msgspec.Meta(max_length=80)] = ''
    cell: Cell | None = None
    known: bool = False


class _Rate(_Form):
    per_minute: Annotated[float, msgspec.Meta(ge=0, le=600)]


F = TypeVar('F', bound=_Form)


def read_order(body: bytes, site: Site, order_id: str, now_s: float) -> OrderRequest:
    """The order that a form asks for.

    Raises:
        BadForm: It cannot be an order of this site.
    """
    form = _read(body, _Order)
    _must_be_one_of('station', form.station, site.stations)
    for number, line in enumerate(form.lines):
        _must_be_one_of(f'lines[{number}].product', line.product, site.products)
    due = None
    if form.due_in_s is not None:
        due = datetime.fromtimestamp(now_s, UTC) + timedelta(seconds=form.due_in_s)
    return OrderRequest(
        order_id=order_id,
        station=form.station,
        lines=tuple(
            Line(f'L{number}', line.product, line.quantity)
            for number, line in enumerate(form.lines, 1)
        ),
        priority=form.priority,
        due_time=due,
    )


def read_command(
    body: bytes, site: Site, robots: frozenset[str], failures: frozenset[str], command_id: str
) -> OperatorCommand:
    """The command that a form asks for.

    Only the robots and the codes of failures that are given may be named.

    Raises:
        BadForm: It is none, or of a robot, a failure or a cell that is not there.
    """
    form = _read(body, _Command)
    _must_be_one_of('command', form.command, COMMANDS)
    if form.command in _OF_A_ROBOT:
        _must_be_one_of('robot', form.robot, robots)
    if form.command == 'failRobot':
        _must_be_one_of('failure', form.failure, failures)
    if form.command in _OF_A_CELL:
        _must_be_free(form.cell, site)
    return OperatorCommand(
        command_id=command_id,
        command=form.command,
        robot=form.robot if form.command in _OF_A_ROBOT else '',
        failure=form.failure if form.command == 'failRobot' else '',
        cell=form.cell if form.command in _OF_A_CELL else None,
        known=form.known and form.command == 'blockCell',
    )


def read_rate(body: bytes) -> float:
    """Random orders a minute.

    Raises:
        BadForm: It is no number from 0 to 600.
    """
    return _read(body, _Rate).per_minute


def _read(body: bytes, kind: type[F]) -> F:
    try:
        return msgspec.json.decode(body, type=kind)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise BadForm(str(error)) from error


def _must_be_one_of(field: str, value: str, known: Any) -> None:
    if value not in known:
        names = ', '.join(sorted(known)[:12]) + (', ...' if len(known) > 12 else '')
        raise BadForm(f'{field}: there is no {value!r}; there are {names}')


def _must_be_free(cell: Cell | None, site: Site) -> None:
    if cell is None:
        raise BadForm('cell: [column, row] is missing')
    column, row = cell
    if not site.is_on_map(cell):
        raise BadForm(f'cell: {column},{row} is not on the map')
    if site.rows[row][column] == WALL:
        raise BadForm(f'cell: {column},{row} is a wall or a shelf')
