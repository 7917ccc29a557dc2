"""The command line of `topics`: text -> what is asked; no logic."""

from pathlib import Path
from typing import Annotated

import typer

from ros2_kafka_bridge.commands.options import LOCAL, AsJson, Servers
from ros2_kafka_bridge.errors import ConfigError


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
    compacted topics), rates. For ROS: types, QoS of publishers and subscribers, rates. For a
    type that is not installed here, nodes that use it are asked. A topic that a bridge publishes
    is not counted, because the bridge would wait for the counting. Without FILE: localhost:9092
    and ROS_DOMAIN_ID.

    Exit status: 0 both sides were seen, 1 one of them was not, 2 the file is wrong.
    """
    if file is not None and servers:
        raise ConfigError([f'--bootstrap-servers: {file} says them already: leave one out'])

    from ros2_kafka_bridge.process.load import load_checked  # noqa: PLC0415 (--help must be quick)

    config = None if file is None else load_checked(file)

    from ros2_kafka_bridge.commands.topics.report import SideSettings, report  # noqa: PLC0415 (heavy)

    sides = (
        SideSettings.without_file(servers or LOCAL) if config is None else SideSettings.of(config)
    )
    raise typer.Exit(report(sides, seconds=rates, as_json=as_json))
