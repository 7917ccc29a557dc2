"""The command line of `run`: text -> the process that runs the bridge; no logic."""

import enum
from typing import Annotated

import typer

from ros2_kafka_bridge.commands.options import File
from ros2_kafka_bridge.commands.status.cli import status

RoutesOption = Annotated[
    str, typer.Option('--routes', help='Names of the routes to run, with commas; all without it.')
]


class LogFormatChoice(enum.StrEnum):
    """How a line of the log is written."""

    TEXT = 'text'
    JSON = 'json'


LogFormatOption = Annotated[
    LogFormatChoice, typer.Option(help='How a line of the log is written.')
]


def run(
    file: File,
    routes: RoutesOption = '',
    log_format: LogFormatOption = LogFormatChoice.TEXT,
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

    from ros2_kafka_bridge.process.child_process import become  # noqa: PLC0415 (--help must be quick)

    # What runs for long holds none of the libraries of a command line.
    options = [f'--log-format={log_format.value}', f'--routes={routes}']
    become('process.start', [*options, '--', str(file)])
