"""Options that several commands have."""

from pathlib import Path
from typing import Annotated, Final

import typer

LOCAL: Final = 'localhost:9092'
"""The brokers where none are named."""

File = Annotated[Path, typer.Argument(help='Configuration (YAML).', show_default=False)]
AsJson = Annotated[bool, typer.Option('--json', help='For programs.')]
Servers = Annotated[str, typer.Option('--bootstrap-servers', help='Kafka brokers, with commas.')]
