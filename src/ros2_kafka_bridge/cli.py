"""The command line: text -> configuration -> the process that runs it."""

import enum
import os
import sys
from pathlib import Path
from typing import Annotated, NoReturn

import typer

from ros2_kafka_bridge import __version__, cli_dead_letters
from ros2_kafka_bridge.errors import BridgeError, ConfigError

app = typer.Typer(
    help='Moves every message between Apache Kafka and ROS 2, both ways, and loses none.',
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,  # its import takes longer than all the rest of --help
    pretty_exceptions_enable=False,
    context_settings={'help_option_names': ['-h', '--help']},
)
app.add_typer(cli_dead_letters.app, name='dead-letters')

_LOCAL = 'localhost:9092'


class LogFormat(enum.StrEnum):
    """How a line of the log is written."""

    TEXT = 'text'
    JSON = 'json'


File = Annotated[Path, typer.Argument(help='Configuration (YAML).', show_default=False)]
Names = Annotated[
    str, typer.Option('--routes', help='Names of the routes to run, with commas; all without it.')
]
Log = Annotated[LogFormat, typer.Option(help='How a line of the log is written.')]
Connect = Annotated[bool, typer.Option('--connect', help='Ask the broker and the ROS graph, too.')]
Servers = Annotated[str, typer.Option('--bootstrap-servers', help='Kafka brokers, with commas.')]


def _version(asked: bool) -> None:  # noqa: FBT001 (typer's callback)
    if asked:
        typer.echo(__version__)
        raise typer.Exit


@app.callback()
def _main(
    *,
    _version: Annotated[
        bool,
        typer.Option('--version', callback=_version, is_eager=True, help='Show the version.'),
    ] = False,
) -> None:
    pass


@app.command()
def run(file: File, routes: Names = '', log_format: Log = LogFormat.TEXT) -> None:
    """Run the bridge until SIGTERM or Ctrl-C, then drain; a second one stops at once.

    Exit status: 0 done, 1 failed while running, 2 could not start.
    """
    from ros2_kafka_bridge import shares, worker  # noqa: PLC0415 (--help must be quick)

    config = worker.load_checked(file)
    names = worker.chosen(config, routes)
    if not file.is_file():
        raise ConfigError([f'{file}: can be read only once: save it as a file, to be run'])
    more = ['--log-format', log_format.value]
    if several := shares.supervised(config, names):
        _become('supervisor', *more, *several, '--', str(file.resolve()))
    _become('worker', *more, f'--routes={routes}', '--', str(file.resolve()))


@app.command()
def check(file: File, *, connect: Connect = False) -> None:
    """Check a configuration; with --connect also what it would meet.

    Exit status: 0 all is well, 1 a route could not run as it is, 2 the file is wrong.
    """
    from ros2_kafka_bridge.worker import load_checked  # noqa: PLC0415 (--help must be quick)

    config = load_checked(file)

    from ros2_kafka_bridge.commands.check import report  # noqa: PLC0415 (heavy: only for a right file)

    raise typer.Exit(report(config, file, connect=connect))


@app.command()
def demo(
    *,
    rate: Annotated[
        float | None,
        typer.Option(help='Orders per second.  [default: 300; with --compare 1000]'),
    ] = None,
    seconds: Annotated[float, typer.Option(help='How long orders are sent.')] = 20.0,
    bootstrap_servers: Annotated[
        str | None, typer.Option(help='A real broker.  [default: one embedded in the demo]')
    ] = None,
    compare: Annotated[
        bool, typer.Option('--compare', help="Let the paper's nodes carry the same orders first.")
    ] = False,
    domain: Annotated[
        int | None, typer.Option(help='ROS domain.  [default: ROS_DOMAIN_ID, or 0]')
    ] = None,
) -> None:
    """Send random orders Kafka -> ROS -> Kafka, and count them on their way.

    Ctrl-C ends the sending and counts what was sent; a second one ends at once (130).
    Exit status: 0 the bridge lost nothing, 1 it did, or something failed, 2 could not start.
    """
    from ros2_kafka_bridge.demo import run as demonstration  # noqa: PLC0415 (heavy)

    options = demonstration.Options(rate, seconds, bootstrap_servers, compare, domain)
    raise typer.Exit(demonstration.run(options))


@app.command()
def init(
    file: Annotated[Path, typer.Argument(help='File to write.')] = Path('bridge.yaml'),
    *,
    from_graph: Annotated[
        bool, typer.Option('--from-graph', help='A route for each topic of the ROS graph.')
    ] = False,
    servers: Servers = '',
    force: Annotated[bool, typer.Option('--force', help='Overwrite a file.')] = False,
) -> None:
    """Write a commented configuration to begin with; asks nothing, overwrites nothing.

    It has the two usual routes, or with --from-graph a route for each ROS topic that is there
    now: what is published goes to Kafka, what is only subscribed to comes from Kafka. With
    --bootstrap-servers it names the topics that Kafka has already.

    Exit status: 0 written, 1 no topic was seen, 2 the file is there or cannot be written.
    """
    from ros2_kafka_bridge.commands import init as command  # noqa: PLC0415 (--help must be quick)

    brokers = servers or _LOCAL
    if from_graph:
        status = command.write_from_graph(file, brokers, ask_kafka=bool(servers), force=force)
    else:
        status = command.write_start(file, brokers, force=force)
    raise typer.Exit(status)


@app.command()
def topics(
    file: Annotated[
        Path | None,
        typer.Argument(help='Configuration (YAML): its brokers, domain and routes.'),
    ] = None,
    *,
    servers: Servers = '',
    rates: Annotated[
        float | None,
        typer.Option(
            min=0.5,
            metavar='SECONDS',
            help='Count messages for so long. Every counted ROS topic is sent here meanwhile: '
            'that is load on the network.',
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option('--json', help='For programs.')] = False,
) -> None:
    """Show the topics of both sides, and which routes and nodes would match.

    For Kafka: partitions, records held (offsets from the first to the last, more than records on
    compacted topics), rates. For ROS: types, QoS of publishers and subscribers, rates. A topic
    that a bridge publishes is not counted, because the bridge would wait for the counting.
    Without FILE: localhost:9092 and ROS_DOMAIN_ID.

    Exit status: 0 both sides were seen, 1 Kafka was not, 2 the file is wrong.
    """
    if file is not None and servers:
        raise ConfigError([f'--bootstrap-servers: {file} says them already: leave one out'])

    from ros2_kafka_bridge.worker import load_checked  # noqa: PLC0415 (--help must be quick)

    config = None if file is None else load_checked(file)

    from ros2_kafka_bridge.commands.topics import Sides, report  # noqa: PLC0415 (heavy)

    sides = Sides.without_file(servers or _LOCAL) if config is None else Sides.of(config)
    raise typer.Exit(report(sides, seconds=rates, as_json=as_json))


@app.command()
def depth(
    *,
    kafka: Annotated[
        str | None, typer.Option(metavar='TOPIC', help='Arrivals: the records of a Kafka topic.')
    ] = None,
    ros: Annotated[
        str | None, typer.Option(metavar='TOPIC', help='Arrivals: a live ROS topic.')
    ] = None,
    arrivals: Annotated[
        Path | None, typer.Option(help='Arrivals: a file, one time in nanoseconds a line.')
    ] = None,
    recording: Annotated[
        Path | None,
        typer.Option(help='Arrivals and service times: a file of ServiceTimes.'),
    ] = None,
    service: Annotated[
        str, typer.Option(metavar='TIME', help='How long the reader takes for each, as 0.8ms.')
    ] = '',
    service_file: Annotated[
        Path | None, typer.Option(help='Service times: a file of ServiceTimes, or one a line.')
    ] = None,
    wake: Annotated[
        str,
        typer.Option(metavar='TIME', help='How long an idle reader takes to begin, as 0.2ms.'),
    ] = '',
    loss: Annotated[float, typer.Option(help='Share of messages that may be lost.')] = 1e-6,
    at: Annotated[
        list[int], typer.Option('--depth', help='Show the loss at this depth, too; repeatable.')
    ] = [10, 100, 200],  # noqa: B006 (typer copies it)
    servers: Servers = '',
    partition: Annotated[
        int | None, typer.Option(help='Of the Kafka topic.  [default: all]')
    ] = None,
    last: Annotated[int, typer.Option(min=2, help='How many records of Kafka.')] = 100_000,
    seconds: Annotated[float, typer.Option(min=0.1, help='How long to listen to ROS.')] = 30.0,
    config: Annotated[
        Path | None, typer.Option(help='Configuration (YAML), for its kafka section.')
    ] = None,
    properties: Annotated[
        list[str],
        typer.Option('--property', '-X', metavar='NAME=VALUE', help='Of librdkafka; repeatable.'),
    ] = [],  # noqa: B006 (typer copies it)
    plot: Annotated[
        Path | None, typer.Option(help='Draw into this file (.png, .svg, .pdf).')
    ] = None,
    as_json: Annotated[bool, typer.Option('--json', help='For programs.')] = False,
) -> None:
    """Tell which KEEP_LAST depth a ROS reader needs for its traffic.

    Replays the arrivals through the queue of one reader, and estimates beyond what they show.
    Needs the extra: pip install 'ros2-kafka-bridge[depth]'. docs/depth.md explains it.

    Exit status: 0 a depth was found, 1 none can be recommended, 2 something is missing or wrong.
    """
    from ros2_kafka_bridge.commands import depth as command  # noqa: PLC0415 (--help must be quick)

    of_kafka = kafka and command.Kafka(kafka, servers, partition, last, config, properties)
    of_ros = ros and command.Ros(ros, seconds)
    asked = command.Asked(
        kafka=of_kafka or None,
        ros=of_ros or None,
        arrivals=arrivals,
        recording=recording,
        service=service,
        service_file=service_file,
        wake=wake,
        loss=loss,
        depths=at,
        plot=plot,
        as_json=as_json,
    )
    raise typer.Exit(command.report(asked))


@app.command()
def spool(
    path: Annotated[
        Path,
        typer.Argument(
            help='Configuration (YAML), a spool, or a directory of them.', show_default=False
        ),
    ],
    *,
    messages: Annotated[
        int, typer.Option(min=0, metavar='N', help='Show the first N messages of each.')
    ] = 0,
    values: Annotated[
        bool, typer.Option('--values', help='With the beginning of their values.')
    ] = False,
    as_json: Annotated[bool, typer.Option('--json', help='For programs.')] = False,
) -> None:
    """Show what waits on disk for Kafka; touches nothing, also while a bridge runs.

    Exit status: 0 all is well, also where nothing is there, 1 a spool is damaged, 2 something
    cannot be read or is no spool.
    """
    from ros2_kafka_bridge.commands import spool as command  # noqa: PLC0415 (--help must be quick)

    raise typer.Exit(command.report(path, command.Asked(messages, values, as_json)))


def main() -> None:
    """Run the command line; a mistake of the user ends with its sentences, not a traceback."""
    try:
        app()
    except BridgeError as error:  # only the start raises one: a route keeps its own
        typer.echo(str(error), err=True)
        sys.exit(2)


def _become(module: str, *arguments: str) -> NoReturn:
    """Replace this process, so that what runs for long holds none of this one's libraries.

    What is asked for on the way by a signal is kept for the program that takes over.
    """
    import signal  # noqa: PLC0415 (only here)

    from ros2_kafka_bridge.stop import SIGNALS  # noqa: PLC0415

    sys.stdout.flush()
    sys.stderr.flush()
    signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    # -P: a directory that happens to be the current one is not searched for modules.
    program = [sys.executable, '-P', '-m', f'ros2_kafka_bridge.{module}']
    os.execv(sys.executable, [*program, *arguments])  # noqa: S606 (no shell is wanted)
