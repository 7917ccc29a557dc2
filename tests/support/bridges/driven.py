"""A bridge that a test pauses and resumes, and whose snapshots it reads."""

from collections.abc import Sequence
from typing import Any, Self

from support.processes.harness import Bench, Process, eventually

from ros2_kafka_bridge.route.counters import Snapshot, from_line


class Driven:
    """The bridge of `tests/peers/driven_bridge.py`."""

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self._orders = bench.place / 'orders'
        self._process: Process | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if self._process is not None:
            self._process.__exit__(kind, error, trace)

    def start(self, routes: list[dict[str, Any]], *paused: str, **more: Any) -> None:
        """Start it, with some routes paused."""
        config = self._bench.config(routes, **more)
        self._process = self._bench.script(
            'driven_bridge.py', str(config), str(self._orders), *paused
        )
        eventually(lambda: self._count() > 0, 60, self.output)

    @property
    def process(self) -> Process:
        """The process of the bridge."""
        assert self._process is not None, 'it was started'
        return self._process

    def output(self) -> str:
        """What it has logged."""
        return '\n'.join(line for line in self._lines() if not line.startswith('['))

    def order(self, text: str) -> None:
        """Give it an order."""
        with self._orders.open('a') as file:
            file.write(f'{text}\n')

    def pause(self, route: str) -> None:
        """Pause a route, and wait until it is."""
        self.order(f'pause {route}')
        self.wait_for_state(route, 'paused')

    def snapshots(self, route: str) -> Sequence[Snapshot]:
        """All that it has told of a route."""
        told = [from_line(line.encode()) for line in self._lines() if line.startswith('[')]
        return [snapshot for one in told for snapshot in one if snapshot.route == route]

    def last(self, route: str) -> Snapshot:
        """What it has told last."""
        return self.snapshots(route)[-1]

    def wait_for_state(self, route: str, state: str, timeout_s: float = 40.0) -> None:
        """Wait until a route is in that state."""
        eventually(
            lambda: [s.state for s in self.snapshots(route)[-1:]] == [state],
            timeout_s,
            lambda: f'{route} is not {state}:\n{self.output()}\n{self.snapshots(route)[-1:]}',
        )

    def wait_for_snapshots(self, count: int, timeout_s: float = 60.0) -> None:
        """Wait for so many more, ten a second or fewer."""
        before = self._count()
        eventually(lambda: self._count() >= before + count, timeout_s, self.output)

    def _count(self) -> int:
        return sum(line.startswith('[') for line in self._lines())

    def _lines(self) -> list[str]:
        # The last one may not be whole.
        return self.process.output().split('\n')[:-1]
