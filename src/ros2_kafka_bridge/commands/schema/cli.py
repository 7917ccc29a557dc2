"""The command line of `schema`: text -> what is asked; no logic."""

import enum
from pathlib import Path
from typing import Annotated

import typer


class SchemaFormat(enum.StrEnum):
    """A format that has a schema."""

    JSON = 'json'
    AVRO = 'avro'
    PROTOBUF = 'protobuf'
    MSG = 'msg'


def schema(
    message_type: Annotated[
        str,
        typer.Argument(metavar='TYPE', help='Message type, as std_msgs/msg/String.'),
    ] = '',
    *,
    schema_format: Annotated[
        SchemaFormat | None, typer.Option('--format', help="Without it the route's.")
    ] = None,
    message_path: Annotated[
        list[Path],
        typer.Option(metavar='DIR', help='Folder of .msg files; repeatable.'),
    ] = [],  # noqa: B006 (typer copies it)
    config: Annotated[
        Path | None, typer.Option(help='Configuration (YAML): its ros.message_path and routes.')
    ] = None,
    route: Annotated[
        str, typer.Option(help='Its type, its format and the settings of that.')
    ] = '',
    from_graph: Annotated[
        bool,
        typer.Option('--from-graph', help='The type as ROS nodes use it; one of them is asked.'),
    ] = False,
    output: Annotated[
        Path | None,
        typer.Option(metavar='DIR', help='Write files into this folder instead of printing.'),
    ] = None,
) -> None:
    """Print the schema of a message type: JSON Schema, an Avro schema, .proto or .msg files.

    It is what a route with that format uses and registers, with the comments of the message
    definition. msg is the definition itself: written by --output, its folder can be named in
    ros.message_path. Neither Kafka nor a Schema Registry is asked, and no ROS is loaded without
    --from-graph.

    Exit status: 0 printed, 1 no node was seen that uses the type or describes it (--from-graph),
    2 there is no such type, route or schema.
    """
    from ros2_kafka_bridge.commands.schema import report as command  # noqa: PLC0415 (--help must be quick)
    from ros2_kafka_bridge.process.load import load_checked  # noqa: PLC0415

    options = command.SchemaOptions(
        message_type,
        schema_format.value if schema_format else '',
        message_path,
        None if config is None else load_checked(config),
        route,
        output,
        from_graph=from_graph,
    )
    raise typer.Exit(command.report(options))
