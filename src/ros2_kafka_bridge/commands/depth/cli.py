"""The command line of `depth`: text -> what is asked; no logic."""

from pathlib import Path
from typing import Annotated

import typer

from ros2_kafka_bridge.commands.options import AsJson, Servers


def depth(
    *,
    kafka: Annotated[
        str | None, typer.Option(metavar='TOPIC', help='Arrivals: the records of a Kafka topic.')
    ] = None,
    ros: Annotated[
        str | None, typer.Option(metavar='TOPIC', help='Arrivals: a live ROS topic.')
    ] = None,
    arrivals: Annotated[
        Path | None, typer.Option(help='Arrivals: a file, one time in nanoseconds a line.')
    ] = None,
    recording: Annotated[
        Path | None,
        typer.Option(help='Arrivals and service times: a file of ServiceTimes.'),
    ] = None,
    service: Annotated[
        str, typer.Option(metavar='TIME', help='How long the reader takes for each, as 0.8ms.')
    ] = '',
    service_file: Annotated[
        Path | None, typer.Option(help='Service times: a file of ServiceTimes, or one a line.')
    ] = None,
    wake: Annotated[
        str,
        typer.Option(metavar='TIME', help='How long an idle reader takes to begin, as 0.2ms.'),
    ] = '',
    loss: Annotated[float, typer.Option(help='Share of messages that may be lost.')] = 1e-6,
    at: Annotated[
        list[int], typer.Option('--depth', help='Show the loss at this depth, too; repeatable.')
    ] = [10, 100, 200],  # noqa: B006 (typer copies it)
    servers: Servers = '',
    partition: Annotated[
        int | None, typer.Option(help='Of the Kafka topic.  [default: all]')
    ] = None,
    last: Annotated[int, typer.Option(min=2, help='How many records of Kafka.')] = 100_000,
    seconds: Annotated[float, typer.Option(min=0.1, help='How long to listen to ROS.')] = 30.0,
    config: Annotated[
        Path | None, typer.Option(help='Configuration (YAML), for its kafka section.')
    ] = None,
    properties: Annotated[
        list[str],
        typer.Option('--property', '-X', metavar='NAME=VALUE', help='Of librdkafka; repeatable.'),
    ] = [],  # noqa: B006 (typer copies it)
    plot: Annotated[
        Path | None, typer.Option(help='Draw into this file (.png, .svg, .pdf).')
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Tell which KEEP_LAST depth a ROS reader needs for its traffic.

    Replays the arrivals through the queue of one reader, and estimates beyond what they show.
    Needs the extra [depth]. docs/depth.md explains it.

    Exit status: 0 a depth was found, 1 none can be recommended, 2 something is missing or wrong.
    """
    from ros2_kafka_bridge.commands.depth.options import DepthOptions, Kafka, Ros  # noqa: PLC0415 (--help must be quick)
    from ros2_kafka_bridge.commands.depth.report import report  # noqa: PLC0415

    of_kafka = kafka and Kafka(kafka, servers, partition, last, config, properties)
    of_ros = ros and Ros(ros, seconds)
    options = DepthOptions(
        kafka=of_kafka or None,
        ros=of_ros or None,
        arrivals=arrivals,
        recording=recording,
        service=service,
        service_file=service_file,
        wake=wake,
        loss=loss,
        depths=at,
        plot=plot,
        as_json=as_json,
    )
    raise typer.Exit(report(options))
