"""The schema of a message type, as a format uses it.

No broker is asked, and no ROS is loaded unless the graph is to tell the type.
"""

import json
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final, NamedTuple

from ros2_kafka_bridge.config.formats import JsonSettings
from ros2_kafka_bridge.config.mistakes import near
from ros2_kafka_bridge.config.routes import AnyRoute
from ros2_kafka_bridge.config.settings import Config, RosSettings
from ros2_kafka_bridge.errors import BridgeError, ConfigError
from ros2_kafka_bridge.message_types import INSTALLED, describe, document
from ros2_kafka_bridge.message_types.description import DescribedTypes, make_layout
from ros2_kafka_bridge.message_types.layout import Layout
from ros2_kafka_bridge.message_types.source import TypeSource
from ros2_kafka_bridge.outside.extras import missing_extra

SCHEMAS: Final = ('json', 'avro', 'protobuf', 'msg')


class SchemaOptions(NamedTuple):
    """What is wanted; what is left out comes from the route.

    Args:
        type_name: As `std_msgs/msg/String`; empty without.
        format_name: One of `SCHEMAS`; empty without.
        message_path: Folders of .msg files.
        config: With the route.
        route: Its name; empty without.
        output: Folder to write files into; None prints.
        from_graph: Whether the type is the one that ROS nodes use.
    """

    type_name: str
    format_name: str
    message_path: Sequence[Path] = ()
    config: Config | None = None
    route: str = ''
    output: Path | None = None
    from_graph: bool = False


class _Wanted(NamedTuple):
    layout: Layout
    format_name: str
    settings: JsonSettings


def report(options: SchemaOptions) -> int:
    """Print the schema, or write it into files; returns the exit status.

    Raises:
        ConfigError: There is no such type, route or schema, or the extra is missing.
    """
    try:
        wanted = _wanted(options)
    except ConfigError:
        raise
    except BridgeError as error:  # of the graph
        _say(str(error))
        return 1
    if options.output is None:
        sys.stdout.write(text_of(*wanted))
        return 0
    files = {options.output / name: text for name, text in _files_of(wanted).items()}
    if wanted.format_name == 'msg':
        _refuse_other(files)
    for file, text in files.items():
        _write(file, text)
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
    if format_name == 'msg':
        from ros2_kafka_bridge.message_types.writing import msg_text  # noqa: PLC0415

        return msg_text(layout)
    from ros2_kafka_bridge.formats.protobuf.schema import protobuf_schema  # noqa: PLC0415

    return protobuf_schema(layout)


def _files_of(wanted: _Wanted) -> dict[str, str]:
    layout, format_name, _ = wanted
    if format_name == 'protobuf':
        from ros2_kafka_bridge.formats.protobuf.schema import protobuf_sources  # noqa: PLC0415

        return protobuf_sources(layout)
    if format_name == 'msg':
        from ros2_kafka_bridge.message_types.writing import msg_files  # noqa: PLC0415

        return {f'{name}.msg': text for name, text in msg_files(layout).items()}
    suffix = {'json': 'schema.json', 'avro': 'avsc'}[format_name]
    return {f'{layout.type_name}.{suffix}': text_of(*wanted)}


def _refuse_other(files: dict[Path, str]) -> None:
    """Keep the .msg files of a person, which have the same names."""
    problems = []
    for file, text in files.items():
        with suppress(OSError):
            if file.read_bytes() != text.encode():
                problems.append(
                    f'{file}: is there already, with another text: remove it, or name another '
                    'folder'
                )
    if problems:
        raise ConfigError(problems)


def _write(file: Path, text: str) -> None:
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding='utf-8')
    except OSError as error:
        raise ConfigError([f'{file}: cannot be written: {error.strerror}']) from error
    print(file)  # noqa: T201 (the words for the user)


def _say(text: str) -> None:
    print(text, file=sys.stderr)  # noqa: T201 (the words for the user; the schema is the answer)


def _wanted(options: SchemaOptions) -> _Wanted:
    route = _route(options)
    format_name = options.format_name or (route.format if route else '')
    if format_name not in SCHEMAS:
        said = f'{format_name} has no schema: say' if format_name else 'of which format? Say'
        raise ConfigError([f'{said} --format json, avro, protobuf or msg'])
    if problem := missing_extra(format_name):
        raise ConfigError([problem])
    name = options.type_name or _type_of(route, from_graph=options.from_graph)
    layout = _layout(name, route, options)
    settings = route.json_settings if route and route.format == 'json' else None
    return _Wanted(layout, format_name, settings or JsonSettings())


# Which type


def _route(options: SchemaOptions) -> AnyRoute | None:
    if not options.route:
        return None
    if options.config is None:
        raise ConfigError(['--route: of which file? Say --config FILE, too'])
    by_name = {route.name: route for route in options.config.routes}
    if options.route not in by_name:
        raise ConfigError([f'--route: no route {options.route}{near(options.route, by_name)}'])
    return by_name[options.route]


def _type_of(route: AnyRoute | None, *, from_graph: bool) -> str:
    """The name of the type; empty for the one that is published."""
    if route is None:
        raise ConfigError(['of which message type? Name it, as std_msgs/msg/String'])
    if route.type_name is None and not from_graph:
        text = f'route {route.name} takes the type that is published: name a message type'
        raise ConfigError([f'{text}, or say --from-graph'])
    return route.type_name or ''


def _layout(name: str, route: AnyRoute | None, options: SchemaOptions) -> Layout:
    ros = RosSettings() if options.config is None else options.config.ros
    source = TypeSource.of(ros, over=options.message_path)
    if options.from_graph:
        from ros2_kafka_bridge.commands.schema.graph import type_there  # noqa: PLC0415 (heavy)

        topic = '' if route is None else route.ros_topic
        name, described, said = type_there(ros, source, name, topic)
        _say(said)
    else:
        described = source.describe(name)
        if described.origin != INSTALLED:
            _say(f'{name} {described.origin}')
    return _documented(name, described, [*options.message_path, *ros.message_path])


def _documented(name: str, described: DescribedTypes, folders: Sequence[Path]) -> Layout:
    """The layout with its docs and constants: another definition has other ones."""
    layout = make_layout(name, described)
    for place in (folders, ()):
        with suppress(ConfigError):
            if describe(name, place).types == described.types:
                return document(layout, place)
    return layout
