"""The starting file that `init` writes: with the two usual routes, or those of the ROS graph."""

import os
import shlex
import textwrap
from collections.abc import Iterator, Sequence
from io import StringIO
from pathlib import Path
from typing import NamedTuple

from rich.console import Console
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from ros2_kafka_bridge.commands.init.drafts import Draft, drafts
from ros2_kafka_bridge.commands.names import is_of_ros_itself
from ros2_kafka_bridge.commands.screen import screen, wait_for_discovery
from ros2_kafka_bridge.config.file import loads
from ros2_kafka_bridge.config.settings import RosSettings
from ros2_kafka_bridge.errors import BridgeError, ConfigError, RouteError
from ros2_kafka_bridge.kafka.overview import Overview
from ros2_kafka_bridge.kafka.properties import common_properties
from ros2_kafka_bridge.logs.lines import keep_clients_quiet
from ros2_kafka_bridge.message_types import KnownTypes
from ros2_kafka_bridge.message_types.source import CURE
from ros2_kafka_bridge.ros.discovery import hint, partial_view
from ros2_kafka_bridge.ros.fastdds_profile import Histories
from ros2_kafka_bridge.ros.node import RosNode, Topic, domain_in_words, open_node
from ros2_kafka_bridge.ros.shown_types import ShownTypes, load_shown
from ros2_kafka_bridge.ros.types import TypeLoader

_WIDTH = 98

_HEAD = """\
# A bridge between Apache Kafka and ROS 2. All fields: docs/configuration.md.
#
#   ros2-kafka-bridge check {file} --connect    what would happen, before anything does
#   ros2-kafka-bridge run {file}

# The name is in the consumer groups, in the header bridge.origin of each record that the bridge
# writes, and in the name of its ROS node. Give each bridge its own, and choose it before the
# first start: a new name is a new consumer group, which does not know what was delivered.
name: bridge-1

kafka:
  # Any librdkafka property, by its own name. Brokers with commas between them.
  bootstrap.servers: {servers}
  # For a cluster with TLS and passwords, see docs/security.md. The password comes from the
  # environment and is never printed.
  # security.protocol: SASL_SSL
  # sasl.mechanisms: SCRAM-SHA-512
  # sasl.username: bridge-1
  # sasl.password: ${{KAFKA_PASSWORD}}

# The ROS domain is that of ROS_DOMAIN_ID, as for every ROS program{domain}, or this one:
# ros: {{domain_id: 0}}

# A record that can never be delivered, because it is not what the route says, stops nothing: it
# goes to the topic <topic>.dead-letters with the reason, and the next one follows. Another topic:
# dead_letter beside the Kafka topic of a route. Another way: on_error: stop, or drop.
# defaults: {{on_error: dead_letter}}

"""

_ROUTES = """\
routes:
  # In: each record of the Kafka topic orders is published on the ROS topic /orders.
  - name: orders
    from:
      kafka: orders
      # Where to begin when this bridge reads the topic for the first time. latest: only what
      # comes from then on, so that no robot is given an old order. earliest: all that is there.
      start: latest
    to:
      ros: /orders
      type: std_msgs/msg/String
    # text: the record's value is the text of the message. For any type: json, an object with the
    # fields of the message; avro and protobuf, with a schema; cdr, the message as ROS sends it.
    format: text
    # The bridge waits until so many subscribers are there; with 0 it publishes to nobody, too.
    min_subscribers: 1
    # A subscriber with a short queue (KEEP_LAST) overwrites what it has no time for. Its pace, in
    # messages a second, saves it from that.
    # max_rate: 100

  # Out: each message of the ROS topic /status becomes a record of the Kafka topic status.
  - name: status
    from:
      ros: /status
      # Without a type the bridge waits for a publisher and takes the type of that one.
      type: std_msgs/msg/String
    to:
      kafka: status
      # Records of the same key stay in order. Also {ros.gid}, the publisher, or a field such as
      # {message.header.frame_id}. In quotes: YAML reads a brace as its own.
      key: '{ros.topic}'
    format: text
    # While Kafka takes no more, the bridge waits, and drops nothing; then publishers are held
    # back, or overwrite. For messages that are worth nothing when they are old: drop_oldest.
    when_full: wait
"""

_FROM_GRAPH = """\
# One route for each topic that the ROS graph showed in {domain}.
# What is published goes to Kafka, what is only subscribed to comes from Kafka.
# text is for std_msgs/msg/String: the value of the record is the text. json is for all types: an
# object with the fields of the message. So is cdr, the message as ROS sends it, which is smaller
# for what nobody reads as text. There are avro and protobuf, too: docs/formats.md.
#
# Also for a route: start (earliest: all that a Kafka topic holds; latest: only what comes from
# the first start on), key (records of one key stay in order; it is the ROS topic), max_rate (for
# subscribers with a short queue), when_full (drop_oldest instead of wait).
{left_out}routes:
"""


class _Seen(NamedTuple):
    """What both sides showed; `kafka` is None where it was not asked or does not answer."""

    topics: list[Topic]
    types: ShownTypes
    kafka: list[str] | None
    notes: list[str]


def write_start(file: Path, servers: str, *, force: bool) -> int:
    """Write a starting file with the two usual routes.

    Raises:
        ConfigError: The file is there already, or cannot be written.
    """
    _refuse_existing(file, force=force)
    _write(file, _head(file, servers) + _ROUTES, force=force)
    console = screen()
    console.print(f'{file} is written: 2 routes, orders into ROS and status out of it')
    console.print('next: put your brokers and topics into it, then')
    _say_next(console, file)
    return 0


def write_from_graph(file: Path, servers: str, *, ask_kafka: bool, force: bool) -> int:
    """Write a starting file with a route for each topic of the ROS graph.

    Returns:
        0 when it is written, 1 when there is no topic to bridge.

    Raises:
        ConfigError: The file is there already, or cannot be written; ROS is not here.
    """
    _refuse_existing(file, force=force)
    keep_clients_quiet()
    seen = _look(servers, ask_kafka=ask_kafka)
    found = drafts(seen.topics, seen.types, seen.kafka)
    errors = Console(stderr=True, highlight=False, markup=False, soft_wrap=True)
    for note in seen.notes:
        errors.print(note)
    usable = [draft for draft in found if not draft.problem]
    for draft in found:
        if draft.problem:
            errors.print(f'left as a comment: {draft.problem}')
    if not usable:
        errors.print(_nothing(seen.topics, found))
        return 1
    _write(file, graph_text(file, servers, seen.topics, found), force=force)
    console = screen()
    console.print(f'{file} is written: {_ways(usable)}')
    console.print('next: keep the routes that you want, then')
    _say_next(console, file)
    return 0


def _say_next(console: Console, file: Path) -> None:
    name = shlex.quote(str(file))
    console.print(f'  ros2-kafka-bridge check {name} --connect')
    console.print(f'  ros2-kafka-bridge run {name}')


def _ways(usable: Sequence[Draft]) -> str:
    out = sum(draft.way == 'to Kafka' for draft in usable)
    count = f'{len(usable)} route{"s" * (len(usable) > 1)}'
    return f'{count}, {out} to Kafka and {len(usable) - out} from it'


def _nothing(topics: Sequence[Topic], found: Sequence[Draft]) -> str:
    if found:
        return 'no topic can be bridged as it is: nothing is written'
    own = ' but those of ROS itself' if topics else ''
    return f'no topic is seen in ROS {domain_in_words(None)}{own}, nothing is written: {hint()}'


# Looking


def _look(servers: str, *, ask_kafka: bool) -> _Seen:
    kafka, notes = None, []
    if ask_kafka:
        try:
            kafka = _kafka_topics(servers)
        except BridgeError as error:
            notes.append(f'{error}: the file is written without looking at Kafka ({servers})')
    with open_node('init', None, Histories({}, {})) as node:
        wait_for_discovery()
        seen = node.topics()
        types = _types(node, [topic for topic in seen if not is_of_ros_itself(topic.name)])
    if seen and (hidden := partial_view()):
        notes.append(f'there may be more topics: {hidden}')
    notes += [f'{topic.name} is left out: {topic.problem}' for topic in seen if topic.problem]
    return _Seen([topic for topic in seen if not topic.problem], types, kafka, notes)


def _types(node: RosNode, topics: Sequence[Topic]) -> ShownTypes:
    """The types that are not installed here; `check` refuses one of a package that is."""
    known = KnownTypes()
    shown = load_shown(node, TypeLoader(RosSettings()), topics)
    mistakes = {place: known.mistake(place[1]) for place in shown}
    refused = {
        place: RouteError(f'{mistake}: {CURE}') for place, mistake in mistakes.items() if mistake
    }
    return {**shown, **refused}


def _kafka_topics(servers: str) -> list[str]:
    properties = common_properties({'bootstrap.servers': servers}, client_id='init')
    return [topic.name for topic in Overview(properties).topics()]


# Text


def _head(file: Path, servers: str) -> str:
    domain = os.environ.get('ROS_DOMAIN_ID')
    return _HEAD.format(
        file=_plain(shlex.quote(str(file))),
        servers=scalar(servers),
        domain=f' (here {domain})' if domain else '',
    )


def graph_text(file: Path, servers: str, topics: Sequence[Topic], found: Sequence[Draft]) -> str:
    """The file for a graph: every topic in it, as a route, a comment, or left out by name."""
    drafted = {draft.ros for draft in found}
    left = [topic.name for topic in topics if topic.name not in drafted]
    left_out = ''
    if left:
        text = 'Left out, because ROS itself uses them or only a bridge does: '
        left_out = f'#\n{_commented(text + ", ".join(left) + ".", "")}'
    intro = _FROM_GRAPH.format(domain=domain_in_words(None), left_out=left_out)
    return _head(file, servers) + intro + '\n'.join(_route_text(draft) for draft in found)


def _route_text(draft: Draft) -> str:
    lines = list(_route_lines(draft))
    notes = ''.join(_commented(comment, '  ') for comment in draft.comments)
    if not draft.problem:
        return notes + ''.join(f'  {line}\n' for line in lines)
    reason = _commented(draft.problem, '  ')
    return reason + notes + ''.join(f'  # {_plain(line)}\n' for line in lines)


def _route_lines(draft: Draft) -> Iterator[str]:
    ros = f'ros: {scalar(draft.ros)}, type: {scalar(draft.message_type)}'
    kafka = f'kafka: {scalar(draft.kafka)}'
    yield f'- name: {scalar(draft.name)}'
    if draft.way == 'to Kafka':
        yield f'  from: {{{ros}}}'
        yield f'  to: {{{kafka}}}'
    else:
        qos = ', qos: {durability: transient_local}' if draft.latched else ''
        yield f'  from: {{{kafka}, start: latest}}'
        yield f'  to: {{{ros}{qos}}}'
    yield f'  format: {draft.format}'


def _commented(text: str, indent: str) -> str:
    lines = textwrap.wrap(
        _plain(text), _WIDTH - len(indent) - 2, break_on_hyphens=False, break_long_words=False
    )
    return ''.join(f'{indent}# {line}\n' for line in lines)


def _plain(text: str) -> str:
    """The text in one line: names come from the network, and may hold anything."""
    return ''.join(char if char.isprintable() else '?' for char in text)


def scalar(text: str) -> str:
    """The text as a YAML scalar, in quotes where it would be read as something else."""
    try:
        read = YAML(typ='safe').load(StringIO(f'[{text}]'))
    except YAMLError:
        read = None
    return text if read == [text] else "'" + text.replace("'", "''") + "'"


# File


def _refuse_existing(file: Path, *, force: bool) -> None:
    if os.path.exists(file) and not force:  # noqa: PTH110 (that of a path can raise)
        raise _there_already(file)


def _there_already(file: Path) -> ConfigError:
    return ConfigError([f'{file}: is there already: name another file, or say --force'])


def _write(file: Path, text: str, *, force: bool) -> None:
    """Write what is known to be right; a file that came meanwhile is kept.

    Raises:
        ConfigError: It is not right, or cannot be written.
    """
    loads(text, str(file), os.environ)
    try:
        with file.open('w' if force else 'x', encoding='utf-8') as opened:
            opened.write(text)
    except FileExistsError:
        raise _there_already(file) from None
    except OSError as error:
        raise ConfigError([f'{file}: cannot be written: {error.strerror}']) from error
