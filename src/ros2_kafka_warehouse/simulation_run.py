"""Runs a simulation for a person: from what was wished to a table of key figures."""

from contextlib import nullcontext
from pathlib import Path
from time import perf_counter
from typing import NamedTuple

import msgspec
import typer
from rich.console import Console
from rich.table import Table

from ros2_kafka_warehouse.domain.execution_profiles import read_execution_profiles
from ros2_kafka_warehouse.domain.faults import FaultPlan, read_fault
from ros2_kafka_warehouse.domain.kpis import KpiView
from ros2_kafka_warehouse.domain.order_plan import OrderPlan
from ros2_kafka_warehouse.domain.robot_failure_profile import read_failure_profile
from ros2_kafka_warehouse.domain.simulation import Simulation
from ros2_kafka_warehouse.domain.simulation_result import Result
from ros2_kafka_warehouse.domain.site import check_robot_types, choose_site

WRONG_SHOWN = 10


class Wish(NamedTuple):
    """What is to be simulated; see the options of `ros2-kafka-warehouse simulate`."""

    site: Path | None = None
    robots: int = 0
    seed: int = 0
    orders_per_hour: float = 120.0
    orders: int = 0
    failures_per_hour: float = 0.0
    repair_s: float = 120.0
    lateness: float = 0.0
    faults: tuple[str, ...] = ()


def run(wish: Wish, steps: int, trace: Path | None = None, json: Path | None = None) -> bool:
    """Simulate so many steps at most, and print the key figures.

    Returns:
        Whether no rule was broken and no order lost or doubled.
    """
    simulation = world(wish)
    began_s = perf_counter()
    with trace.open('wb') if trace is not None else nullcontext() as file:

        def write(simulation: Simulation) -> None:
            if file is not None:
                file.write(simulation.line() + b'\n')

        result = simulation.run(steps, until_done=wish.orders > 0, each=write if file else None)
    took_s = perf_counter() - began_s
    if json is not None:
        json.write_bytes(_as_json(result))
    Console().print(_table(result, simulation, took_s))
    if not result.is_right:
        _say_what_is_wrong(result)
    return result.is_right


def world(wish: Wish) -> Simulation:
    """The simulation that was wished."""
    try:
        site = choose_site(wish.site, wish.robots or None, wish.seed)
        profiles = read_execution_profiles()
        check_robot_types(site, list(profiles.robot_types), wish.site)
        failure_profile = read_failure_profile()
        schedule = tuple(read_fault(text, site.robots) for text in wish.faults)
    except ValueError as error:
        typer.echo(str(error), err=True)
        raise typer.Exit(2) from None
    steps_per_hour = 3600 / site.step_s
    mean_steps = 0.0
    if wish.failures_per_hour:
        mean_steps = len(site.robots) * steps_per_hour / wish.failures_per_hour
    return Simulation(
        site,
        profiles,
        failure_profile,
        seed=wish.seed,
        orders=OrderPlan(wish.orders_per_hour, wish.orders),
        faults=FaultPlan(mean_steps, schedule),
        repair_s=wish.repair_s or None,
        lateness=wish.lateness,
    )


def _as_json(result: Result) -> bytes:
    text: dict[str, object] = {**result._asdict(), 'right': result.is_right}
    return msgspec.json.format(msgspec.json.encode(text), indent=2) + b'\n'


def _table(result: Result, world: Simulation, took_s: float) -> Table:
    hours = result.now_s / 3600
    table = Table(title=f'{world.site.name}: {hours:.2f} hours, {len(world.site.robots)} robots')
    table.add_column('')
    table.add_column('', justify='right')
    for name, value in _rows(result, result.kpis):
        table.add_row(name, value)
    table.add_row('steps a second', f'{result.steps / max(took_s, 1e-9):,.0f}')
    return table


def _rows(result: Result, kpis: KpiView) -> list[tuple[str, str]]:
    return [
        ('orders sent, delivered', f'{result.sent}, {kpis.delivered}'),
        (
            'partial, failed, cancelled, still open',
            f'{kpis.partial}, {kpis.failed}, {kpis.cancelled}, {len(result.open)}',
        ),
        ('orders an hour', _number(kpis.orders_per_hour)),
        ('lines an hour', _number(kpis.tasks_per_hour)),
        ('on time', _percent(kpis.on_time)),
        ('late on average', _number(kpis.mean_late_s, ' s')),
        ('cycle time, mean', _number(kpis.cycle_mean_s, ' s')),
        ('cycle time, 95th percentile', _number(kpis.cycle_p95_s, ' s')),
        *((f'robots {name}', _percent(share)) for name, share in kpis.shares.items()),
        ('failures', str(kpis.failures)),
        ('from failure to another robot', _number(kpis.hand_over_s, ' s')),
        ('between failures (MTBF)', _number(kpis.mtbf_s, ' s')),
        ('until repaired (MTTR)', _number(kpis.mttr_s, ' s')),
        ('availability', _percent(kpis.availability)),
        ('robots without progress', str(kpis.deadlocks)),
        ('orders lost, doubled', f'{len(result.lost)}, {len(result.doubled)}'),
        ('rules broken', str(len(result.violations))),
        ('steps checked', f'{result.steps:,}'),
    ]


def _number(value: float | None, unit: str = '') -> str:
    return '-' if value is None else f'{value:,.1f}{unit}'


def _percent(share: float | None) -> str:
    return '-' if share is None else f'{100 * share:.1f} %'


def _say_what_is_wrong(result: Result) -> None:
    for violation in result.violations[:WRONG_SHOWN]:
        typer.echo(f'step {violation.step}: {violation.rule}: {violation.description}', err=True)
    for name, ids in (('lost', result.lost), ('ended twice', result.doubled)):
        if ids:
            typer.echo(f'{name}: {", ".join(ids[:WRONG_SHOWN])}', err=True)
