"""The command line of the warehouse. Nothing heavy is imported before it is needed."""

import sys
import time
import uuid
from importlib import import_module
from itertools import islice
from pathlib import Path
from random import Random
from typing import Annotated, NoReturn

import typer

from ros2_kafka_bridge.outside.extras import missing_extra
from ros2_kafka_warehouse.benchmark.cli import benchmark
from ros2_kafka_warehouse.simulate import simulate
from ros2_kafka_warehouse.validate import validate

app = typer.Typer(
    help='The warehouse: orders in Kafka, robots in ROS 2, and the bridge between them.',
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,  # its import takes longer than all the rest of --help
    pretty_exceptions_enable=False,
    context_settings={'help_option_names': ['-h', '--help']},
)

_DATA = Path(__file__).parent / 'data'
_LOCAL = 'localhost:9092'
_HIGHEST_DOMAIN = 232
_HIGHEST_PORT = 65_535
_MOST_ROBOTS = 1_000
_LONGEST_STEP_S = 3_600
_MOST_FAILURES = 36_000

SiteFile = Annotated[
    Path | None, typer.Option('--site', help='Site file.  [default: that of the package]')
]
Servers = Annotated[str, typer.Option('--bootstrap-servers', help='Kafka brokers, with commas.')]
Seed = Annotated[int, typer.Option(help='Of everything that is random.')]
Profiles = Annotated[
    Path,
    typer.Option(help='File of the execution profiles.', show_default='that of the package'),
]
Failures = Annotated[
    float,
    typer.Option(
        min=0,
        max=_MOST_FAILURES,
        help='Faults that the simulated robots show by chance.',
    ),
]
Faults = Annotated[
    list[str] | None,
    typer.Option(
        metavar='ROBOT:CODE@STEP', help='A failure of a simulated robot at a step; several times.'
    ),
]
FailureProfile = Annotated[
    Path,
    typer.Option(help='File of the robot failure profile.', show_default='that of the package'),
]


@app.command()
def run(
    *,
    site: SiteFile = None,
    robots: Annotated[
        int | None,
        typer.Option(
            min=1,
            max=_MOST_ROBOTS,
            help='So many: on a site that is made by rules, or the first ones of --site.',
        ),
    ] = None,
    step_s: Annotated[
        float | None,
        typer.Option(
            min=0.02,
            max=_LONGEST_STEP_S,
            help='Seconds of a step of the robots.',
        ),
    ] = None,
    bootstrap_servers: Annotated[
        str | None, typer.Option(help='A real Kafka.  [default: a broker inside the warehouse]')
    ] = None,
    domain: Annotated[
        int | None,
        typer.Option(min=0, max=_HIGHEST_DOMAIN, help='ROS domain.  [default: ROS_DOMAIN_ID]'),
    ] = None,
    orders_per_minute: Annotated[
        float,
        typer.Option(min=0, max=600, help='Random orders that are sent.'),
    ] = 0.0,
    host: Annotated[str, typer.Option(help='Where the page listens.')] = '127.0.0.1',
    port: Annotated[
        int, typer.Option(min=0, max=_HIGHEST_PORT, help='Of the page; 0: no page.')
    ] = 8080,
    allow_host: Annotated[
        list[str] | None,
        typer.Option(help='Another name under which browsers reach the page.'),
    ] = None,
    seed: Seed = 0,
    logs: Annotated[
        Path | None, typer.Option(help='Where the logs go, and stay.  [default: a temporary one]')
    ] = None,
    profiles: Profiles = _DATA / 'execution_profiles.yaml',
    failure_profile: FailureProfile = _DATA / 'robot_failure_profile.yaml',
    failures_per_hour: Failures = 0.0,
    fail: Faults = None,
    without: Annotated[
        list[str] | None,
        typer.Option(help='A module that is not started: you run a node of your own.'),
    ] = None,
) -> None:
    """Run the whole warehouse until Ctrl-C: broker, bridge, modules, page.

    Exit status: 0 stopped, 1 a part could not be kept running, 2 could not start.
    """
    _look_for_libraries()
    from ros2_kafka_warehouse import run as all_of_it  # noqa: PLC0415 (--help must be quick)
    from ros2_kafka_warehouse.nodes import MODULES  # noqa: PLC0415
    from ros2_kafka_warehouse.run_options import Options  # noqa: PLC0415

    for name in without or ():
        if name not in MODULES:
            _fail(f'--without {name}: there is no such module, but {", ".join(MODULES)}')
    options = Options(
        site, robots, step_s, bootstrap_servers, domain, orders_per_minute, host, port, seed,
        logs, profiles, failure_profile, failures_per_hour, tuple(without or ()),
        tuple(allow_host or ()), tuple(fail or ()),
    )  # fmt: skip
    raise typer.Exit(all_of_it.run(options))


@app.command()
def module(
    name: Annotated[str, typer.Argument(help='Of the module, such as orders.')],
    *,
    site: SiteFile = None,
    bootstrap_servers: Annotated[
        str, typer.Option(help='Kafka that orders and monitor remember by; none: they do not.')
    ] = '',
    seed: Seed = 0,
    profiles: Profiles = _DATA / 'execution_profiles.yaml',
    failure_profile: FailureProfile = _DATA / 'robot_failure_profile.yaml',
    failures_per_hour: Failures = 0.0,
    fail: Faults = None,
    alive: Annotated[
        Path | None, typer.Option(help='File that is touched as long as the module works.')
    ] = None,
) -> None:
    """Run one module as a ROS 2 node until Ctrl-C."""
    _look_for_libraries()
    from ros2_kafka_warehouse.domain.site import DEFAULT_SITE  # noqa: PLC0415 (--help must be quick)
    from ros2_kafka_warehouse.nodes import MODULES  # noqa: PLC0415

    if name not in MODULES:
        _fail(f'no module {name}: there are {", ".join(MODULES)}')

    from ros2_kafka_warehouse.nodes import process  # noqa: PLC0415 (imports ROS)
    from ros2_kafka_warehouse.nodes.node import Settings  # noqa: PLC0415

    settings = Settings(
        site or DEFAULT_SITE,
        profiles,
        failure_profile,
        bootstrap_servers,
        seed,
        failures_per_hour,
        alive,
        tuple(fail or ()),
    )
    raise typer.Exit(
        process.run(name, import_module(f'ros2_kafka_warehouse.nodes.{name}'), settings)
    )


@app.command()
def send(
    file: Annotated[
        Path | None, typer.Argument(help='Orders, one in JSON on each line.', show_default=False)
    ] = None,
    *,
    random: Annotated[int, typer.Option(min=0, help='Send so many random orders.')] = 0,
    site: SiteFile = None,
    bootstrap_servers: Servers = _LOCAL,
    seed: Annotated[int | None, typer.Option(help='Of the random orders.')] = None,
) -> None:
    """Send orders to Kafka: those of a file, or random ones."""
    if (file is None) == (random == 0):
        _fail('name a file of orders, or --random N')

    from ros2_kafka_warehouse.domain.site import DEFAULT_SITE, read_site  # noqa: PLC0415 (--help is quick)
    from ros2_kafka_warehouse.send import random_requests, read_requests, send_requests  # noqa: PLC0415

    requests = (
        list(read_requests(file))
        if file is not None
        else islice(random_requests(read_site(site or DEFAULT_SITE), Random(seed)), random)  # noqa: S311 (orders are no secret)
    )
    count = send_requests(bootstrap_servers, requests)
    typer.echo(f'{count} orders sent to warehouse.orders at {bootstrap_servers}')


@app.command()
def command(
    command: Annotated[
        str,
        typer.Argument(
            help='failRobot, repairRobot, removeRobot, rejoinRobot, blockCell, unblockCell, '
            'pause, resume or acknowledge.'
        ),
    ],
    *,
    robot: Annotated[str, typer.Option(help='Its serial number.')] = '',
    failure: Annotated[str, typer.Option(help='Code of the failure, for failRobot.')] = '',
    cell: Annotated[
        tuple[int, int] | None, typer.Option(help='Column and row, for blockCell.')
    ] = None,
    known: Annotated[
        bool, typer.Option('--known', help='Tell the robots of the blocked cell at once.')
    ] = False,
    site: SiteFile = None,
    bootstrap_servers: Servers = _LOCAL,
) -> None:
    """Send a command of an operator to the robots and their monitor.

    With --site, a robot or a cell that is not there is refused; without, it is sent all the same,
    with a hint if the site of the package does not have it.
    """
    from ros2_kafka_warehouse.domain.faults import check_code  # noqa: PLC0415 (--help must be quick)
    from ros2_kafka_warehouse.messages.monitor import OperatorCommand  # noqa: PLC0415
    from ros2_kafka_warehouse.send import send_command  # noqa: PLC0415

    if command not in _COMMANDS:
        _fail(f'no command {command}: there are {", ".join(_COMMANDS)}')
    needs = _COMMANDS[command]
    given = {'robot': robot, 'failure': failure, 'cell': cell}
    if any(not given[name] for name in needs):
        _fail(f'{command} needs {" and ".join(f"--{name}" for name in needs)}')
    if 'failure' in needs:
        check_code(failure)
    if wrong := _not_on_site(site, robot if 'robot' in needs else '', cell):
        if site is not None:
            _fail(wrong)
        typer.echo(
            f'ros2-kafka-warehouse: {wrong}: is it on yours? --site FILE would check it', err=True
        )
    name = f'cli-{uuid.uuid4().hex[:12]}'
    send_command(
        bootstrap_servers,
        OperatorCommand(name, command, robot, failure, cell, known=known, time_s=time.time()),
    )
    typer.echo(f'{command} sent to warehouse.commands at {bootstrap_servers}')


@app.command()
def benchmark_chain(
    *,
    bootstrap_servers: Annotated[
        str | None,
        typer.Option(help='A Kafka for this alone.  [default: a broker inside the warehouse]'),
    ] = None,
    robots: Annotated[int, typer.Option(min=1, help='Of the site.')] = 50,
    step_s: Annotated[
        float, typer.Option(min=0.02, max=_LONGEST_STEP_S, help='Seconds of a step.')
    ] = 0.5,
    orders: Annotated[int, typer.Option(min=1, help='Sent one after the other, first.')] = 30,
    pause_s: Annotated[float, typer.Option(min=0, help='Between these.')] = 0.5,
    json: Annotated[Path | None, typer.Option(help='Write the result there, too.')] = None,
) -> None:
    """Measure the whole chain: from an order in Kafka to a robot that moves.

    Exit status: 0 measured, 1 the warehouse did not come up or an order was not assigned.
    """
    _look_for_libraries()
    from ros2_kafka_warehouse.benchmark import chain  # noqa: PLC0415 (--help must be quick)

    raise typer.Exit(chain.run(bootstrap_servers, robots, step_s, orders, pause_s, json))


_COMMANDS = {
    'failRobot': ('robot', 'failure'),
    'repairRobot': ('robot',),
    'removeRobot': ('robot',),
    'rejoinRobot': ('robot',),
    'blockCell': ('cell',),
    'unblockCell': ('cell',),
    'pause': (),
    'resume': (),
    'acknowledge': (),
}

app.command()(simulate)
app.command()(benchmark)
app.command()(validate)


def main() -> None:
    """Run the command line."""
    try:
        app()
    except ModuleNotFoundError:
        _look_for_libraries()
        raise
    except Exception as error:
        from ros2_kafka_warehouse.mistakes import MISTAKES  # noqa: PLC0415 (heavy: only where one was made)

        if isinstance(error, MISTAKES):
            _fail(str(error))
        if isinstance(error, OSError) and error.filename is not None:
            _fail(f'{error.filename}: {error.strerror}')
        raise


def _look_for_libraries() -> None:
    """Say in a sentence what is missing: the processes below would each fail by a traceback."""
    if problem := missing_extra('warehouse'):
        _fail(problem)


def _not_on_site(path: Path | None, robot: str, cell: tuple[int, int] | None) -> str:
    """What of a command is not on the site, as a sentence, or nothing."""
    from ros2_kafka_warehouse.domain.profile_files import near_miss  # noqa: PLC0415 (--help must be quick)
    from ros2_kafka_warehouse.domain.site import DEFAULT_SITE, read_site  # noqa: PLC0415

    site = read_site(path or DEFAULT_SITE)
    where = path or 'the site of the package'
    if robot and robot not in site.robots:
        return f'no robot {robot} in {where}; {near_miss(robot, list(site.robots))}'
    if cell is not None and not site.is_on_map(cell):
        return f'no cell {cell[0]}, {cell[1]} on the map of {where}'
    return ''


def _fail(text: str) -> NoReturn:
    typer.echo(f'ros2-kafka-warehouse: {text}', err=True)
    sys.exit(2)
