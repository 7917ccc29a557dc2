"""Options that several commands have."""

from pathlib import Path
from typing import Annotated, Final

import typer

from ros2_kafka_bridge.kafka.addresses import servers_problem

LOCAL: Final = 'localhost:9092'
"""The brokers where none are named."""

File = Annotated[Path, typer.Argument(help='Configuration (YAML).', show_default=False)]
AsJson = Annotated[bool, typer.Option('--json', help='For programs.')]


def checked_servers(servers: str | None) -> str | None:
    """A list of brokers, if it is one.

    Raises:
        typer.BadParameter: It is not.
    """
    if servers and (problem := servers_problem(servers)):
        raise typer.BadParameter(problem)
    return servers


Servers = Annotated[
    str,
    typer.Option(
        '--bootstrap-servers', help='Kafka brokers, with commas.', callback=checked_servers
    ),
]
