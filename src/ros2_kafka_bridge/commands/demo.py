"""The command line of `demo`: text -> what is asked; no logic."""

from typing import Annotated

import typer


def demo(
    *,
    rate: Annotated[float, typer.Option(help='Orders per second.')] = 300.0,
    seconds: Annotated[float, typer.Option(help='How long orders are sent.')] = 20.0,
    bootstrap_servers: Annotated[
        str | None, typer.Option(help='A real broker.  [default: one embedded in the demo]')
    ] = None,
    domain: Annotated[
        int | None, typer.Option(help='ROS domain.  [default: ROS_DOMAIN_ID, or 0]')
    ] = None,
) -> None:
    """Send random orders Kafka -> ROS -> Kafka, and count them on their way.

    Ctrl-C ends the sending and counts what was sent; a second one ends at once (130).
    Exit status: 0 the bridge lost nothing, 1 it did, or something failed, 2 could not start.
    """
    from ros2_kafka_bridge.demo import run as demonstration  # noqa: PLC0415 (heavy)

    options = demonstration.DemoOptions(rate, seconds, bootstrap_servers, domain)
    raise typer.Exit(demonstration.run(options))
