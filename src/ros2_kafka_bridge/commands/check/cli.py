"""The command line of `check`: text -> what is asked; no logic."""

from typing import Annotated

import typer

from ros2_kafka_bridge.commands.options import File

Connect = Annotated[bool, typer.Option('--connect', help='Ask the broker and the ROS graph, too.')]


def check(file: File, *, connect: Connect = False) -> None:
    """Check a configuration; with --connect also what it would meet.

    Exit status: 0 all is well, 1 a route could not run as it is, 2 the file is wrong.
    """
    from ros2_kafka_bridge.process.load import load_checked  # noqa: PLC0415 (--help must be quick)

    config = load_checked(file)

    from ros2_kafka_bridge.commands.check.report import report  # noqa: PLC0415 (heavy: only for a right file)

    raise typer.Exit(report(config, file, connect=connect))
