"""The schema of a message type, as a format uses it. No broker is asked, and no ROS is loaded."""

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

from ros2_kafka_bridge.config.formats import JsonSettings
from ros2_kafka_bridge.config.mistakes import near
from ros2_kafka_bridge.config.settings import Config, KafkaToRosRoute, RosToKafkaRoute
from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.message_types import document, load_layout
from ros2_kafka_bridge.message_types.layout import Layout
from ros2_kafka_bridge.outside.extras import missing_extra

SCHEMAS: Final = ('json', 'avro', 'protobuf')


class SchemaOptions(NamedTuple):
    """What is wanted; what is left out comes from the route.

    Args:
        type_name: As `std_msgs/msg/String`; empty without.
        format_name: One of `SCHEMAS`; empty without.
        message_path: Folders of .msg files.
        config: With the route.
        route: Its name; empty without.
        output: Folder to write files into; None prints.
    """

    type_name: str
    format_name: str
    message_path: Sequence[Path] = ()
    config: Config | None = None
    route: str = ''
    output: Path | None = None


class _Wanted(NamedTuple):
    layout: Layout
    format_name: str
    settings: JsonSettings


def report(options: SchemaOptions) -> int:
    """Print the schema, or write it into files; returns the exit status.

    Raises:
        ConfigError: There is no such type, route or schema, or the extra is missing.
    """
    wanted = _wanted(options)
    if options.output is None:
        sys.stdout.write(text_of(*wanted))
        return 0
    for name, text in _files_of(wanted).items():
        _write(options.output / name, text)
    return 0


def text_of(layout: Layout, format_name: str, settings: JsonSettings) -> str:
    """The schema of a documented type, as it is used.

    Raises:
        ConfigError: The format cannot carry the type.
    """
    # Each has libraries of its own.
    if format_name == 'json':
        from ros2_kafka_bridge.formats.json import schema  # noqa: PLC0415

        return schema(layout, settings)
    if format_name == 'avro':
        from ros2_kafka_bridge.formats.avro.schema import avro_schema  # noqa: PLC0415

        return json.dumps(avro_schema(layout), indent=2, ensure_ascii=False) + '\n'
    from ros2_kafka_bridge.formats.protobuf.schema import protobuf_schema  # noqa: PLC0415

    return protobuf_schema(layout)


def _files_of(wanted: _Wanted) -> dict[str, str]:
    layout, format_name, _ = wanted
    if format_name == 'protobuf':
        from ros2_kafka_bridge.formats.protobuf.schema import protobuf_sources  # noqa: PLC0415

        return protobuf_sources(layout)
    suffix = {'json': 'schema.json', 'avro': 'avsc'}[format_name]
    return {f'{layout.type_name}.{suffix}': text_of(*wanted)}


def _write(file: Path, text: str) -> None:
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding='utf-8')
    except OSError as error:
        raise ConfigError([f'{file}: cannot be written: {error.strerror}']) from error
    print(file)  # noqa: T201 (the words for the user)


def _wanted(options: SchemaOptions) -> _Wanted:
    route = _route(options)
    format_name = options.format_name or (route.format if route else '')
    if format_name not in SCHEMAS:
        said = f'{format_name} has no schema: say' if format_name else 'of which format? Say'
        raise ConfigError([f'{said} --format json, avro or protobuf'])
    if problem := missing_extra(format_name):
        raise ConfigError([problem])
    name = options.type_name or _type_of(route)
    folders = [*options.message_path, *(options.config.ros.message_path if options.config else ())]
    # A route has the type that is installed; the folders only tell its docs.
    layout = load_layout(name, () if route else folders)
    settings = route.json_settings if route and route.format == 'json' else None
    return _Wanted(document(layout, folders), format_name, settings or JsonSettings())


def _route(options: SchemaOptions) -> KafkaToRosRoute | RosToKafkaRoute | None:
    if not options.route:
        return None
    if options.config is None:
        raise ConfigError(['--route: of which file? Say --config FILE, too'])
    by_name = {route.name: route for route in options.config.routes}
    if options.route not in by_name:
        raise ConfigError([f'--route: no route {options.route}{near(options.route, by_name)}'])
    return by_name[options.route]


def _type_of(route: KafkaToRosRoute | RosToKafkaRoute | None) -> str:
    if route is None:
        raise ConfigError(['of which message type? Name it, as std_msgs/msg/String'])
    name = route.sink.type if isinstance(route, KafkaToRosRoute) else route.source.type
    if name is None:
        text = f'route {route.name} takes the type that is published: name a message type'
        raise ConfigError([text])
    return name
