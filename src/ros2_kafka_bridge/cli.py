"""The command line: text -> configuration -> Bridge."""

import enum
import gc
import os
import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ros2_kafka_bridge import __version__
from ros2_kafka_bridge.errors import BridgeError, ConfigError

if TYPE_CHECKING:
    from ros2_kafka_bridge.config.settings import Config

app = typer.Typer(
    help='Moves every message between Apache Kafka and ROS 2, both ways, and loses none.',
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,  # its import takes longer than all the rest of --help
    pretty_exceptions_enable=False,
    context_settings={'help_option_names': ['-h', '--help']},
)


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
    config = _load(file)
    chosen = _chosen(config, routes)

    from ros2_kafka_bridge import logs  # noqa: PLC0415 (heavy: --help must be quick)
    from ros2_kafka_bridge.bridge import Bridge  # noqa: PLC0415

    logs.set_up(log_format.value)
    bridge = Bridge(config, chosen)

    def on_signal(_number: int, _frame: Any) -> None:
        bridge.stop.ask()

    # The windows hold thousands of live entries: by default they are walked all the time.
    gc.freeze()
    gc.set_threshold(50_000, 20, 100)
    signal.signal(signal.SIGTERM, on_signal)
    signal.signal(signal.SIGINT, on_signal)
    raise typer.Exit(bridge.run())


@app.command()
def check(file: File, *, connect: Connect = False) -> None:
    """Check a configuration; with --connect also what it would meet.

    Exit status: 0 all is well, 1 a route could not run as it is, 2 the file is wrong.
    """
    config = _load(file)

    from ros2_kafka_bridge.check import report  # noqa: PLC0415 (heavy: --help must be quick)

    raise typer.Exit(report(config, file, connect=connect))


def main() -> None:
    """Run the command line; a mistake of the user ends with its sentences, not a traceback."""
    try:
        app()
    except BridgeError as error:  # only the start raises one: a route keeps its own
        typer.echo(str(error), err=True)
        sys.exit(2)


def _load(file: Path) -> 'Config':
    from ros2_kafka_bridge.config.file import load  # noqa: PLC0415 (heavy)
    from ros2_kafka_bridge.kafka.properties import property_problems  # noqa: PLC0415
    from ros2_kafka_bridge.ros.types import unknown_type  # noqa: PLC0415

    return load(file, os.environ, check_type=unknown_type, check_kafka=property_problems)


def _chosen(config: 'Config', routes: str) -> frozenset[str] | None:
    if not routes:
        return None
    chosen = frozenset(name.strip() for name in routes.split(','))
    known = {route.name for route in config.routes}
    if unknown := sorted(chosen - known):
        raise ConfigError(
            [
                f'--routes: no route {name}, there are {", ".join(sorted(known))}'
                for name in unknown
            ]
        )
    return chosen
