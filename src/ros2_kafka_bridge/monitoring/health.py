"""Whether the bridge lives, and whether it is ready, in the way of Kubernetes."""

from collections.abc import Iterator, Sequence
from typing import Any, Final, NamedTuple

from ros2_kafka_bridge.protocol.limits import SILENT_S, STUCK_S
from ros2_kafka_bridge.protocol.monitor import Lifecycle, Report, RouteReport
from ros2_kafka_bridge.route.counters import State

_READY: Final = frozenset({State.RUNNING, State.WAITING, State.PAUSED})


class Check(NamedTuple):
    """One thing that was looked at.

    Args:
        name: Such as `route/orders`.
        good: Whether it is as it should be.
        text: How it is, in words.
    """

    name: str
    good: bool
    text: str


class Health(NamedTuple):
    """What was found.

    Args:
        kind: `livez` or `readyz`.
    """

    kind: str
    checks: tuple[Check, ...]

    @property
    def good(self) -> bool:
        """Whether all of it is."""
        return all(check.good for check in self.checks)

    @property
    def problems(self) -> list[str]:
        """What is not, in words."""
        return [f'{check.name}: {check.text}' for check in self.checks if not check.good]

    def text(self, *, verbose: bool) -> str:
        """As Kubernetes writes it: `ok`, or a line for each check."""
        if self.good and not verbose:
            return 'ok'
        lines = [_line(check) for check in self.checks]
        return '\n'.join([*lines, f'{self.kind} check {"passed" if self.good else "failed"}', ''])

    def as_dict(self) -> dict[str, Any]:
        """For programs."""
        return {'ok': self.good, 'checks': [check._asdict() for check in self.checks]}


def _line(check: Check) -> str:
    sign, word = ('+', 'ok') if check.good else ('-', 'failed')
    text = '' if check.text in {'', 'ok'} else f': {check.text}'
    return f'[{sign}]{check.name} {word}{text}'


def liveness(report: Report | None, age_s: float) -> Health:
    """Bad only where starting the whole again would help."""
    routes = report.routes if report else ()
    stuck = (_of_route(told) for told in routes if told.busy_s > STUCK_S)
    return Health('livez', (_heard(age_s), *stuck, *_of_silent(report, STUCK_S)))


def readiness(report: Report | None, age_s: float, names: Sequence[str]) -> Health:
    """Whether every route does what it should, or waits for something that it need not end for.

    Args:
        report: The last one, None before the first.
        age_s: How long ago it came.
        names: Of all routes.
    """
    if report is None:
        return Health('readyz', (Check('report', good=False, text='none has come yet'),))
    silent = _of_silent(report, SILENT_S)
    checks = (_heard(age_s), *_of_bridge(report), *silent, *_of_routes(report, names))
    return Health('readyz', checks)


def _heard(age_s: float) -> Check:
    if age_s <= SILENT_S:
        return Check('report', good=True, text='ok')
    return Check('report', good=False, text=f'the supervisor has told nothing for {age_s:.0f} s')


def _of_silent(report: Report | None, most_s: float) -> Iterator[Check]:
    """Workers that stand still: what their routes do is not known, whatever was told last."""
    for worker in report.workers if report else ():
        if worker.silent_s > most_s:
            text = f'it has told nothing for {worker.silent_s:.0f} s'
            yield Check(f'worker/{worker.number}', good=False, text=text)


def _of_bridge(report: Report) -> Iterator[Check]:
    active = report.lifecycle is Lifecycle.ACTIVE
    yield Check('lifecycle', good=active, text='ok' if active else f'it is {report.lifecycle}')
    if report.stopping:
        yield Check('stopping', good=False, text='it drains to end')


def _of_routes(report: Report, names: Sequence[str]) -> Iterator[Check]:
    told = {route.snapshot.route: route for route in report.routes}
    running = {worker.number for worker in report.workers if worker.pid}
    problems = {worker.number: worker.problem for worker in report.workers}
    for name in dict.fromkeys([*told, *names]):
        route = told.get(name)
        if route is None:
            yield Check(f'route/{name}', good=False, text='nothing is known of it yet')
        elif route.worker and route.worker not in running and not route.snapshot.final:
            reason = problems.get(route.worker) or 'it does not run'
            text = f'worker {route.worker} is away: {reason}'
            yield Check(f'route/{name}', good=False, text=text)
        else:
            yield _of_route(route)


def _of_route(route: RouteReport) -> Check:
    now = route.snapshot
    if route.busy_s > STUCK_S:
        text = f'its thread has done one thing for {route.busy_s:.0f} s'
        return Check(f'route/{now.route}', good=False, text=text)
    text = f'{now.state}: {now.reason}' if now.reason else str(now.state)
    return Check(f'route/{now.route}', good=now.state in _READY, text=text)
