"""The command line of `spool`: text -> what is asked; no logic."""

from pathlib import Path
from typing import Annotated

import typer

from ros2_kafka_bridge.commands.options import AsJson


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

    Exit status: 0 all is well, also where nothing is there, 1 a spool is damaged, or gone with
    messages in it, 2 something cannot be read or is no spool.
    """
    from ros2_kafka_bridge.commands.spool import report as command  # noqa: PLC0415 (--help must be quick)

    raise typer.Exit(command.report(path, command.SpoolOptions(messages, values, as_json)))
