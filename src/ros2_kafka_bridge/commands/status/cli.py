"""The command line of `status`: text -> what is asked; no logic."""

from typing import NoReturn

import typer

from ros2_kafka_bridge.commands.options import AsJson, File


def status(file: File, *, as_json: AsJson = False) -> NoReturn:
    """Ask the running bridge of FILE how it is doing; needs monitoring.listen in it.

    Exit status: 0 ready, 1 not ready, 2 it does not answer, or the file is wrong.
    """
    from ros2_kafka_bridge.commands.status.report import report  # noqa: PLC0415 (--help must be quick)
    from ros2_kafka_bridge.process.load import load_checked  # noqa: PLC0415

    raise typer.Exit(report(load_checked(file, with_ros=False), file, as_json=as_json))
