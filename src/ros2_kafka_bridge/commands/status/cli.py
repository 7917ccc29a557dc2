"""The command line of `status`: text -> what is asked; no logic."""

from pathlib import Path
from typing import Annotated, NoReturn

import typer

from ros2_kafka_bridge.commands.options import AsJson


def status(
    file: Annotated[
        Path | None,
        typer.Argument(help='Configuration (YAML) of the bridge, with monitoring.listen.'),
    ] = None,
    *,
    address: Annotated[
        str, typer.Option(metavar='HOST:PORT', help='Ask the bridge there, without a file.')
    ] = '',
    as_json: AsJson = False,
) -> NoReturn:
    """Ask the running bridge of FILE how it is doing; needs monitoring.listen in it.

    A file that has mistakes is enough while it still tells the name and the address.

    Exit status: 0 ready, 1 not ready, 2 it does not answer, or is not known from the file.
    """
    from ros2_kafka_bridge.commands.status.report import report  # noqa: PLC0415 (--help must be quick)

    raise typer.Exit(report(file, address, as_json=as_json))
