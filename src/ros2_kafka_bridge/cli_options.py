"""Options that several commands have."""

from typing import Annotated

import typer

AsJson = Annotated[bool, typer.Option('--json', help='For programs.')]
Servers = Annotated[str, typer.Option('--bootstrap-servers', help='Kafka brokers, with commas.')]
