"""`ros2-kafka-warehouse validate`: judges a trace of steps by the rules of the floor alone."""

import sys
from pathlib import Path
from typing import Annotated, NoReturn

import typer

SHOWN = 20

File = Annotated[Path, typer.Argument(help='Trace, a step in JSON on each line.')]


def validate(
    trace: File,
    *,
    map_file: Annotated[
        Path | None,
        typer.Option('--map', help='MAPD or MovingAI map.  [default: that of the site]'),
    ] = None,
    task_file: Annotated[
        Path | None,
        typer.Option('--tasks', help='MAPD tasks.  [default: only the moves are judged]'),
    ] = None,
    site: Annotated[
        Path | None, typer.Option(help='Site file.  [default: that of the package]')
    ] = None,
) -> None:
    """Judge a trace: no collision, no wall, no jump; with tasks also what became of the loads.

    Exit status: 0 no rule was broken, 1 one was, 2 a file cannot be read.
    """
    from ros2_kafka_warehouse.domain.maps import MapError, read_map, read_tasks  # noqa: PLC0415 (--help)
    from ros2_kafka_warehouse.domain.site import DEFAULT_SITE, SiteError, read_site  # noqa: PLC0415
    from ros2_kafka_warehouse.domain.trace_check import TraceError, validate_trace  # noqa: PLC0415

    if task_file is not None and map_file is None:
        _fail('--tasks needs --map: the tasks name the endpoints of that map')
    try:
        tasks = None
        if map_file is None:
            rows = read_site(site or DEFAULT_SITE).rows
        else:
            floor = read_map(map_file)
            rows = floor.rows
            if task_file is not None:
                jobs = read_tasks(task_file, floor.endpoints)
                tasks = [(job.release, job.pickup, job.delivery) for job in jobs]
        with trace.open(encoding='utf-8') as lines:
            found = validate_trace(rows, tasks, lines)
    except (MapError, SiteError) as error:
        _fail(str(error))
    except (OSError, UnicodeDecodeError, TraceError) as error:
        _fail(f'{trace}: {error}')
    for violation in found[:SHOWN]:
        typer.echo(f'step {violation.step}: {violation.rule}: {violation.description}')
    if len(found) > SHOWN:
        typer.echo(f'and {len(found) - SHOWN} more')
    typer.echo(f'{trace}: {len(found)} violations')
    if found:
        raise typer.Exit(1)


def _fail(text: str) -> NoReturn:
    typer.echo(f'ros2-kafka-warehouse: {text}', err=True)
    sys.exit(2)
