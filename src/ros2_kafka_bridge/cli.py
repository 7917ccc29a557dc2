"""The command line: its commands, each from a folder of `commands`, and how a mistake ends."""

import sys
from typing import Annotated

import typer

from ros2_kafka_bridge import __version__
from ros2_kafka_bridge.commands.check.cli import check
from ros2_kafka_bridge.commands.dead_letters import cli as dead_letters
from ros2_kafka_bridge.commands.demo import demo
from ros2_kafka_bridge.commands.depth.cli import depth
from ros2_kafka_bridge.commands.init.cli import init
from ros2_kafka_bridge.commands.run import run
from ros2_kafka_bridge.commands.schema.cli import schema
from ros2_kafka_bridge.commands.spool.cli import spool
from ros2_kafka_bridge.commands.status.cli import status
from ros2_kafka_bridge.commands.topics.cli import topics
from ros2_kafka_bridge.errors import BridgeError

app = typer.Typer(
    help='Moves every message between Apache Kafka and ROS 2, both ways, and loses none that it '
    'can know of.',
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,  # its import takes longer than all the rest of --help
    pretty_exceptions_enable=False,
    context_settings={'help_option_names': ['-h', '--help']},
)
app.add_typer(dead_letters.app, name='dead-letters')
for _command in (run, status, check, demo, init, topics, depth, spool, schema):
    app.command()(_command)


def _version(asked: bool) -> None:  # noqa: FBT001 (typer's callback)
    if asked:
        typer.echo(__version__)
        raise typer.Exit


@app.callback()
def _main(
    *,
    _version: Annotated[
        bool,
        typer.Option('--version', callback=_version, is_eager=True, help='Show the version.'),
    ] = False,
) -> None:
    pass


def main() -> None:
    """Run the command line; a mistake of the user ends with its sentences, not a traceback."""
    try:
        app()
    except BridgeError as error:  # only the start raises one: a route keeps its own
        typer.echo(str(error), err=True)
        sys.exit(2)
