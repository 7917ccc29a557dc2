"""What the modules say of tasks, lines and loads, against what was ordered and what was seen.

Nothing is judged before all who take part may have heard of it: what is said of a task has to
stand for some steps.
"""

from collections.abc import Callable, Iterable
from typing import Final, NamedTuple

from ros2_kafka_warehouse.domain.referee_loads import Loads
from ros2_kafka_warehouse.domain.site import Site
from ros2_kafka_warehouse.messages.onlookers import Violation
from ros2_kafka_warehouse.messages.orders import LineStatus, OpenOrders, Order
from ros2_kafka_warehouse.messages.robots import Load
from ros2_kafka_warehouse.messages.tasks import TASK_ENDS, Task, TaskStatus

# In steps that were checked.
GRACE: Final = 10  # for a delivery to be seen that is said to have happened
QUIET: Final = 20  # after the last news of a task, before it is compared with its order
FORMER: Final = 60  # in which an order counts as it was before an update, too
_WAITING: Final = (TaskStatus.OPEN, TaskStatus.ASSIGNED, TaskStatus.BLOCKED)
_GIVEN_UP: Final = (TaskStatus.FAILED, TaskStatus.CANCELLED)
_GRAM: Final = 0.001
_LINES_GIVEN_UP: Final = (LineStatus.FAILED, LineStatus.CANCELLED)


class _Form(NamedTuple):
    """An order as an update has asked for it, and how many steps were checked by then."""

    heard: int
    order: Order


class _Ordered:
    """An order in all its forms, and since when it is no longer open."""

    __slots__ = ('forms', 'gone', 'order')

    def __init__(self, order: Order, heard: int) -> None:
        self.forms = [_Form(heard, order)]
        self.order = order
        self.gone: int | None = None

    def take(self, order: Order, heard: int) -> None:
        """Take it as it stands now."""
        # Between updates its lines become what was picked: nobody has asked for that.
        if order.order_update_id != self.order.order_update_id:
            self.forms.append(_Form(heard, order))
        self.order = order
        self.gone = None

    def since(self, heard: int) -> list[Order]:
        """The forms that were the newest at a time, or later."""
        older = sum(form.heard <= heard for form in self.forms)
        return [form.order for form in self.forms[max(older - 1, 0) :]]

    @property
    def released_s(self) -> float:
        """The earliest time at which it is said to have come."""
        return min(form.order.released_s for form in self.forms)


class _Told:
    """What was said of a task.

    Attributes:
        task: As it was said last.
        waited: When it was last said to wait in stock, untouched by any robot; None: it was on
            its way, or over, when it was first heard of.
        is_touched: A robot has had the load, or may have had it.
        given_up: It was said to have failed, or to be cancelled.
        line: How its line is said to have ended.
        accused: The rules that it is known to break.
        is_left: Nothing is said of it any more.
    """

    __slots__ = ('accused', 'given_up', 'is_left', 'is_touched', 'line', 'task', 'waited')

    def __init__(self, task: Task, heard: int) -> None:
        self.task = task
        self.is_touched = _is_touched(task)
        self.waited = heard if _waits(task) else None
        self.given_up = task.status in _GIVEN_UP
        self.line = LineStatus.OPEN
        self.accused: set[str] = set()
        self.is_left = False

    def take(self, task: Task, heard: int, heard_before: int) -> None:
        """Take it as it is said now; what was said before was still so at `heard_before`."""
        if self.waited is not None and not self.is_touched:
            if _waits(self.task):
                self.waited = heard_before
            if _waits(task):
                self.waited = heard
        self.is_touched = self.is_touched or _is_touched(task)
        self.given_up = self.given_up or task.status in _GIVEN_UP
        self.task = task
        self.is_left = False


def _is_touched(task: Task) -> bool:
    return task.carried or task.stranded or task.attempt > 0


def _waits(task: Task) -> bool:
    """Whether any robot may take the load from stock: nobody has it, no change is on its way."""
    return task.status in _WAITING and not _is_touched(task) and not task.excluded


class Claims:
    """What is said of tasks, lines and loads, and what of it was found to be wrong.

    Args:
        site: With its stations and products.
        loads: Which of them were seen to be delivered.
        say: Is told what is wrong.
    """

    def __init__(self, site: Site, loads: Loads, say: Callable[[Violation], None]) -> None:
        self.checked = 0
        self._site = site
        self._loads = loads
        self._say = say
        self._step = -1
        self._deliveries: dict[str, int] = {}  # by task: when one that is claimed has to be seen
        self._lines: set[str] | None = None
        self._ordered: dict[str, _Ordered] = {}
        self._told: dict[str, _Told] = {}
        self._told_at = 0
        self._shown: dict[str, tuple[str, Load]] = {}  # by load: who has it, and what it is
        self._doubts: dict[str, int] = {}  # by task: when it had news; the oldest come first

    # What is said.

    def expect(self, orders: OpenOrders) -> None:
        """Take the newest open orders: how each is wanted, which lines are said to have ended."""
        self._take_orders(orders)
        lines = {
            f'{order.order_id}/{line.line_id}'
            for order in orders.orders
            for line in order.lines
            if line.status is LineStatus.DELIVERED
        }
        if self._lines is None:
            for task_id in lines:
                self._loads.take_as_delivered(task_id)
        else:
            for task_id in lines - self._lines:
                # Orders do not say which step they reflect: the frame may be on its way.
                if self._loads.was_delivered(task_id) is False:
                    self._deliveries[task_id] = self.checked + GRACE
        self._lines = lines

    def _take_orders(self, orders: OpenOrders) -> None:
        known = self._ordered
        for order in orders.orders:
            ordered = known.get(order.order_id)
            if ordered is None:
                known[order.order_id] = _Ordered(order, self.checked)
            elif ordered.order is not order or ordered.gone is not None:
                self._note_lines(order, ordered.order)
                ordered.take(order, self.checked)
        if len(known) > len(orders.orders):
            for order_id in known.keys() - {order.order_id for order in orders.orders}:
                self._leave_order(order_id, known[order_id])

    def _leave_order(self, order_id: str, ordered: _Ordered) -> None:
        if ordered.gone is None:
            ordered.gone = self.checked
        elif self.checked - ordered.gone > FORMER + QUIET:
            del self._ordered[order_id]

    def _note_lines(self, order: Order, before: Order) -> None:
        if order.lines == before.lines:
            return
        open_before = {line.line_id for line in before.lines if line.status is LineStatus.OPEN}
        for line in order.lines:
            told = self._told.get(f'{order.order_id}/{line.line_id}')
            if told is not None and line.line_id in open_before:
                told.line = line.status
                self._doubt(told.task.task_id)

    def note(self, task: Task, before: Task | None, step: int) -> None:
        """Note what is said of a task that is new or has changed, in tasks of a step."""
        if before is not None:
            self._note_delivery(task, before)
        told = self._told.get(task.task_id)
        if told is None:
            self._told[task.task_id] = _Told(task, self.checked)
        else:
            ends_now = told.task.status not in TASK_ENDS and task.status in _GIVEN_UP
            told.take(task, self.checked, self._told_at)
            dropped = self._loads.dropped_step(task.task_id)
            # Whoever follows a robot up to that step has heard it say so.
            if ends_now and dropped is not None and dropped <= step:
                self._accuse(told, 'claimed', f'is said to be {task.status}, and was delivered')
        self._doubt(task.task_id)

    def _note_delivery(self, task: Task, before: Task) -> None:
        if task.status is not TaskStatus.DELIVERED:
            self._deliveries.pop(task.task_id, None)
        elif (
            before.status is not TaskStatus.DELIVERED
            # Once it was seen, it counts: a floor that starts again from an older state undoes it.
            and not self._loads.was_delivered(task.task_id)
        ):
            self._deliveries[task.task_id] = self.checked + GRACE

    def leave(self, task_id: str) -> None:
        """Note that nothing is said of a task any more."""
        if task_id in self._doubts:
            self._told[task_id].is_left = True
        else:
            self._forget(task_id)

    def told_all(self) -> None:
        """Note that all was said of the tasks that is to be said now."""
        self._told_at = self.checked

    def show(self, robot: str, loads: Iterable[Load]) -> None:
        """Note what a robot shows that it carries."""
        for load in loads:
            self._shown[load.load_id] = (robot, load)
            self._doubt(load.load_id)

    def _doubt(self, task_id: str) -> None:
        self._doubts.pop(task_id, None)  # to the end
        self._doubts[task_id] = self.checked

    # Against what is true.

    def judge(self, step: int) -> None:
        """Judge what has stood for long enough, after a step that was checked."""
        self._step = step
        self.checked += 1
        if self._deliveries:
            due = [task for task, due in self._deliveries.items() if due <= self.checked]
            self._judge_deliveries(due)
        if self._doubts:
            self._judge_doubts(self._told_at - QUIET)

    def finish(self) -> None:
        """Judge the rest, at the end."""
        self._judge_deliveries(self._deliveries)
        self._judge_doubts(self.checked)

    def _judge_deliveries(self, due: Iterable[str]) -> None:
        for task_id in tuple(due):
            del self._deliveries[task_id]
            if self._loads.was_delivered(task_id) is False:
                text = f'{task_id} is said to be delivered, and is not'
                self._say(Violation(self._step, 'claimed', text))

    def _judge_doubts(self, until: int) -> None:
        """Judge the tasks of which nothing new was said since then: all have heard the same."""
        while self._doubts:
            task_id = next(iter(self._doubts))
            if self._doubts[task_id] > until:
                return
            noted = self._doubts.pop(task_id)
            told = self._told.get(task_id)
            if told is not None:
                self._judge_wanted(told, noted)
                self._judge_shown(told)
                self._judge_line(told)
            if told is None or told.is_left:
                self._forget(task_id)

    def _forget(self, task_id: str) -> None:
        self._told.pop(task_id, None)
        self._shown.pop(task_id, None)

    def _judge_wanted(self, told: _Told, noted: int) -> None:
        """Whether the task is what was ordered when its load was last in stock, or since."""
        task = told.task
        ordered = self._ordered.get(task.order_id)
        if ordered is None or told.waited is None:
            return
        if ordered.gone is not None and noted > ordered.gone:
            return  # of a load that is left of an ended order, others may know no more than that
        if task.released_s < ordered.released_s:
            late_s = ordered.released_s - task.released_s
            self._accuse(told, 'release', f'is released {late_s:g} s before its order')
        forms = ordered.since(told.waited - FORMER)
        stations = {form.station for form in forms}
        if task.delivery not in {self._site.stations.get(station) for station in stations}:
            wanted = ' or '.join(sorted(stations))
            self._accuse(told, 'station', f'goes to {task.delivery}, and was ordered to {wanted}')
        lines = {
            (line.product, line.quantity)
            for form in forms
            for line in form.lines
            if line.line_id == task.line_id
        }
        if not any(self._is_same(task, *line) for line in lines):
            wanted = ' or '.join(f'{quantity} {product}' for product, quantity in sorted(lines))
            text = f'is {task.quantity} {task.product}, ordered was {wanted or "no such line"}'
            self._accuse(told, 'product', text)

    def _is_same(self, task: Task, product: str, quantity: int) -> bool:
        if task.product != product:
            return False
        place = self._site.products.get(product)
        # Of a load that was picked the weight is known, to the gram, and the quantity by it.
        apart_kg = abs(task.quantity - quantity) * (place.weight_kg if place else 1.0)
        return apart_kg <= _GRAM

    def _judge_shown(self, told: _Told) -> None:
        """Whether its robot shows the load that the task says it carries."""
        task = told.task
        robot, load = self._shown.get(task.task_id, ('', None))
        if load is None or not task.carried or task.robot != robot:
            return
        products = self._site.products
        if load.load_type in products and load.load_type != task.product:
            text = f'is {task.product}, and {robot} shows {load.load_type}'
            self._accuse(told, 'load', text, robot)
        elif load.weight > 0 and task.product in products:
            each_kg = products[task.product].weight_kg
            # A robot may weigh its load: half a piece more or less is the same quantity.
            if abs(load.weight - task.quantity * each_kg) > each_kg / 2 + _GRAM:
                text = f'is {task.quantity} {task.product}, and {robot} shows {load.weight:g} kg'
                self._accuse(told, 'load', text, robot)

    def _judge_line(self, told: _Told) -> None:
        is_delivered = told.task.status is TaskStatus.DELIVERED
        if told.line in _LINES_GIVEN_UP and is_delivered and not told.given_up:
            self._accuse(told, 'claimed', f'is said to be {told.line} as a line, and is delivered')

    def _accuse(self, told: _Told, rule: str, text: str, *robots: str) -> None:
        if rule not in told.accused:
            told.accused.add(rule)
            description = f'{told.task.task_id} {text}'
            self._say(Violation(self._step, rule, description, robots))
