"""Writes docs/configuration.md and docs/bridge.schema.json from the settings classes.

The drawings of docs/warehouse-modules.md come from the topics of the warehouse, the version where
files repeat it from the package.

With --check it writes nothing and fails where one of them is out of date.
"""

import argparse
import json
import re
import sys
from dataclasses import MISSING, fields
from inspect import cleandoc
from pathlib import Path
from typing import Any

from warehouse_docs import fill

from ros2_kafka_bridge import __version__
from ros2_kafka_bridge.config.base import Settings
from ros2_kafka_bridge.config.file import loads
from ros2_kafka_bridge.config.mistakes import field_names
from ros2_kafka_bridge.config.settings import (
    Config,
    FromKafka,
    FromRos,
    JsonSettings,
    KafkaToRosRoute,
    MonitoringSettings,
    QoS,
    RosSettings,
    RosToKafkaRoute,
    SchemaRegistrySettings,
    SchemaSettings,
    SpoolSettings,
    ToKafka,
    ToRos,
    TracingSettings,
)
from ros2_kafka_bridge.config.validation import json_schema as schema_of_file
from ros2_kafka_bridge.errors import ConfigError

DOCS = Path(__file__).parent.parent / 'docs'
PACKAGE = DOCS.parent / 'package.xml'
KUBERNETES = DOCS / 'kubernetes.md'
MODULES = DOCS / 'warehouse-modules.md'
KUSTOMIZATION = DOCS.parent / 'packaging' / 'kubernetes' / 'kustomization.yaml'
DIALECT = 'https://json-schema.org/draft/2020-12/schema'
FIRST = ('name', 'from', 'to', 'format')

EXAMPLE = """\
name: warehouse-1                       # of this bridge: consumer groups, origin header, node name
kafka:                                  # librdkafka properties, by their own names
  bootstrap.servers: localhost:9092
ros: {domain_id: 0}                     # default: ROS_DOMAIN_ID, as every ROS program
workers: 2                              # processes; one that dies is started again
defaults: {drain_s: 8}                  # any field of a route
routes:
  - name: orders
    from: {kafka: orders, start: earliest}    # latest is the default: no old commands
    to: {ros: /orders, type: std_msgs/msg/String}
    format: text                              # a String as it is
    max_rate: 500                             # for readers that are KEEP_LAST
  - name: odometry
    from: {ros: /odom}                        # the type that the graph shows
    to: {kafka: robots.odometry, key: '{message.child_frame_id}'}
    format: json                              # or cdr, avro, protobuf: any message type
    when_full: drop_oldest                    # the default is to wait
"""

WRONG = """\
name: warehouse-1
kafka:
  bootstrap.servers: localhost:9092
  group.id: mine
routes:
  - name: orders
    from: {kafka: orders, start: earlyest}
    to: {ros: orders, type: std_msgs/String}
    formt: text
"""

PAGE = """\
# Configuration

<!-- Written by tools/make_docs.py from the settings classes; change those. -->

One YAML 1.2 file describes one bridge: a Kafka cluster, a ROS domain, and the routes between
them. The direction of a route is read from its `from` and `to`.

```yaml
{example}```

- In a value, `${{NAME}}` stands for an environment variable, and `${{file:PATH}}` for the content
  of a file, without the newline at its end. A relative path starts at the folder of the
  configuration. A missing variable or file is a mistake. `$${{` is a literal `${{`.
- `defaults` holds fields of routes. Each field counts for the routes of the direction that has it,
  unless a route says something else.
- Names with `{{`, `}}`, `*` or a leading `^` are refused: these characters are kept for templates
  and patterns.
- The name of a bridge has no dot; the name of a route may have one. Consumer groups and spools are
  called `<bridge>.<route>`, so bridge `a.b` with route `c` would share them with bridge `a` with
  route `b.c`. If your bridge has a dot in its name, it
  [can keep what it has](#a-bridge-with-a-dot-in-its-name).
- Secrets (passwords, keys, tokens) are masked wherever a configuration is printed.
- [`bridge.schema.json`](bridge.schema.json) lets an editor complete and check a file. For the
  YAML language server, begin the file with
  `# yaml-language-server: $schema=bridge.schema.json`.

{tables}
## A bridge with a dot in its name

Earlier versions allowed a dot. Give the bridge the name that the mistake proposes, with dashes. To
let it go on where it was:

1. Give each route from Kafka its old group: `from: {{kafka: orders, group: plant.1.orders}}`.
2. Empty or rename its spools. Stop the bridge while Kafka answers, and look with
   `ros2-kafka-bridge spool DIRECTORY`. Rename all files of each spool that is left:
   `plant.1.orders.spool*` to `plant-1.orders.spool*`.
3. Stop all bridges that share an `exclusive` route before one with the new name starts.
4. Name the new groups and the new lock topic in the ACLs ([security.md](security.md)).

The ROS node keeps its name. Records that the bridge has written under its old name count as
records of another bridge. If one of its routes reads them back, it does not skip those that it has
not read yet.

## Mistakes

All mistakes in a file are reported at once, with file, line, field and what would be right: the
first hundred, or only the first one if the file is not valid YAML. Nothing is started then, and
the exit status is 2. This file

```yaml
{wrong}```

gives

```text
{problems}
```
"""

SECTIONS: tuple[tuple[str, type[Settings]], ...] = (
    ('The bridge', Config),
    ('`ros`', RosSettings),
    ('`schema_registry`', SchemaRegistrySettings),
    ('`monitoring`', MonitoringSettings),
    ('`tracing`', TracingSettings),
    ('A route from Kafka to ROS', KafkaToRosRoute),
    ('`from: {kafka: ...}`', FromKafka),
    ('`to: {ros: ...}`', ToRos),
    ('A route from ROS to Kafka', RosToKafkaRoute),
    ('`from: {ros: ...}`', FromRos),
    ('`to: {kafka: ...}`', ToKafka),
    ('`json`', JsonSettings),
    ('`schema`', SchemaSettings),
    ('`spool`', SpoolSettings),
    ('`qos`', QoS),
)


def json_schema() -> dict[str, Any]:
    """The JSON Schema of a configuration file, for editors."""
    made = schema_of_file(Config)
    routes = [made['$defs'][name] for name in ('KafkaToRosRoute', 'RosToKafkaRoute')]
    for route in routes:
        # A default can stand in for it.
        route['required'].remove('format')
    fields = {name: field for route in routes for name, field in route['properties'].items()}
    made['properties']['defaults'] |= {
        'additionalProperties': False,
        'properties': {n: f for n, f in fields.items() if n not in {'name', 'from', 'to'}},
    }
    made['properties']['kafka']['required'] = ['bootstrap.servers']
    return {'$schema': DIALECT, **_without_titles(made), 'title': 'ros2-kafka-bridge'}


def configuration_page() -> str:
    """The page on the configuration, in Markdown."""
    tables = '\n'.join(_section(title, model) for title, model in SECTIONS)
    return PAGE.format(
        example=EXAMPLE, tables=tables, wrong=WRONG, problems='\n'.join(_problems(WRONG))
    )


def _without_titles(value: Any) -> Any:
    if isinstance(value, dict):
        kept = {n: v for n, v in value.items() if n != 'title' or not isinstance(v, str)}
        return {name: _without_titles(item) for name, item in kept.items()}
    return [_without_titles(item) for item in value] if isinstance(value, list) else value


def _problems(text: str) -> list[str]:
    try:
        loads(text, 'bridge.yaml', {})
    except ConfigError as error:
        return error.problems
    raise AssertionError('the wrong example is right')


def _section(title: str, model: type[Settings]) -> str:
    schema = schema_of_file(model)
    names = sorted(
        schema['properties'], key=lambda n: FIRST.index(n) if n in FIRST else len(FIRST)
    )
    rows = [_row(model, name, schema['properties'][name]) for name in names]
    head = '| field | type | default | meaning |\n|---|---|---|---|'
    return '\n'.join([f'## {title}', '', cleandoc(model.__doc__ or ''), '', head, *rows, ''])


def _row(model: type[Settings], name: str, schema: dict[str, Any]) -> str:
    field = next(each for each in fields(model) if each.name == field_names(model)[name])
    if field.default is MISSING and field.default_factory is MISSING:
        default = 'required'
    elif field.default is None or field.default is MISSING:
        default = ''
    elif isinstance(field.default, bool):
        default = f'`{str(field.default).lower()}`'
    else:
        default = f'`{field.default}`'
    return f'| `{name}` | {_type(schema)} | {default} | {field.metadata["description"]} |'


def _type(schema: dict[str, Any]) -> str:
    if 'anyOf' in schema:
        return next(_type(part) for part in schema['anyOf'] if part.get('type') != 'null')
    if 'enum' in schema:
        return ', '.join(f'`{value}`' for value in schema['enum'])
    words = {
        'string': 'text',
        'integer': 'whole number',
        'number': 'number',
        'boolean': '`true`, `false`',
        'array': 'list',
        'object': 'mapping',
    }
    return words[schema.get('type', 'object')]


def _of_this_version(file: Path) -> str:
    """Give a file that can refer to nothing the version of the package."""
    version = r'(<version>|newTag: |/ros2-kafka-bridge:)\d+\.\d+\.\d+'
    return re.sub(version, rf'\g<1>{__version__}', file.read_text('utf-8'))


def main() -> int:
    """Write the files, or compare them with what would be written."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--check', action='store_true', help='write nothing, fail on a difference')
    check = parser.parse_args().check
    texts = {
        DOCS / 'configuration.md': configuration_page(),
        DOCS / 'bridge.schema.json': json.dumps(json_schema(), indent=2) + '\n',
        MODULES: fill(MODULES.read_text('utf-8')),
        **{file: _of_this_version(file) for file in (PACKAGE, KUBERNETES, KUSTOMIZATION)},
    }
    stale = []
    for path, text in texts.items():
        if not path.exists() or path.read_text('utf-8') != text:
            stale.append(path.name)
            if not check:
                path.write_text(text, 'utf-8')
    if check and stale:
        print(f'out of date: {", ".join(stale)}: run tools/make_docs.py')
        return 1
    return 0


if __name__ == '__main__':
    sys.exit(main())
