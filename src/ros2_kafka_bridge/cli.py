"""The command line: text -> configuration -> the process that runs it."""

import enum
import sys
from pathlib import Path
from typing import Annotated, NoReturn

import typer

from ros2_kafka_bridge import __version__, cli_dead_letters, cli_depth
from ros2_kafka_bridge.cli_options import AsJson, Servers
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


class SchemaFormat(enum.StrEnum):
    """A format that has a schema."""

    JSON = 'json'
    AVRO = 'avro'
    PROTOBUF = 'protobuf'


File = Annotated[Path, typer.Argument(help='Configuration (YAML).', show_default=False)]
Names = Annotated[
    str, typer.Option('--routes', help='Names of the routes to run, with commas; all without it.')
]
Log = Annotated[LogFormat, typer.Option(help='How a line of the log is written.')]
Connect = Annotated[bool, typer.Option('--connect', help='Ask the broker and the ROS graph, too.')]


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
def run(
    file: File,
    routes: Names = '',
    log_format: Log = LogFormat.TEXT,
    *,
    ask: Annotated[
        bool, typer.Option('--status', help='Ask the bridge that runs, as the command status.')
    ] = False,
) -> None:
    """Run the bridge until SIGTERM or Ctrl-C, then drain; a second one stops at once.

    Exit status: 0 done, 1 failed while running, 2 could not start.
    """
    if ask:
        status(file)

    from ros2_kafka_bridge.supervision.child import become  # noqa: PLC0415 (--help must be quick)

    # What runs for long holds none of the libraries of a command line.
    options = [f'--log-format={log_format.value}', f'--routes={routes}']
    become('worker', [*options, '--', str(file)])


@app.command()
def status(file: File, *, as_json: AsJson = False) -> NoReturn:
    """Ask the running bridge of FILE how it is doing; needs monitoring.listen in it.

    Exit status: 0 ready, 1 not ready, 2 it does not answer, or the file is wrong.
    """
    from ros2_kafka_bridge.commands.status import report  # noqa: PLC0415 (--help must be quick)
    from ros2_kafka_bridge.worker import load_checked  # noqa: PLC0415

    raise typer.Exit(report(load_checked(file, with_ros=False), file, as_json=as_json))


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
    as_json: AsJson = False,
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


app.command()(cli_depth.depth)


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
    as_json: AsJson = False,
) -> None:
    """Show what waits on disk for Kafka; touches nothing, also while a bridge runs.

    Exit status: 0 all is well, also where nothing is there, 1 a spool is damaged, 2 something
    cannot be read or is no spool.
    """
    from ros2_kafka_bridge.commands import spool as command  # noqa: PLC0415 (--help must be quick)

    raise typer.Exit(command.report(path, command.Asked(messages, values, as_json)))


@app.command()
def schema(
    message_type: Annotated[
        str,
        typer.Argument(metavar='TYPE', help='Message type, as std_msgs/msg/String.'),
    ] = '',
    *,
    schema_format: Annotated[
        SchemaFormat | None, typer.Option('--format', help="Without it the route's.")
    ] = None,
    message_path: Annotated[
        list[Path],
        typer.Option(metavar='DIR', help='Folder of .msg files; repeatable.'),
    ] = [],  # noqa: B006 (typer copies it)
    config: Annotated[
        Path | None, typer.Option(help='Configuration (YAML): its ros.message_path and routes.')
    ] = None,
    route: Annotated[
        str, typer.Option(help='Its type, its format and the settings of that.')
    ] = '',
    output: Annotated[
        Path | None,
        typer.Option(metavar='DIR', help='Write files into this folder instead of printing.'),
    ] = None,
) -> None:
    """Print the schema of a message type: JSON Schema, an Avro schema, or .proto files.

    It is what a route with that format uses and registers, with the comments of the message
    definition. Neither Kafka nor a Schema Registry is asked, and no ROS is loaded.

    Exit status: 0 printed, 2 there is no such type, route or schema.
    """
    from ros2_kafka_bridge.commands import schema as command  # noqa: PLC0415 (--help must be quick)
    from ros2_kafka_bridge.worker import load_checked  # noqa: PLC0415

    asked = command.Asked(
        message_type,
        schema_format.value if schema_format else '',
        message_path,
        None if config is None else load_checked(config, with_ros=False),
        route,
        output,
    )
    raise typer.Exit(command.report(asked))


def main() -> None:
    """Run the command line; a mistake of the user ends with its sentences, not a traceback."""
    try:
        app()
    except BridgeError as error:  # only the start raises one: a route keeps its own
        typer.echo(str(error), err=True)
        sys.exit(2)
