"""Asking the nodes that use a type for its description (REP 2016).

What a node answers is a claim. Its hash is computed, and has to be the one that the graph shows;
what a hash does not cover, the defaults of fields, is taken as it is told.
"""

import logging
import random
import struct
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Any, Final

from ros2_kafka_bridge.errors import BridgeError, RouteError, blamed
from ros2_kafka_bridge.logs.text import printable
from ros2_kafka_bridge.message_types.description import (
    DescribedTypes,
    FieldDescription,
    FieldType,
    TypeDescription,
    held_names,
    make_layout,
    nested_names,
    type_hash,
)
from ros2_kafka_bridge.message_types.layout import PRIMITIVES, Array, Kind, Layout, Primitive
from ros2_kafka_bridge.message_types.source import CURE
from ros2_kafka_bridge.ros.errors import left_behind, translated
from ros2_kafka_bridge.ros.node import RosNode, told_by_others
from ros2_kafka_bridge.ros.peer import Peer

if TYPE_CHECKING:
    from rclpy.client import Client

LookAtUsers = Callable[[], list[Peer]]
"""Who publishes or subscribes to a topic now, as far as discovery knows."""

_PATIENCE_S: Final = 5.0
_SECOND_ANSWER_S: Final = 0.3
_LOOK_S: Final = 0.1
_POLL_S: Final = 0.01
_AGAIN_S: Final = 1.0
_MOST_NODES: Final = 5
_MOST_FIELDS: Final = 10_000  # as of a layout
_MOST_DEFAULTS: Final = 20_000  # characters: as objects of Python they are hundred times as large
_LARGEST_BYTES: Final = 10_000_000  # a record may make one of nothing, and that takes memory
_LENGTH_BYTES: Final = 4
_MOST_SHOWN: Final = 200
_SERVICE: Final = 'get_type_description'
_NO_ANSWER: Final = 'has not answered (it may be off: start_type_description_service)'


def ask_users(
    node: RosNode,
    look: LookAtUsers,
    name: str,
    wanted_hash: str,
    patience_s: float = _PATIENCE_S,
) -> DescribedTypes:
    """Ask the nodes that use a type, all at once, until one has told what has the right hash.

    Args:
        node: The bridge's own.
        look: Finds them.
        name: As `tf2_msgs/msg/TFMessage`.
        wanted_hash: The one that the graph shows.
        patience_s: How long they have for it.

    Raises:
        RouteError: None has told it in time.
    """
    until_s, look_at_s = time.monotonic() + patience_s, 0.0
    asked: dict[str, _Question] = {}
    problems: dict[str, str] = {}
    with ExitStack() as stack:
        while (now_s := time.monotonic()) < until_s:
            if now_s >= look_at_s:
                look_at_s = now_s + _LOOK_S
                new = [user for user in _users(look(), name, wanted_hash) if user not in asked]
                random.shuffle(new)  # silent ones shut nobody out for ever
                for user in new[: _MOST_NODES - len(asked)]:
                    asked[user] = _Question(stack, node, user, name, wanted_hash)
            for user, question in asked.items():
                try:
                    if found := question.answer():
                        return found
                except BridgeError as error:
                    problems[user] = printable(str(error))[:_MOST_SHOWN]
            if asked and asked.keys() == problems.keys():
                # Two nodes may have one name, and both answer.
                until_s = min(until_s, now_s + _SECOND_ANSWER_S)
            time.sleep(_POLL_S)
    told = [f'{user} {problems.get(user, _NO_ANSWER)}' for user in asked]
    raise RouteError(
        f'nobody describes it: {"; ".join(told) or "no node that could be asked uses it"}: {CURE}'
    )


def _users(peers: list[Peer], name: str, wanted_hash: str) -> list[str]:
    """The nodes to ask, each once: the graph tells the name of one a moment after its endpoint."""
    wanted = name, wanted_hash
    users = [p.node for p in peers if p.named and (p.message_type, p.type_hash) == wanted]
    return list(dict.fromkeys(users))


class _Question:
    """One question to one node.

    Args:
        stack: Keeps the client.
        node: The bridge's own.
        user: Whom to ask.
        name: Of the type.
        wanted_hash: Of the type.
    """

    def __init__(
        self, stack: ExitStack, node: RosNode, user: str, name: str, wanted_hash: str
    ) -> None:
        self._stack = stack
        self._node = node
        self._user = user
        self._name = name
        self._hash = wanted_hash
        self._client: Client[Any, Any] | None = None
        self._again_at_s = 0.0

    def answer(self) -> DescribedTypes | None:
        """What the node has answered; None where it has not yet.

        Raises:
            BridgeError: It cannot be asked, or its answer is of no use.
        """
        from ros2_kafka_bridge.ros.take import take_answer  # noqa: PLC0415 (heavy)

        if self._client is None:
            self._client = self._stack.enter_context(_client(self._node, self._user))
        if time.monotonic() >= self._again_at_s:
            self._ask(self._client)
        with blamed('its answer makes no sense'):
            with told_by_others('its answer'):
                told = take_answer(self._client)
            return None if told is None else self._checked(told)

    def _ask(self, client: 'Client[Any, Any]') -> None:
        """Send the request, once the service is there; again, as a busy one overwrites some."""
        with translated('its service'):
            if client.service_is_ready():
                self._again_at_s = time.monotonic() + _AGAIN_S
                request = client.srv_type.Request(type_name=self._name, type_hash=self._hash)
                client.call_async(request)

    def _checked(self, response: Any) -> DescribedTypes:
        if not response.successful:
            raise RouteError(f'does not describe it: {response.failure_reason}')
        told = response.type_description
        messages = [told.type_description, *told.referenced_type_descriptions]
        if sum(1 + len(message.fields) for message in messages) > _MOST_FIELDS:
            raise RouteError(f'describes it by more than {_MOST_FIELDS:,} fields')
        defaults = sum(len(field.default_value) for one in messages for field in one.fields)
        if defaults > _MOST_DEFAULTS:
            raise RouteError(f'describes it with defaults of {defaults:,} characters')
        return _described(
            self._name, self._hash, {it.type_name: _plain(it) for it in messages}, self._user
        )


def _plain(message: Any) -> TypeDescription:
    """A message of type_description_interfaces as a value of our own."""
    fields = ((field.name, field.type, field.default_value) for field in message.fields)
    return TypeDescription(
        message.type_name,
        tuple(
            FieldDescription(
                name,
                FieldType(it.type_id, it.capacity, it.string_capacity, it.nested_type_name),
                default,
            )
            for name, it, default in fields
        ),
    )


def _described(
    name: str, wanted_hash: str, told: Mapping[str, TypeDescription], user: str
) -> DescribedTypes:
    if missing := {name, *(held for it in told.values() for held in nested_names(it))} - {*told}:
        raise RouteError(f'tells nothing of {", ".join(sorted(missing))}')
    types = {one: told[one] for one in (name, *held_names(name, told))}
    computed = type_hash(name, types)
    if computed != wanted_hash:
        raise RouteError(f'describes another one: {computed} instead of {wanted_hash}')
    # A layout has no more than so many types and depths: all their hashes would take minutes.
    least_bytes = _least_bytes(make_layout(name, DescribedTypes(types, {})))
    if least_bytes > _LARGEST_BYTES:
        raise RouteError(f'describes a message of {least_bytes:,} bytes or more')
    hashes = {one: type_hash(one, types) for one in types}
    return DescribedTypes(types, hashes, f'is described by the node {user}')


def _least_bytes(kind: Kind) -> int:
    """How large the smallest message is, without what alignment adds: arrays are never empty."""
    match kind:
        case Array():
            return kind.length * _least_bytes(kind.item)
        case Layout():
            return sum(_least_bytes(field.kind) for field in kind.fields) or 1
        case Primitive():
            return struct.calcsize(PRIMITIVES[kind.name])
        case _:
            return _LENGTH_BYTES


@contextmanager
def _client(node: RosNode, user: str) -> Iterator['Client[Any, Any]']:
    from type_description_interfaces.srv import GetTypeDescription  # noqa: PLC0415 (with rclpy)

    where = f'client of {user}/{_SERVICE}'
    with translated(where), node.endpoint_lock:
        client = node.handle.create_client(GetTypeDescription, f'{user}/{_SERVICE}')
    try:
        yield client
    finally:
        log = logging.LoggerAdapter(logging.getLogger(__name__))
        with left_behind(log, where), node.endpoint_lock:
            node.handle.destroy_client(client)
