"""`ros2-kafka-warehouse benchmark`: the command line of the benchmark."""

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer

if TYPE_CHECKING:
    from ros2_kafka_warehouse.benchmark.instances import Instance
    from ros2_kafka_warehouse.benchmark.runner import Crash

ROBOTS = (10, 50)
FREQUENCIES = (0.2, 1.0, 2.0, 10.0)


def benchmark(
    *,
    map_file: Annotated[
        Path | None,
        typer.Option('--map', help='MAPD or MovingAI map.  [default: a small warehouse is made]'),
    ] = None,
    task_file: Annotated[
        Path | None, typer.Option('--tasks', help='MAPD tasks.  [default: tasks are made]')
    ] = None,
    scene_file: Annotated[
        Path | None, typer.Option('--scen', help='MovingAI scenario, whose trips are the tasks.')
    ] = None,
    generate: Annotated[
        bool, typer.Option('--generate', help='Make the instance, which is the default.')
    ] = False,
    robots: Annotated[
        list[int] | None,
        typer.Option(min=1, help='Robots; several times: several runs.  [default: 10 and 50]'),
    ] = None,
    frequency: Annotated[
        list[float] | None,
        typer.Option(help='Tasks released a step; several times.  [default: 0.2, 1, 2, 10]'),
    ] = None,
    seed: Annotated[int, typer.Option(help='Of the instance and of the planner.')] = 0,
    seeds: Annotated[int, typer.Option(min=1, help='So many runs, each with the next seed.')] = 1,
    crash: Annotated[
        list[str] | None,
        typer.Option(metavar='ROBOT@STEP', help='A robot that fails for good; several times.'),
    ] = None,
    lifelong: Annotated[
        int,
        typer.Option(
            min=0,
            help='Instead of tasks: random goals for so many steps, on the map or a large one.',
        ),
    ] = 0,
    trace: Annotated[
        Path | None, typer.Option(help='Where the trace of the run goes, as JSON lines.')
    ] = None,
    json_file: Annotated[
        Path | None, typer.Option('--json', help='Where the results go, as JSON.')
    ] = None,
) -> None:
    """Measure allocation and planning on instances of pickup and delivery.

    Exit status: 0 all was done that could be done, and no rule was broken; 1 not so; 2 could not
    start.
    """
    from rich.console import Console  # noqa: PLC0415 (--help must be quick)

    from ros2_kafka_warehouse.benchmark.instances import InstanceError  # noqa: PLC0415
    from ros2_kafka_warehouse.domain.maps import MapError  # noqa: PLC0415

    if generate and map_file is not None:
        _fail('--generate makes a map: leave out --map, or --generate')
    if map_file is None and (task_file is not None or scene_file is not None):
        _fail('--tasks and --scen belong to a map: name it by --map')
    if task_file is not None and scene_file is not None:
        _fail('name --tasks or --scen, not both')
    crashes = [_crash(text) for text in crash or ()]
    # A table that is cut off in a file helps nobody.
    console = Console(width=None if sys.stdout.isatty() else 120)
    try:
        if lifelong:
            results, table, good = _measure_throughput(map_file, robots, lifelong, seed, trace)
        else:
            instances = [
                instance
                for run_seed in range(seed, seed + seeds)
                for instance in _instances(
                    (map_file, task_file, scene_file), robots, frequency, run_seed
                )
            ]
            results, table, good = _measure(instances, crashes, seed, trace)
    except (InstanceError, MapError) as error:
        _fail(str(error))
    console.print(table)
    for result in results:
        _print_faults(console, result)
    if json_file is not None:
        json_file.write_text(json.dumps(results, indent=2) + '\n', encoding='utf-8')
    raise typer.Exit(0 if good else 1)


def _instances(
    files: tuple[Path | None, Path | None, Path | None],
    robots: list[int] | None,
    frequencies: list[float] | None,
    seed: int,
) -> 'list[Instance]':
    from ros2_kafka_warehouse.benchmark import instances  # noqa: PLC0415 (--help must be quick)

    map_file, task_file, scene_file = files
    if map_file is None:
        return [
            instances.generate(number, frequency, seed)
            for number in robots or ROBOTS
            for frequency in frequencies or FREQUENCIES
        ]
    if scene_file is not None:
        return [
            instances.read_scene(map_file, scene_file, number, frequency)
            for number in robots or ROBOTS[:1]
            for frequency in frequencies or (1.0,)
        ]
    several = (1.0,) if task_file is not None else frequencies or FREQUENCIES
    return [
        instances.read(map_file, task_file, number, frequency, seed)
        for number in robots or (None,)
        for frequency in several
    ]


def _measure(
    instances: 'list[Instance]', crashes: 'list[Crash]', seed: int, trace: Path | None
) -> tuple[list[dict[str, Any]], Any, bool]:
    from ros2_kafka_warehouse.benchmark import report  # noqa: PLC0415 (--help must be quick)
    from ros2_kafka_warehouse.benchmark.runner import run  # noqa: PLC0415

    if trace is not None and len(instances) > 1:
        _fail('--trace is for one run: name one --robots and one --frequency')
    last = min(len(instance.starts) for instance in instances) - 1
    for crash in crashes:
        if crash.robot > last:
            _fail(f'there is no robot {crash.robot}: the robots are 0 to {last}')
    reports = [
        report.validate(run(instance, crashes, seed + number, trace))
        for number, instance in enumerate(instances)
    ]
    results = [report.as_json(one) for one in reports]
    return results, report.as_table(results), all(one.is_good for one in reports)


def _measure_throughput(
    map_file: Path | None, robots: list[int] | None, steps: int, seed: int, trace: Path | None
) -> tuple[list[dict[str, Any]], Any, bool]:
    from ros2_kafka_warehouse.benchmark import report  # noqa: PLC0415 (--help must be quick)
    from ros2_kafka_warehouse.benchmark.instances import large_warehouse  # noqa: PLC0415
    from ros2_kafka_warehouse.benchmark.runner import run_for_ever  # noqa: PLC0415
    from ros2_kafka_warehouse.domain.maps import read_map  # noqa: PLC0415

    numbers = robots or [60, 100, 140]
    if trace is not None and len(numbers) > 1:
        _fail('--trace is for one run: name one --robots')
    rows = large_warehouse() if map_file is None else read_map(map_file).rows
    results = []
    for number in numbers:
        throughput = run_for_ever(rows, number, steps, seed)
        if trace is not None:
            trace.write_text(''.join(f'{row}\n' for row in throughput.trace), encoding='utf-8')
        violations = report.validate_moves(throughput)
        results.append(report.throughput_as_json(throughput, violations))
    good = not any(result['violations'] for result in results)
    return results, report.throughput_table(results), good


def _print_faults(console: Any, result: dict[str, Any]) -> None:
    for job, why in result.get('unreachable', {}).items():
        console.print(f'Task {job} is not done: {why}.')
    if result.get('left'):
        console.print(f'[red]Not done, though it could be: {result["left"]}[/]')
    for text in result['violations'][:10]:
        console.print(f'[red]{text}[/]')


def _crash(text: str) -> 'Crash':
    from ros2_kafka_warehouse.benchmark.runner import Crash  # noqa: PLC0415 (--help must be quick)

    robot, found, step = text.partition('@')
    if not found or not robot.isdigit() or not step.isdigit():
        _fail(f'--crash must be ROBOT@STEP, such as 3@120, not `{text}`')
    return Crash(int(robot), int(step))


def _fail(what: str) -> NoReturn:
    typer.echo(f'Error: {what}.', err=True)
    raise typer.Exit(2)
