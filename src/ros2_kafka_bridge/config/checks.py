"""What is true of names, keys and whole sets of routes; plain functions over plain values."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from ros2_kafka_bridge.config.mistakes import MISTAKES_TOLD
from ros2_kafka_bridge.kafka.properties import PropertyValue, canonical, has_weak_acks

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

KAFKA_NAME_LIMIT = 249
ROS_NAME_LIMIT = 247
NAME_LIMIT = 255
KEY_TEMPLATE_LIMIT = 1000
DEAD_LETTER_SUFFIX = '.dead-letters'

_PLACEHOLDER = re.compile(r'\{([^{}]*)\}')
_MESSAGE_FIELD = re.compile(r'message((?:\.[A-Za-z][A-Za-z0-9_]*)+)')
_TYPE = re.compile(r'([a-z][a-z0-9_]*)/msg/([A-Z][A-Za-z0-9]*)')
_SHORT_TYPE = re.compile(r'([a-z][a-z0-9_]*)(?:/|::|\.)(?:msg(?:/|::|\.))?([A-Z][A-Za-z0-9]*)')


@dataclass(frozen=True, slots=True)
class KeyPart:
    """A part of a key template: a literal text, or what is put in for each message.

    For `message`, text holds the path of the field, such as `header.frame_id`.
    """

    kind: Literal['literal', 'ros.topic', 'ros.gid', 'message']
    text: str = ''


def key_parts(template: str) -> tuple[KeyPart, ...]:
    """The parts of a key template, in order.

    Raises:
        ValueError: An unknown placeholder or an unbalanced brace.
    """
    if not template:
        raise ValueError('an empty key: leave it out, and the key is the ROS topic')
    if len(template) > KEY_TEMPLATE_LIMIT:
        raise ValueError(f'a key template has at most {KEY_TEMPLATE_LIMIT} characters')
    parts: list[KeyPart] = []
    end = 0
    for match in _PLACEHOLDER.finditer(template):
        parts += _literal(template[end : match.start()])
        parts.append(_placeholder(match[1]))
        end = match.end()
    return (*parts, *_literal(template[end:]))


def key_fields(template: str) -> list[str]:
    """The fields that a key template names; none of one that is wrong by itself."""
    try:
        return [part.text for part in key_parts(template) if part.kind == 'message']
    except ValueError:
        return []


def _literal(text: str) -> list[KeyPart]:
    if '{' in text or '}' in text:
        raise ValueError('a brace without its partner: placeholders are written {ros.topic}')
    return [KeyPart('literal', text)] if text else []


def _placeholder(name: str) -> KeyPart:
    if name == 'ros.topic':
        return KeyPart('ros.topic')
    if name == 'ros.gid':
        return KeyPart('ros.gid')
    field = _MESSAGE_FIELD.fullmatch(name)
    if field is not None:
        return KeyPart('message', field[1].removeprefix('.'))
    raise ValueError(
        f'no placeholder {{{name}}}: there are {{ros.topic}}, {{ros.gid}} and '
        '{message.<field>}, such as {message.header.frame_id}'
    )


def bridge_name(name: str) -> str:
    """The name of a bridge, if it is legal.

    Raises:
        ValueError: It is not.
    """
    if '.' in simple_name(name):
        raise ValueError(
            "a bridge has no '.' in its name: groups and spools are called <bridge>.<route>, so "
            f'another bridge could have the same; write {name.replace(".", "-")} '
            '(docs/configuration.md: how to keep its groups and spools)'
        )
    return name


def simple_name(name: str) -> str:
    """The name of a route, if it is legal; that of a bridge is one, too.

    Raises:
        ValueError: It is not.
    """
    if not re.fullmatch(r'[A-Za-z0-9._-]+', name):
        raise ValueError("a name is made of letters, digits, '.', '_' and '-'")
    if len(name) > NAME_LIMIT:
        raise ValueError(f'a name has at most {NAME_LIMIT} characters')
    return name


def absolute_path(path: str) -> str:
    """A path that means the same wherever the bridge is started.

    Raises:
        ValueError: It is relative, or holds a NUL.
    """
    if not path.startswith('/') or '\0' in path:
        raise ValueError('expected an absolute path, such as /var/lib/ros2-kafka-bridge')
    return path


def kafka_topic(name: str) -> str:
    """The name of a Kafka topic, if it is legal.

    Raises:
        ValueError: It is not.
    """
    _refuse_patterns(name)
    if not re.fullmatch(r'[A-Za-z0-9._-]+', name) or name in {'.', '..'}:
        raise ValueError("a Kafka topic is made of letters, digits, '.', '_' and '-'")
    if len(name) > KAFKA_NAME_LIMIT:
        raise ValueError(f'a Kafka topic has at most {KAFKA_NAME_LIMIT} characters')
    return name


def ros_topic(name: str) -> str:
    """The absolute name of a ROS topic, if it is legal.

    Raises:
        ValueError: It is not.
    """
    _refuse_patterns(name)
    if name.startswith('~'):
        raise ValueError("'~' is a node's own name: write the absolute name, such as /orders")
    if not re.fullmatch(r'/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*', name):
        raise ValueError(
            "a ROS topic is made of '/' and words of letters, digits and '_', "
            'none beginning with a digit, such as /orders'
        )
    if not name.startswith('/'):
        raise ValueError(f'a relative name: write /{name}')
    if len(name) > ROS_NAME_LIMIT:
        raise ValueError(f'a ROS topic has at most {ROS_NAME_LIMIT} characters')
    return name


def _refuse_patterns(name: str) -> None:
    found = [char for char in '{}*' if char in name] + ['^'] * name.startswith('^')
    if found:
        raise ValueError(f"'{found[0]}' in a name is kept for templates and patterns")


def message_type(name: str) -> str:
    """The name of a message type, if it is written `package/msg/Name`.

    Raises:
        ValueError: It is not.
    """
    if _TYPE.fullmatch(name):
        return name
    short = _SHORT_TYPE.fullmatch(name)
    right = f'{short[1]}/msg/{short[2]}' if short else 'package/msg/Name'
    raise ValueError(f'a message type is written {right}')


def repeats(names: Sequence[object]) -> dict[int, int]:
    """The place of each repeated name, with the place of its first use; None is no name."""
    first: dict[str, int] = {}
    places = [
        (place, first.setdefault(repr(name), place))
        for place, name in enumerate(names)
        if name is not None
    ]
    return {place: origin for place, origin in places if place != origin}


def cycles(edges: Iterable[tuple[int, str, str]]) -> dict[int, list[str]]:
    """The first cycles of routes, each under the number of the route that closes it.

    Args:
        edges: Number, source topic and sink topic of each route.
    """
    ways: dict[str, list[str]] = {}
    written: set[str] = set()
    found: dict[int, list[str]] = {}
    for number, source, sink in edges:
        # A topic that no route writes closes nothing, however long the way is that leads from it.
        way = _way(ways, sink, source) if source in written else None
        if way is not None:
            found[number] = _from_kafka([source, *way])
            if len(found) == MISTAKES_TOLD:
                break
            continue
        ways.setdefault(source, []).append(sink)
        written.add(sink)
    return found


def _way(ways: Mapping[str, list[str]], start: str, goal: str) -> list[str] | None:
    """The shortest way from one topic to another, both ends included."""
    came_from = {start: start}
    queue = [start]
    for topic in queue:
        if topic == goal:
            return _walked(came_from, goal)
        for following in ways.get(topic, ()):
            if following not in came_from:
                came_from[following] = topic
                queue.append(following)
    return None


def _walked(came_from: Mapping[str, str], goal: str) -> list[str]:
    way = [goal]
    while came_from[way[-1]] != way[-1]:
        way.append(came_from[way[-1]])
    return way[::-1]


def _from_kafka(cycle: list[str]) -> list[str]:
    """The same cycle, told from a Kafka topic on: that is where its records pile up."""
    if not cycle[0].startswith('/'):
        return cycle
    return [*cycle[1:], cycle[1]]


def weaker_properties(properties: Mapping[str, PropertyValue]) -> Iterator[str]:
    """A sentence for each librdkafka property that takes a guarantee away."""
    for name, value in properties.items():
        shown, plain = canonical(name), str(value).lower()
        if shown == 'acks' and has_weak_acks({name: value}):
            yield (
                f'{name}: {value} also turns idempotence off: guarantee 2 falls (ROS -> Kafka at '
                'least once, without duplicates): a broker that fails can lose what it confirmed'
            )
        elif shown == 'enable.idempotence' and plain in {'false', 'f', '0'}:
            yield (
                f'{name}: false: guarantees 2 (without duplicates) and 3 (order of each ROS '
                'publisher) fall: a record that is sent again can come twice or late'
            )
        elif shown == 'message.timeout.ms' and plain not in {'0', '0.0'}:
            yield (
                f'{name}: {value}: guarantees 2 (ROS -> Kafka at least once) and 4 (full means '
                'wait) fall: a record that waits longer is given up'
            )
        elif shown == 'retries':
            yield (
                f'{name}: {value}: guarantee 2 (ROS -> Kafka at least once) falls: a record that '
                'failed so often is given up'
            )
