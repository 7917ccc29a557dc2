"""A worker as its supervisor sees it: its routes, and how they and its process are doing."""

import contextlib
import math
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

from ros2_kafka_bridge.process.child_process import ChildProcess
from ros2_kafka_bridge.process.in_process_worker import InProcessWorker
from ros2_kafka_bridge.process.plan import Plan, Share, held_plan
from ros2_kafka_bridge.protocol import worker as wire
from ros2_kafka_bridge.protocol.worker import (
    EVENTS,
    Begun,
    Drain,
    End,
    Loaded,
    RoutesEnded,
    WorkerOrder,
)
from ros2_kafka_bridge.route.counters import Counters, Snapshot, State, from_line

_SILENT_S: Final = 120.0
_BEGIN_S: Final = 600.0


@dataclass
class _Life:
    """What is known of one process, from its start to its end."""

    routes: frozenset[str]
    started_s: float = 0.0
    heard_s: float = 0.0
    has_loaded: bool = False
    begun_s: float | None = None
    drain_orders: int = 0


class WorkerHandle:
    """One worker and what is known of it, from one start to the next.

    Args:
        number: Tells it apart from the others, from 1; 0 is the bridge in this process.
        share: Its routes.
        process: That runs them.
        awaits: A plan that is to count later: it loads everything, and waits to be told to begin.
    """

    def __init__(
        self,
        number: int,
        share: Share,
        process: ChildProcess | InProcessWorker,
        awaits: Plan | None = None,
    ) -> None:
        self.number = number
        self.rank = share.rank
        self.process = process
        self.snapshots = _unheard(share.routes)
        self.leaving: set[str] = set()  # routes that are to end
        self.starts = 0
        self.is_over = False  # it is not started again
        self.is_ending = False  # nor when it ends
        self.problem = ''
        self._awaits = awaits
        self._life = _Life(frozenset(share.routes))

    def __str__(self) -> str:
        if self.is_in_process:
            return 'the first process'
        return f'worker {self.number} ({", ".join(self.snapshots)})'

    @property
    def is_in_process(self) -> bool:
        """Whether it is the bridge in this process, which cannot be killed or started again."""
        return isinstance(self.process, InProcessWorker)

    @property
    def waits(self) -> bool:
        """Whether it is to be told to begin."""
        return self._awaits is not None

    @property
    def is_due(self) -> bool:
        """Whether it is time to start it."""
        return not self.is_over and self.process.is_due

    @property
    def is_away(self) -> bool:
        """Whether it has failed and waits for its next start."""
        return bool(self.starts) and not self.process.is_running and not self.is_over

    @property
    def next_look_s(self) -> float:
        """When to look at it at the latest, where it tells nothing before."""
        return math.inf if self.is_over else self.process.next_look_s

    @property
    def has_loaded(self) -> bool:
        """Whether it has loaded everything."""
        return self._life.has_loaded

    @property
    def has_begun(self) -> bool:
        """Whether its routes have begun."""
        return self._life.begun_s is not None

    @property
    def is_draining(self) -> bool:
        """Whether it was asked to drain and end."""
        return self._life.drain_orders > 0

    @property
    def failed_for_good(self) -> list[str]:
        """The routes that are not started again, and were not to end anyway."""
        found = [name for name, snapshot in self.snapshots.items() if snapshot.final]
        return [name for name in found if name not in self.leaving]

    @property
    def silent_s(self) -> float:
        """For how long it has told nothing; 0 where it need not, as in its start and its end."""
        return (
            time.monotonic() - self._life.heard_s if self._should_tell and self.has_begun else 0.0
        )

    @property
    def _should_tell(self) -> bool:
        """Whether a process of its own runs that was not asked to end."""
        return self.process.is_running and not (self.is_in_process or self.is_draining)

    @property
    def hangs(self) -> bool:
        """Whether it has said nothing for long, or all too little, in its start.

        One that waits for Kafka, or for a type, has begun; one that waits to begin has a limit
        of its own.
        """
        if not self._should_tell or self.has_begun or self.waits:
            return False
        now_s = time.monotonic()
        life = self._life
        return now_s - life.heard_s > _SILENT_S or now_s - life.started_s > _BEGIN_S

    # Its lives

    @property
    def _child(self) -> ChildProcess:
        assert isinstance(self.process, ChildProcess), 'this process is never started again'
        return self.process

    def start(
        self,
        plan: Plan,
        arguments: Sequence[str],
        kept: Sequence[int],
        paused: Iterable[str] = (),
    ) -> None:
        """Start it with the routes that have not failed for good.

        Args:
            plan: What counts now; one that waits runs the plan that it awaits.
            arguments: What follows its own.
            kept: File descriptors that it keeps open.
            paused: Routes that begin paused.

        Raises:
            OSError: There is no room for a process.
        """
        routes = [name for name, snapshot in self.snapshots.items() if not snapshot.final]
        self.snapshots |= _unheard(routes)
        self.starts += 1
        now_s = time.monotonic()
        self._life = _Life(frozenset(routes), now_s, now_s)
        options = [f'--worker={self.number}', f'--routes={",".join(routes)}']
        options += ['--waits'] if self.waits else []
        if mine := [name for name in routes if name in set(paused)]:
            options.append(f'--paused={",".join(mine)}')
        with held_plan(self._awaits or plan) as descriptor:
            options.append(f'--plan={descriptor}')
            self._child.start([*options, *arguments], [descriptor, *kept])
        self.problem = ''

    def start_later(self, how: str) -> float:
        """Note that it has failed, and is to be started again; returns in how many seconds."""
        # A start that fails is never a good time, however long it takes.
        begun_s = self._life.begun_s
        wait_s = self._child.start_later(0.0 if begun_s is None else time.monotonic() - begun_s)
        self.problem = how
        for name, snapshot in self.snapshots.items():
            if not snapshot.final:
                reason = f'its worker {how} and is started again'
                self.snapshots[name] = snapshot.at_rest._replace(state=State.FAILED, reason=reason)
        return wait_s

    def kill(self) -> None:
        """End it at once."""
        self._child.kill()

    def retire(self) -> None:
        """Have it no more: end it at once, where it has not ended."""
        self.kill()
        self.process.exit_status()  # whatever it is
        self.is_over = True
        self.forget(list(self.snapshots))

    def forget(self, routes: Iterable[str]) -> None:
        """Have no such routes any more."""
        for name in routes:
            self.snapshots.pop(name, None)
            self.leaving.discard(name)

    # What it says

    def on_lines(self, lines: Sequence[bytes]) -> None:
        """Keep the last snapshots of what the worker has told, and note what has happened.

        What is none is left out: whatever a worker does, its supervisor outlives it.
        """
        if not lines:
            return
        self._life.heard_s = time.monotonic()
        for line in [line for line in lines if not line.startswith(b'{')][-1:]:
            with contextlib.suppress(ValueError, KeyError, TypeError, AttributeError):
                told = {snapshot.route: snapshot for snapshot in from_line(line)}
                self.snapshots |= {name: told[name] for name in told.keys() & self.snapshots}
        for line in [line for line in lines if line.startswith(b'{')]:
            with contextlib.suppress(ValueError):
                self._on_event(EVENTS.decode(line))

    def _on_event(self, event: wire.Event) -> None:
        match event:
            case Loaded():
                self._life.has_loaded = True
            case Begun():
                self._life.begun_s = time.monotonic()
            case RoutesEnded(routes):
                self.forget(routes)

    # What it is told

    def send(self, order: WorkerOrder) -> None:
        """Give it an order, if it runs; one that was not begun is begun by `start`."""
        if self.process.is_running:
            self.process.send(wire.to_line(order))

    def drain(self, *, at_once: bool = False) -> None:
        """Let it drain and end, or give up what is still in flight."""
        wanted = 2 if at_once else 1
        for _ in range(wanted - self._life.drain_orders):
            self.send(Drain())
        self._life.drain_orders = max(wanted, self._life.drain_orders)

    def begin(self) -> None:
        """Let one begin that waits."""
        self._awaits = None
        now_s = time.monotonic()
        self._life.started_s = self._life.heard_s = now_s
        self.send(wire.Begin())

    def end(self, routes: Iterable[str]) -> None:
        """Let some of its routes drain, and have them no more after that."""
        mine = self.snapshots.keys() & set(routes)
        # One that was started without a route that has failed for good knows nothing of it.
        known = mine & self._life.routes
        if self.process.is_running and not self.is_draining and known:
            self.leaving |= known
            self.send(End(tuple(known)))
            mine -= known
        self.forget(mine)
        if not self.process.is_running and len(self.failed_for_good) == len(self.snapshots):
            self.is_over = True  # without any route to run it would take all for its own


def _unheard(routes: Iterable[str]) -> dict[str, Snapshot]:
    """What is known of routes before their worker has said anything: none of them is stuck."""
    return {name: Counters(name).nothing_told for name in routes}
