"""`ros2-kafka-warehouse simulate`: the whole warehouse, as fast as it can be computed."""

from pathlib import Path
from typing import Annotated

import typer

# A limit also keeps out `inf` and `nan`, with which a simulation would not end.
_MOST_AN_HOUR = 36_000
_MOST_STEPS = 100_000_000
_MOST_ORDERS = 1_000_000
_MOST_ROBOTS = 1_000
_MOST_S = 1e6


def simulate(
    site: Annotated[
        Path | None, typer.Option(help='Site file; the one that comes along if not given.')
    ] = None,
    robots: Annotated[
        int,
        typer.Option(
            min=0,
            max=_MOST_ROBOTS,
            help='So many: on a site that is made by rules, or the first ones of --site.',
        ),
    ] = 0,
    steps: Annotated[
        int, typer.Option(min=1, max=_MOST_STEPS, help='Steps to take, at most.')
    ] = 7200,
    orders: Annotated[
        int,
        typer.Option(
            min=0,
            max=_MOST_ORDERS,
            help='Send so many, and stop when all have ended; 0: no end.',
        ),
    ] = 0,
    orders_per_hour: Annotated[
        float,
        typer.Option(
            min=0,
            max=_MOST_AN_HOUR,
            help='Orders that come by chance, on average.',
        ),
    ] = 120.0,
    failures_per_hour: Annotated[
        float,
        typer.Option(
            min=0,
            max=_MOST_AN_HOUR,
            help='Failures of the whole fleet by chance, on average.',
        ),
    ] = 0.0,
    fail: Annotated[
        list[str] | None,
        typer.Option(metavar='ROBOT:CODE@STEP', help='A failure at a step; several times.'),
    ] = None,
    repair_s: Annotated[
        float,
        typer.Option(
            min=0,
            max=_MOST_S,
            help='Seconds until a robot is repaired; 0: never.',
        ),
    ] = 120.0,
    lateness: Annotated[
        float,
        typer.Option(min=0, max=0.9, help='Share of turns that a module takes too late.'),
    ] = 0.0,
    seed: Annotated[int, typer.Option(help='The same seed gives the same run.')] = 0,
    trace: Annotated[
        Path | None, typer.Option(help='Write each step, with its events, as a line of JSON.')
    ] = None,
    json: Annotated[Path | None, typer.Option(help='Write the result as JSON.')] = None,
) -> None:
    """Simulate the warehouse: every module, every rule checked, no ROS and no Kafka.

    Exit status 1: a rule was broken, or an order lost or doubled.
    """
    from ros2_kafka_warehouse import simulation_run  # noqa: PLC0415 (--help must be quick)

    wish = simulation_run.Wish(
        site, robots, seed, orders_per_hour, orders, failures_per_hour, repair_s, lateness,
        tuple(fail or ()),
    )  # fmt: skip
    if not simulation_run.run(wish, steps, trace, json):
        raise typer.Exit(1)
