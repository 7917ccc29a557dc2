"""The results of the benchmark as a table and as JSON, each run judged by the validator."""

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.table import Table

from ros2_kafka_warehouse.benchmark.runner import Outcome, Throughput
from ros2_kafka_warehouse.domain.trace_check import validate_trace
from ros2_kafka_warehouse.messages.onlookers import Violation


class Published(NamedTuple):
    """Mean service times of Xu et al., IROS 2022, Table II."""

    central: float
    lns_pbs: float


PUBLISHED: Final = {
    (0.2, 10): Published(29.77, 27.92),
    (0.2, 50): Published(25.05, 24.09),
    (1.0, 10): Published(285.75, 273.48),
    (1.0, 50): Published(27.38, 24.42),
    (2.0, 10): Published(388.21, 361.59),
    (2.0, 50): Published(41.43, 30.46),
    (10.0, 10): Published(478.17, 438.71),
    (10.0, 50): Published(106.70, 88.75),
}


class Report(NamedTuple):
    """A run and what the validator says of its trace."""

    outcome: Outcome
    violations: tuple[Violation, ...]

    @property
    def is_good(self) -> bool:
        """Whether no rule was broken and all was done that could be done."""
        return not self.violations and not self.outcome.left


def validate(outcome: Outcome) -> Report:
    """Have a run judged by the validator, which shares no code with the planner."""
    instance = outcome.instance
    violations = validate_trace(
        instance.rows,
        instance.jobs,
        outcome.trace,
        crashed={str(crash.robot): crash.step for crash in outcome.crashes},
        unreachable=tuple(outcome.undone),
    )
    return Report(outcome, violations)


def validate_moves(throughput: Throughput) -> tuple[Violation, ...]:
    """Have the moves of a run without tasks judged."""
    return validate_trace(throughput.rows, None, throughput.trace)


def published(outcome: Outcome) -> Published | None:
    """What is published for an instance of this kind."""
    instance = outcome.instance
    if not instance.standard or instance.frequency is None or outcome.crashes:
        return None
    return PUBLISHED.get((instance.frequency, len(instance.starts)))


def as_json(report: Report) -> dict[str, Any]:
    """All figures of a run."""
    outcome = report.outcome
    service = outcome.service or [0]
    known = published(outcome)
    result: dict[str, Any] = {
        'instance': outcome.instance.name,
        'robots': len(outcome.instance.starts),
        'frequency': outcome.instance.frequency,
        'tasks': len(outcome.instance.jobs),
        'crashes': [crash._asdict() for crash in outcome.crashes],
        'delivered': len(outcome.delivered),
        'unreachable': {str(job): why for job, why in sorted(outcome.undone.items())},
        'left': list(outcome.left),
        'service_mean': round(float(np.mean(service)), 2),
        'service_p95': round(float(np.percentile(service, 95)), 1),
        'service_max': max(service),
        'makespan': outcome.makespan,
        'throughput': round(len(outcome.delivered) / max(1, outcome.makespan), 3),
        'planner_ms': planner_figures(outcome.planner_ms),
        'violations': [violation_text(violation) for violation in report.violations],
    }
    if known is not None:
        mean = result['service_mean']
        result['published'] = {
            'central': known.central,
            'lns_pbs': known.lns_pbs,
            'to_central': round(mean / known.central, 3),
            'to_lns_pbs': round(mean / known.lns_pbs, 3),
        }
    return result


def as_table(results: Sequence[dict[str, Any]]) -> Table:
    """The figures of all runs, one a row."""
    names = dict.fromkeys(result['instance'] for result in results)
    title = (
        'Pickup and delivery' if len(names) > 1 else f'Pickup and delivery, {next(iter(names))}'
    )
    table = Table(title=title, box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    if len(names) > 1:
        table.add_column('\ninstance', no_wrap=True)
    for name in (
        'robots', 'tasks\na step', '\ndone', 'service\nmean', '\np95', '\nmax', 'to\nCENTRAL',
        'to\nLNS-PBS', 'make-\nspan', 'done\na step', 'planner\nms mean', '\n99th', '\nmax',
        'rules\nbroken',
    ):  # fmt: skip
        table.add_column(name, justify='right')
    for result in results:
        row = _cells(result)
        table.add_row(*([result['instance']] if len(names) > 1 else []), *row)
    return table


def _cells(result: dict[str, Any]) -> list[str]:
    known = result.get('published', {})
    done = f'{result["delivered"]}/{result["tasks"]}'
    frequency = result['frequency']
    times = result['planner_ms']
    return [
        str(result['robots']),
        '' if frequency is None else f'{frequency:g}',
        done,
        f'{result["service_mean"]:.2f}',
        f'{result["service_p95"]:.0f}',
        str(result['service_max']),
        f'{known["to_central"]:.3f}' if known else '',
        f'{known["to_lns_pbs"]:.3f}' if known else '',
        str(result['makespan']),
        f'{result["throughput"]:.2f}',
        f'{times["mean"]:.2f}',
        f'{times["p99"]:.2f}',
        f'{times["max"]:.1f}',
        str(len(result['violations'])),
    ]


def throughput_as_json(throughput: Throughput, violations: Sequence[Violation]) -> dict[str, Any]:
    """The figures of a run without tasks."""
    return {
        'robots': throughput.robots,
        'steps': len(throughput.planner_ms),
        'goals_a_step': round(throughput.goals_a_step, 3),
        'planner_ms': planner_figures(throughput.planner_ms),
        'violations': [violation_text(violation) for violation in violations],
    }


def throughput_table(results: Sequence[dict[str, Any]]) -> Table:
    """The figures of runs without tasks, one a row."""
    table = Table(title='Random goals one after the other')
    for name in ('robots', 'steps', 'goals a step', 'ms mean', 'ms 99th', 'ms max', 'violations'):
        table.add_column(name, justify='right')
    for result in results:
        times = result['planner_ms']
        table.add_row(
            str(result['robots']),
            str(result['steps']),
            f'{result["goals_a_step"]:.2f}',
            f'{times["mean"]:.2f}',
            f'{times["p99"]:.2f}',
            f'{times["max"]:.1f}',
            str(len(result['violations'])),
        )
    return table


def planner_figures(milliseconds: Sequence[float]) -> dict[str, float]:
    """Mean, 99th percentile and maximum."""
    times = np.array(milliseconds or [0.0])
    return {
        'mean': round(float(times.mean()), 3),
        'p99': round(float(np.percentile(times, 99)), 3),
        'max': round(float(times.max()), 3),
    }


def violation_text(violation: Violation) -> str:
    """A violation in one line."""
    return f'step {violation.step}: {violation.rule}: {violation.description}'
