"""What a running bridge can be asked for: pause, reload, and the steps of its lifecycle.

Each that takes longer is a generator, which goes on whenever it is asked to, and one at a time:
whoever asks must be heard meanwhile, and so must the workers.
"""

import time
from collections import deque
from collections.abc import Callable, Generator
from typing import Final, NamedTuple

import msgspec

from ros2_kafka_bridge.logs import lines as logs
from ros2_kafka_bridge.process.config_diff import Checked
from ros2_kafka_bridge.process.draining import drain
from ros2_kafka_bridge.process.plan import Plan
from ros2_kafka_bridge.process.reload import check, did, hand_over, would
from ros2_kafka_bridge.process.worker_pool import WorkerPool
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


Steps = Generator[None, None, Answer]
_Reply = Callable[[Answer], None]


class _Operation(NamedTuple):
    do: Do
    answer: _Reply


class ControlPlane:
    """Does what is asked for; between that, every route of an active bridge has a worker.

    Args:
        pool: The workers.
        lifecycle: Where the bridge begins.
        stop: Asked by a shutdown.
    """

    def __init__(self, pool: WorkerPool, lifecycle: Lifecycle, stop: Stop) -> None:
        self.lifecycle = lifecycle
        self.last_reload: Reload | None = None
        self.on_configured: Callable[[Configured], None] = lambda _: None
        self._pool = pool
        self._stop = stop
        self._log = logs.route_log()
        self._queue: deque[_Operation] = deque()
        self._running: tuple[_Operation, Steps] | None = None

    def close(self) -> None:
        """Give up what is not done yet; the bridge ends."""
        if self._running is not None:
            operation, steps = self._running
            steps.close()
            self._running = None
            self._queue.appendleft(operation)
        while self._queue:
            self._queue.popleft().answer(_not_done('not done: the bridge stops'))

    @property
    def is_busy(self) -> bool:
        """Whether something is being done."""
        return self._running is not None or bool(self._queue)

    def configured(self) -> Configured:
        """What counts now, for whoever watches the bridge."""
        plan = self._pool.plan
        return Configured(plan.values, plan.file, plan.chosen)

    # Requests

    def handle(self, request: Request, answer: Callable[[Answer], None]) -> None:
        """Do what a request asks for, at once or when it is its turn."""

        def reply(result: Answer) -> None:
            answer(msgspec.structs.replace(result, number=request.number))

        match request.do:
            case Do.PAUSE | Do.RESUME as do:
                reply(self._pause(request.route, paused=do is Do.PAUSE))
            case Do.SHUTDOWN:
                reply(_done('stopping: draining'))
                if not self._stop.asked:  # a second one would be an end at once
                    self._stop.ask()
            case do:
                self.enqueue(do, reply)

    def enqueue(self, do: Do, answer: _Reply = lambda _: None) -> None:
        """Do something when it is its turn."""
        if len(self._queue) >= _WAITING or self._stop.asked:
            why = 'the bridge stops' if self._stop.asked else 'too much is asked for at once'
            answer(_not_done(f'not done: {why}'))
            return
        self._queue.append(_Operation(do, answer))

    def enqueue_reload(self) -> None:
        """Reload, unless that waits to be done anyway."""
        if not any(operation.do is Do.RELOAD for operation in self._queue):
            self.enqueue(Do.RELOAD)

    def _pause(self, route: str, *, paused: bool) -> Answer:
        if route not in self._pool.plan.names:
            there = ', '.join(self._pool.plan.names)
            return _not_done(f'no route {route!r}: there are {there}')
        if paused:
            self._pool.pause(route)
            return _done(f'{route} takes nothing until it is resumed')
        self._pool.resume(route)
        return _done(f'{route} goes on')

    # Step by step

    def step(self) -> None:
        """Go on with what is being done; in between, see that every route has a worker."""
        if self._running is None and self._queue:
            operation = self._queue.popleft()
            self._running = operation, self._steps(operation.do)
        if self._running is not None:
            self._go_on(*self._running)
        if self._running is None and self.lifecycle is Lifecycle.ACTIVE:
            self._pool.fill()

    def _go_on(self, operation: _Operation, steps: Steps) -> None:
        try:
            next(steps)
        except StopIteration as end:
            result: Answer = end.value
        except OSError as error:
            result = _out_of(error)
        else:
            return
        self._running = None
        operation.answer(result if operation.do is Do.PREVIEW else self._say(operation.do, result))

    def _say(self, do: Do, result: Answer) -> Answer:
        """Say in the log what has come of it: of a refusal each line for itself."""
        if not result.done:
            for line in result.text.split('\n'):
                self._log.error('%s: %s', do, line)
        elif do is Do.RELOAD:
            self._log.info('reloaded: %s', result.text)
        else:
            self._log.info('%s: %s', do, result.text)
        return msgspec.structs.replace(result, said=True)

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

    # Lifecycle

    def _configure(self) -> Steps:
        checked = yield from check(self._pool.plan, self._pool.selector)
        if checked.plan is None:
            return _bad(checked)
        self._adopt(checked.plan)
        self.lifecycle = Lifecycle.INACTIVE
        return _done('configured: activate starts the routes')

    def _activate(self) -> Steps:
        self.lifecycle = Lifecycle.ACTIVE
        self._pool.fill()
        until_s = time.monotonic() + _BEGIN_S
        while not self._pool.has_begun and time.monotonic() < until_s:
            yield
        return _done('active: the routes run')

    def _deactivate(self) -> Steps:
        self._log.info('deactivated: draining')
        before = self._pool.failures
        yield from drain(self._pool, lambda: False)
        for worker in self._pool.workers:
            worker.retire()
        self.lifecycle = Lifecycle.INACTIVE
        gave_up = self._pool.failures > before
        rest = ', but not all went well: the log says what' if gave_up else ''
        return _done(f'inactive: the routes were drained{rest}')

    def _clean_up(self) -> Steps:
        yield
        self.lifecycle = Lifecycle.UNCONFIGURED
        return _done('unconfigured: configure reads the file again')

    # Reload

    def _preview(self) -> Steps:
        checked = yield from check(self._pool.plan, self._pool.selector)
        if checked.plan is None:
            return _bad(checked)
        found = checked.difference
        return _done(would(found), found.all_lines)

    def _reload(self) -> Steps:
        try:
            result = yield from self._reloaded()
        except OSError as error:
            result = _out_of(error)
        self.last_reload = Reload(time.time(), result.done, result.text)
        return result

    def _reloaded(self) -> Steps:
        checked = yield from check(self._pool.plan, self._pool.selector)
        if checked.plan is None:
            return _bad(checked)
        plan, found = checked.plan, checked.difference
        for line in found.all_lines:
            self._log.info('reload: %s', line)
        if self.lifecycle is not Lifecycle.ACTIVE:
            self._adopt(plan)
            return _done(f'counts when the routes start: {would(found)}', found.all_lines)
        if problem := (yield from hand_over(self._pool, plan, found)):
            return _not_done(problem, found.all_lines)
        self._adopt(plan)
        return _done(did(found), found.all_lines)

    def _adopt(self, plan: Plan) -> None:
        """Let another plan count, also for whoever watches the bridge."""
        self._pool.adopt(plan)
        self.on_configured(self.configured())


def _done(text: str, changes: tuple[str, ...] = ()) -> Answer:
    return Answer(0, done=True, text=text, changes=changes)


def _not_done(text: str, changes: tuple[str, ...] = ()) -> Answer:
    return Answer(0, done=False, text=text, changes=changes)


def _out_of(error: OSError) -> Answer:
    """Not done, for want of something that the system gives out."""
    return _not_done(f'{error.strerror or error}: refused: all goes on as it was')


def _bad(checked: Checked) -> Answer:
    return _not_done('\n'.join([*checked.problems, 'refused: all goes on as it was']))


def _refused(do: Do, now: Lifecycle, needed: Lifecycle) -> Steps:
    yield
    return _not_done(f'{do} is possible where the bridge is {needed}, and it is {now}')
