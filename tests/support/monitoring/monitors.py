"""The real process that shows a bridge, told about a bridge that is made up."""

import io
import json
import math
import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Self

import httpx
import msgspec
from ruamel.yaml import YAML
from support.bridges.routes import to_kafka, to_ros
from support.processes.harness import eventually
from support.processes.lifetimes import ended

from ros2_kafka_bridge.config.file import loads
from ros2_kafka_bridge.config.validation import plain
from ros2_kafka_bridge.protocol.monitor import (
    Answer,
    Configured,
    Do,
    Lifecycle,
    Report,
    Request,
    RouteReport,
    Worker,
)
from ros2_kafka_bridge.route.counters import (
    BOUNDS_S,
    Distribution,
    Measures,
    Snapshot,
    State,
    Trouble,
)
from ros2_kafka_bridge.testing.local_kafka import free_port

TOKEN = 'a-token-for-the-tests'  # noqa: S105 (of tests)


def snapshot(route: str, state: State = State.RUNNING, **more: Any) -> Snapshot:
    """The snapshot of a route, all zero where nothing else is said."""
    counts = dict.fromkeys(
        (
            'taken', 'confirmed', 'dead_lettered', 'dropped', 'skipped', 'returned', 'lost',
            'given_up', 'spooled', 'in_flight', 'lost_upstream', 'repeated',
        ),
        0,
    )  # fmt: skip
    return Snapshot(
        **{'route': route, 'state': state, 'reason': '', 'lag': None, **counts, **more}
    )


def report(*told: Snapshot | RouteReport, **more: Any) -> Report:
    """A report of one worker that runs these routes."""
    routes = tuple(
        it if isinstance(it, RouteReport) else RouteReport(1, 0.5, 0.0, it) for it in told
    )
    settings: dict[str, Any] = {
        'time_s': time.time(),
        'lifecycle': Lifecycle.ACTIVE,
        'stopping': False,
        'started_s': time.time() - 3700,
        'workers': (Worker(1, os.getpid(), 1),),
        'routes': routes,
    }
    return Report(**{**settings, **more})


def distribution(count: int, around_s: float) -> Distribution:
    """So many durations about a time, a few of them much longer."""
    index = next(i for i, bound in enumerate(BOUNDS_S) if bound >= around_s)
    counts = [0] * (len(BOUNDS_S) + 1)
    counts[index] = count - count // 50
    counts[min(index + 2, len(BOUNDS_S))] += count // 50
    return Distribution(tuple(counts), count * around_s)


class Monitor:
    """The process, its input and output; ended at the end of `with`.

    Args:
        text: The configuration.
        file: Its name.
        log: Where its standard error goes.
        answer: Answers what the process asks for; by default all is done.
    """

    def __init__(
        self,
        text: str,
        file: Path,
        log: Path,
        answer: Callable[[Request], Answer] | None = None,
        environ: dict[str, str] | None = None,
    ) -> None:
        self.asked: list[Request] = []
        self.log = log
        self._answer = answer or _done
        self._lock = threading.Lock()
        listener = socket.create_server(('127.0.0.1', 0))
        self.port: int = listener.getsockname()[1]
        self.url = f'http://127.0.0.1:{self.port}/'
        module = [
            '-P',
            '-m',
            'ros2_kafka_bridge.monitoring',
            f'--socket={listener.fileno()}',
            '--requests=1',
        ]
        with log.open('ab') as errors, listener:
            self.process = subprocess.Popen(
                [sys.executable, *module],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=errors,
                pass_fds=[listener.fileno()],
                env={**os.environ, **(environ or {})},
            )
        self.configure(text, file)
        threading.Thread(target=self._obey, daemon=True).start()

    def __enter__(self) -> Self:
        with ExitStack() as ending:
            ending.enter_context(ended(self.process))
            eventually(self._answers, 60, lambda: f'it does not answer:\n{self.log.read_text()}')
            self._ending = ending.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._ending.close()

    def _answers(self) -> bool:
        assert self.process.poll() is None, self.log.read_text()
        try:
            return httpx.get(f'{self.url}livez', timeout=20).status_code > 0
        except httpx.TransportError:
            return False

    def configure(self, text: str, file: Path) -> None:
        """Tell the configuration that counts from now on."""
        self.tell(Configured(plain(loads(text, str(file), os.environ)), str(file)))

    def tell(self, what: Report | Configured | Answer) -> None:
        """Write a line to it."""
        assert self.process.stdin is not None
        with self._lock:
            self.process.stdin.write(msgspec.json.encode(what) + b'\n')
            self.process.stdin.flush()

    def end(self) -> int:
        """Close its input; returns the exit status."""
        assert self.process.stdin is not None
        self.process.stdin.close()
        return self.process.wait(20)

    def get(self, path: str, **headers: str) -> httpx.Response:
        """Ask for a path."""
        return httpx.get(self.url + path, headers=headers, timeout=30)

    def post(self, path: str, content: Any = None, **headers: str) -> httpx.Response:
        """Order as the page does, with the token."""
        own = {
            'authorization': f'Bearer {TOKEN}',
            'content-type': 'application/json',
            'origin': self.url.rstrip('/'),
        }
        given = {name.replace('_', '-'): value for name, value in headers.items()}
        body = json.dumps({} if content is None else content)
        return httpx.post(self.url + path, headers={**own, **given}, content=body, timeout=70)

    def state(self) -> dict[str, Any]:
        """What `/api/state` tells."""
        return dict(self.get('api/state').json())

    def _obey(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            request = msgspec.json.decode(line, type=Request)
            self.asked.append(request)
            self.tell(self._answer(request))


def _done(request: Request) -> Answer:
    return Answer(request.number, done=True, text=f'{request.do} {request.route}'.strip())


class Traffic:
    """A made-up bridge of many routes: steady ones, bursts, and each kind of trouble."""

    def __init__(self, names: list[str], to_ros: Callable[[str], bool]) -> None:
        self.names = names
        self.paused: set[str] = set()
        self.step = 0
        self._to_ros = to_ros
        self._confirmed = dict.fromkeys(names, 0)
        self._began_s = time.time() - 7 * 3600

    def answer(self, request: Request) -> Answer:
        """Pause and resume; a reload has something to show."""
        if request.do is Do.PAUSE:
            self.paused.add(request.route)
        if request.do is Do.RESUME:
            self.paused.discard(request.route)
        if request.do in {Do.PREVIEW, Do.RELOAD}:
            changes = (
                '+ route telemetry_new: /telemetry -> telemetry',
                '~ route orders: max_rate',
            )
            return Answer(request.number, done=True, text='two routes', changes=changes)
        return Answer(request.number, done=True, text=f'{request.route}: {request.do}d')

    def report(self, time_s: float) -> Report:
        """One second more."""
        self.step += 1
        told = [self._route(number, name, time_s) for number, name in enumerate(self.names)]
        workers = (Worker(1, os.getpid(), 1), Worker(2, os.getpid(), 3))
        return report(
            *told, time_s=time_s, started_s=self._began_s, workers=workers,
            paused=tuple(sorted(self.paused)),
        )  # fmt: skip

    def _route(self, number: int, name: str, time_s: float) -> RouteReport:
        to_ros = self._to_ros(name)
        state, reason = self._state(number, name)
        wave = 1 + math.sin(self.step / (15 + number % 17) + number)
        rate = int((20 + 90 * (number % 7)) * wave) if state is State.RUNNING else 0
        self._confirmed[name] += rate
        confirmed = self._confirmed[name]
        dead = 3 * (number % 11 == 3) + (number == 1)
        waiting = state is State.WAITING
        measures = Measures(
            bytes_taken=confirmed * 410,
            bytes_confirmed=confirmed * 410,
            errors={'DecodeError': dead} if dead else {},
            waited_s=self.step * 0.4 if number % 9 == 2 else 0.0,
            rebalances=number % 3,
            matched=0 if waiting else 1 + number % 3,
            mismatched=int(number % 12 == 4),
            queued=int(40 * wave),
            queue_limit=500,
            in_bridge=distribution(confirmed, 0.004 if number % 5 else 0.04),
            end_to_end=distribution(confirmed, 0.009 if number % 5 else 0.2),
            round_trip=Distribution() if to_ros else distribution(confirmed, 0.003),
            broker_round_trip_s=(0.0011, 0.0052),
            troubles=self._troubles(number, name, time_s, dead, reason),
        )
        made = snapshot(
            name, state, reason=reason, taken=confirmed + dead + int(9 * wave),
            confirmed=confirmed, dead_lettered=dead, in_flight=int(9 * wave),
            lag=(self.step * 31 if waiting else int(40 * wave)) if to_ros else None,
            measures=measures,
        )  # fmt: skip
        return RouteReport(1 + number % 2, 0.4, 0.0, made)

    def _state(self, number: int, name: str) -> tuple[State, str]:
        if name in self.paused:
            return State.PAUSED, 'paused by an operator'
        if number % 33 == 6:
            return State.WAITING, f'no subscriber on /{name}; start one, or set min_subscribers: 0'
        if number % 50 == 9:
            return State.FAILED, (
                f'topic {name}: this user may not read it (TOPIC_AUTHORIZATION_FAILED); give it '
                'READ on the topic'
            )
        return State.RUNNING, ''

    def _troubles(
        self, number: int, name: str, time_s: float, dead: int, reason: str
    ) -> tuple[Trouble, ...]:
        found = []
        if dead:
            text = f'{name}[0]@{41 + number}: not UTF-8 at byte 7: 0xff; it is a dead letter'
            found.append(Trouble(time_s // 60 * 60 - 60 * number, 'DecodeError', text, dead))
        if reason and number % 50 == 9:
            found.append(Trouble(time_s // 60 * 60, 'RouteError', reason, 12))
        return tuple(found)


class Stage:
    """The process, and what it is told each second."""

    def __init__(self, place: Path, routes: int, token: str = TOKEN) -> None:
        names = [f'route_{number:03d}' for number in range(routes)]
        self.traffic = Traffic(names, lambda name: int(name[-3:]) % 2 == 0)
        config = {
            'name': 'warehouse-1',
            'kafka': {'bootstrap.servers': f'localhost:{free_port()}'},
            'monitoring': {'node': False, **({'token': token} if token else {})},
            'routes': [
                to_ros(name, f'/{name}', name=name)
                if int(name[-3:]) % 2 == 0
                else to_kafka(f'/{name}', name, name=name)
                for name in names
            ],
        }
        text = io.StringIO()
        YAML(typ='safe').dump(config, text)
        log = place / 'monitor.log'
        self.monitor = Monitor(text.getvalue(), place / 'bridge.yaml', log, self.traffic.answer)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._tell, daemon=True)

    def __enter__(self) -> Self:
        with ExitStack() as ending:
            ending.enter_context(self.monitor)
            now_s = time.time()
            for second in range(120):
                self.monitor.tell(self.traffic.report(now_s - 120 + second))
            self._thread.start()
            self._ending = ending.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        with self._ending:
            self._ended.set()
            self._thread.join()
            assert self.monitor.end() == 0, self.monitor.log.read_text()

    def _tell(self) -> None:
        while not self._ended.wait(1):
            self.monitor.tell(self.traffic.report(time.time()))
