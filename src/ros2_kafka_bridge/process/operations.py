"""What a running bridge can be asked for: pause, reload, and the steps of its lifecycle.

Each that takes longer is a generator, which goes on whenever it is asked to, and one at a time:
whoever asks must be heard meanwhile, and so must the workers.
"""

import os
import time
from collections import deque
from collections.abc import Callable, Generator
from typing import Final, NamedTuple

from ros2_kafka_bridge.logs import lines as logs
from ros2_kafka_bridge.process.crew import Crew
from ros2_kafka_bridge.process.difference import Checked
from ros2_kafka_bridge.process.plan import Plan, share_out, write_plan
from ros2_kafka_bridge.process.reloading import check, did, hand_over, would
from ros2_kafka_bridge.protocol.monitor import Answer, Configured, Do, Lifecycle, Reload, Request
from ros2_kafka_bridge.threads.stop import Stop

_BEGIN_S: Final = 50.0
_WAITING: Final = 16

_FROM: Final = {
    Do.CONFIGURE: Lifecycle.UNCONFIGURED,
    Do.ACTIVATE: Lifecycle.INACTIVE,
    Do.DEACTIVATE: Lifecycle.ACTIVE,
    Do.CLEANUP: Lifecycle.INACTIVE,
}


class OperationResult(NamedTuple):
    """How something has ended: as an `Answer` without its number."""

    done: bool
    text: str
    changes: tuple[str, ...] = ()
    said: bool = False


def _done(text: str, changes: tuple[str, ...] = ()) -> OperationResult:
    return OperationResult(done=True, text=text, changes=changes)


def _not_done(text: str, changes: tuple[str, ...] = ()) -> OperationResult:
    return OperationResult(done=False, text=text, changes=changes)


Steps = Generator[None, None, OperationResult]


class _Asked(NamedTuple):
    do: Do
    answer: Callable[[OperationResult], None]


class Operations:
    """Does what is asked for.

    Args:
        plan: What counts at the start.
        crew: The workers.
        lifecycle: Where the bridge begins.
        stop: Asked by a shutdown.
    """

    def __init__(self, plan: Plan, crew: Crew, lifecycle: Lifecycle, stop: Stop) -> None:
        self.plan = plan
        self.lifecycle = lifecycle
        self.reload: Reload | None = None
        self.on_configured: Callable[[Configured], None] = lambda _: None
        self._crew = crew
        self._stop = stop
        self._descriptor = write_plan(plan)
        self._log = logs.route_log()
        self._queue: deque[_Asked] = deque()
        self._running: tuple[_Asked, Steps] | None = None
        self._has_late = False  # routes that were to end for a reload that was not done

    def close(self) -> None:
        """Give up what is not done yet."""
        if self._running is not None:
            asked, steps = self._running
            steps.close()
            self._running = None
            asked.answer(_not_done('not done: the bridge stops'))
        for asked in self._queue:
            asked.answer(_not_done('not done: the bridge stops'))
        self._queue.clear()

    def release(self) -> None:
        """Close what is held in memory; the workers have ended."""
        os.close(self._descriptor)

    @property
    def busy(self) -> bool:
        """Whether something is being done."""
        return self._running is not None or bool(self._queue)

    def configured(self) -> Configured:
        """What counts now, for whoever watches the bridge."""
        return Configured(self.plan.values, self.plan.file, self.plan.chosen)

    # Asked for

    def request(self, request: Request, answer: Callable[[Answer], None]) -> None:
        """Do what a request asks for, at once or when it is its turn."""

        def tell(result: OperationResult) -> None:
            answer(Answer(request.number, *result))

        match request.do:
            case Do.PAUSE:
                tell(self.pause(request.route))
            case Do.RESUME:
                tell(self.resume(request.route))
            case Do.SHUTDOWN:
                tell(_done('stopping: draining'))
                if not self._stop.asked:  # a second one would be an end at once
                    self._stop.ask()
            case do:
                self.ask(do, tell)

    def ask(self, do: Do, answer: Callable[[OperationResult], None] = lambda _: None) -> None:
        """Do something when it is its turn. Nobody who waits with the same is asked for twice."""
        if len(self._queue) >= _WAITING or self._stop.asked:
            why = 'the bridge stops' if self._stop.asked else 'too much is asked for at once'
            answer(_not_done(f'not done: {why}'))
            return
        self._queue.append(_Asked(do, answer))

    def reload_once(self) -> None:
        """Reload, unless that waits to be done anyway."""
        if not any(asked.do is Do.RELOAD for asked in self._queue):
            self.ask(Do.RELOAD)

    def step(self) -> None:
        """Go on with what is being done."""
        if self._running is None and self._has_late and self.lifecycle is Lifecycle.ACTIVE:
            self._begin_again()
        if self._running is None and self._queue:
            asked = self._queue.popleft()
            self._running = asked, self._steps(asked.do)
        if self._running is None:
            return
        asked, steps = self._running
        try:
            next(steps)
        except StopIteration as end:
            result: OperationResult = end.value
        except OSError as error:
            result = _out_of(error)
        else:
            return
        self._running = None
        asked.answer(result if asked.do is Do.PREVIEW else self._said(asked.do, result))

    def _said(self, do: Do, result: OperationResult) -> OperationResult:
        """Say in the log what has come of it: of a refusal each line for itself."""
        if not result.done:
            for line in result.text.split('\n'):
                self._log.error('%s: %s', do, line)
        elif do is Do.RELOAD:
            self._log.info('reloaded: %s', result.text)
        else:
            self._log.info('%s: %s', do, result.text)
        return result._replace(said=True)

    def _steps(self, do: Do) -> Steps:
        needed = _FROM.get(do)
        if needed is not None and self.lifecycle is not needed:
            return _refused(do, self.lifecycle, needed)
        ways: dict[Do, Callable[[], Steps]] = {
            Do.RELOAD: self._reload,
            Do.PREVIEW: self._preview,
            Do.CONFIGURE: self._configure,
            Do.ACTIVATE: self._activate,
            Do.DEACTIVATE: self._deactivate,
            Do.CLEANUP: self._clean_up,
        }
        return ways[do]()

    # Pause

    def pause(self, route: str) -> OperationResult:
        """Let a route pause; whoever runs it later begins paused."""
        if route not in self.plan.names:
            return self._unknown(route)
        self._crew.pause(route)
        return _done(f'{route} takes nothing until it is resumed')

    def resume(self, route: str) -> OperationResult:
        """Let a paused route go on."""
        if route not in self.plan.names:
            return self._unknown(route)
        self._crew.resume(route)
        return _done(f'{route} goes on')

    def _unknown(self, route: str) -> OperationResult:
        there = ', '.join(self.plan.names)
        return _not_done(f'no route {route!r}: there are {there}')

    # Lifecycle

    def start(self) -> None:
        """Have workers for all routes."""
        self._crew.hire(self.plan.shares(), self._descriptor)

    def _configure(self) -> Steps:
        checked = yield from check(self.plan)
        if checked.plan is None:
            return _bad(checked)
        self._adopt(checked.plan, write_plan(checked.plan))
        self.lifecycle = Lifecycle.INACTIVE
        return _done('configured: activate starts the routes')

    def _activate(self) -> Steps:
        self.lifecycle = Lifecycle.ACTIVE
        self.start()
        until_s = time.monotonic() + _BEGIN_S
        while not self._crew.begun and time.monotonic() < until_s:
            yield
        return _done('active: the routes run')

    def _deactivate(self) -> Steps:
        self._log.info('deactivated: draining')
        before, self._crew.status = self._crew.status, 0
        try:
            yield from self._crew.drain(self.plan.routes, lambda: False)
        finally:  # a stop may come in between
            gave_up, self._crew.status = self._crew.status, max(before, self._crew.status)
        self._crew.dismiss()
        self.lifecycle = Lifecycle.INACTIVE
        rest = ', but not all went well: the log says what' if gave_up else ''
        return _done(f'inactive: the routes were drained{rest}')

    def _clean_up(self) -> Steps:
        yield
        self.lifecycle = Lifecycle.UNCONFIGURED
        return _done('unconfigured: configure reads the file again')

    # Reload

    def _preview(self) -> Steps:
        checked = yield from check(self.plan)
        if checked.plan is None:
            return _bad(checked)
        found = checked.difference
        return _done(would(found), found.all_lines)

    def _reload(self) -> Steps:
        try:
            result = yield from self._reloaded()
        except OSError as error:
            result = _out_of(error)
        self.reload = Reload(time.time(), result.done, result.text)
        return result

    def _reloaded(self) -> Steps:
        checked = yield from check(self.plan)
        if checked.plan is None:
            return _bad(checked)
        plan, found = checked.plan, checked.difference
        for line in found.all_lines:
            self._log.info('reload: %s', line)
        if self.lifecycle is not Lifecycle.ACTIVE:
            self._adopt(plan, write_plan(plan))
            return _done(f'counts when the routes start: {would(found)}', found.all_lines)
        descriptor = write_plan(plan)
        problem = 'given up'
        try:
            problem = yield from hand_over(self._crew, self.plan, plan, found, descriptor)
        finally:
            if problem:
                os.close(descriptor)
        if problem:
            self._begin_again()
            return _not_done(problem, found.all_lines)
        self._adopt(plan, descriptor)
        return _done(did(found), found.all_lines)

    def _begin_again(self) -> None:
        """Have workers for routes that were to be changed, and have ended for nothing.

        The first process may hold some for longer: they follow.
        """
        there = {name for worker in self._crew.workers for name in worker.snapshots}
        to_ros, from_ros = self.plan.directions(set(self.plan.names) - there)
        shares = share_out(to_ros, from_ros, bool(to_ros) + bool(from_ros))
        self._crew.hire(shares, self._descriptor)
        self._has_late = any(worker.leaving for worker in self._crew.workers)

    def _adopt(self, plan: Plan, descriptor: int) -> None:
        """Let another configuration count from now on, also for who is started again."""
        before, self._descriptor = self._descriptor, descriptor
        self.plan = plan
        self._crew.paused &= set(plan.names)
        for worker in self._crew.workers:
            worker.descriptor = descriptor
        os.close(before)
        self.on_configured(self.configured())


def _out_of(error: OSError) -> OperationResult:
    """Not done, for want of something that the system gives out."""
    return _not_done(f'{error.strerror or error}: refused: all goes on as it was')


def _bad(checked: Checked) -> OperationResult:
    return _not_done('\n'.join([*checked.problems, 'refused: all goes on as it was']))


def _refused(do: Do, now: Lifecycle, needed: Lifecycle) -> Steps:
    yield
    return _not_done(f'{do} is possible where the bridge is {needed}, and it is {now}')
