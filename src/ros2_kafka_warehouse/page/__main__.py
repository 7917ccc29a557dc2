"""`python -m ros2_kafka_warehouse.page`: serve the live page until a signal ends it."""

from pathlib import Path
from typing import Annotated

import typer

from ros2_kafka_warehouse.domain.site import DEFAULT_SITE, SiteError, read_site


def serve(
    bootstrap_servers: Annotated[str, typer.Option(help='Of Kafka.')] = 'localhost:9092',
    host: Annotated[str, typer.Option(help='Address to listen on.')] = '127.0.0.1',
    port: Annotated[
        int, typer.Option(min=0, max=65_535, help='Port to listen on; 0 takes a free one.')
    ] = 8080,
    site: Annotated[Path, typer.Option(help='The site, as the other modules have it.')] = (
        DEFAULT_SITE
    ),
    orders_per_minute: Annotated[
        float, typer.Option(min=0, max=600, help='Random orders to begin with.')
    ] = 0.0,
    allow_host: Annotated[
        list[str] | None,
        typer.Option(help='Another name under which browsers reach this page.'),
    ] = None,
    alive: Annotated[
        Path | None, typer.Option(help='A file that is touched as long as the page works.')
    ] = None,
) -> None:
    """Serve the live page of the warehouse."""
    from ros2_kafka_warehouse.page.server import (  # noqa: PLC0415 (--help needs no server)
        CannotListen,
        PartFailed,
        Where,
        run,
    )

    try:
        where = Where(bootstrap_servers, host, port, tuple(allow_host or ()))
        run(read_site(site), where, orders_per_minute, alive)
    except (SiteError, CannotListen) as error:
        typer.echo(f'ros2-kafka-warehouse page: {error}', err=True)
        raise typer.Exit(2) from None
    except PartFailed as error:
        typer.echo(f'ros2-kafka-warehouse page: {error}', err=True)
        raise typer.Exit(1) from None


if __name__ == '__main__':
    typer.run(serve)
