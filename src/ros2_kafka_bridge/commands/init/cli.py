"""The command line of `init`: text -> what is asked; no logic."""

from pathlib import Path
from typing import Annotated

import typer

from ros2_kafka_bridge.commands.options import LOCAL, Servers


def init(
    file: Annotated[Path, typer.Argument(help='File to write.')] = Path('bridge.yaml'),
    *,
    from_graph: Annotated[
        bool, typer.Option('--from-graph', help='A route for each topic of the ROS graph.')
    ] = False,
    servers: Servers = '',
    force: Annotated[bool, typer.Option('--force', help='Overwrite a file.')] = False,
) -> None:
    """Write a commented configuration to begin with; overwrites no file without --force.

    It has the two usual routes, or with --from-graph a route for each ROS topic that is there
    now: what is published goes to Kafka, what is only subscribed to comes from Kafka. With
    --bootstrap-servers it names the topics that Kafka has already.

    Exit status: 0 written, 1 no topic was seen, 2 the file is there or cannot be written.
    """
    from ros2_kafka_bridge.commands.init import write as command  # noqa: PLC0415 (--help must be quick)

    brokers = servers or LOCAL
    if from_graph:
        status = command.write_from_graph(file, brokers, ask_kafka=bool(servers), force=force)
    else:
        status = command.write_start(file, brokers, force=force)
    raise typer.Exit(status)
