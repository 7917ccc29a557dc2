"""What nodes may answer when they are asked for a type, and what comes of it."""

from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import pytest
from rclpy.exceptions import InvalidServiceNameException
from type_description_interfaces.msg import Field, FieldType, IndividualTypeDescription
from type_description_interfaces.srv import GetTypeDescription

from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.message_types import describe
from ros2_kafka_bridge.message_types.description import DescribedTypes, type_hash
from ros2_kafka_bridge.ros import type_request
from ros2_kafka_bridge.ros.node import RosNode
from ros2_kafka_bridge.ros.peer import Peer
from ros2_kafka_bridge.ros.type_request import _plain, ask_users

HEADER = 'std_msgs/msg/Header'
TYPES = describe(HEADER).types
HASH = type_hash(HEADER, TYPES)

Answer = Callable[[], Any]


def told(name: str) -> IndividualTypeDescription:
    """An installed type as ROS tells it."""
    fields = [
        Field(
            name=field.name,
            type=FieldType(
                type_id=field.type.type_id, nested_type_name=field.type.nested_type_name
            ),
        )
        for field in TYPES[name].fields
    ]
    return IndividualTypeDescription(type_name=name, fields=fields)


def answer(
    *others: IndividualTypeDescription, of: IndividualTypeDescription | None = None
) -> GetTypeDescription.Response:
    """The answer of a node."""
    response = GetTypeDescription.Response(successful=True)
    response.type_description.type_description = of or told(HEADER)
    response.type_description.referenced_type_descriptions = list(others)
    return response


def right() -> GetTypeDescription.Response:
    """What describes the header."""
    return answer(told('builtin_interfaces/msg/Time'))


def asked(
    nodes: dict[str, Answer],
    peers: Sequence[str] = (),
    wanted: str = HASH,
    sent: list[Any] | None = None,
) -> DescribedTypes:
    """Ask nodes, each of which answers so; what was sent to them is noted."""

    def create_client(_kind: Any, service: str) -> Any:
        client = MagicMock(srv_type=GetTypeDescription)
        give = nodes[service.removesuffix('/get_type_description')]
        if give is refuse:
            raise InvalidServiceNameException(service, 'error', 0)
        client.call_async = [].append if sent is None else sent.append
        client.handle.take_response.side_effect = lambda _: (None, give())
        return client

    node = RosNode(SimpleNamespace(create_client=create_client, destroy_client=MagicMock()), None)
    users = [
        Peer(name, HEADER, bytes(16), wanted, 'reliable', 'volatile', None)
        for name in peers or nodes
    ]
    return ask_users(node, lambda: users, HEADER, wanted, patience_s=0.3)


def refuse() -> Any:
    """A node whose name is none of ROS."""
    raise AssertionError


def not_utf8() -> Any:
    """An answer that rclpy cannot hand over."""
    raise UnicodeDecodeError('utf-8', b'\xff', 0, 1, 'invalid start byte')


def fails() -> Any:
    """A node that does not have it."""
    return GetTypeDescription.Response(failure_reason='no\nsuch type')


def flood() -> Any:
    """More than a type may have."""
    many = [Field(name=f'f{number}') for number in range(10_001)]
    return answer(IndividualTypeDescription(type_name='a/msg/B', fields=many))


def wordy() -> Any:
    """Defaults are not in the hash, and a hundred times as large once they are read."""
    told_so = told(HEADER)
    told_so.fields[1].default_value = 'x' * 20_001
    return answer(told('builtin_interfaces/msg/Time'), of=told_so)


def deep() -> Any:
    """What takes the reader itself down, should it forget a limit."""
    raise RecursionError('maximum recursion depth exceeded')


def huge() -> Any:
    """A message that takes all memory before anything of it is sent."""
    kind = FieldType(type_id=11 + 48, capacity=100_000_000)
    return answer(
        of=IndividualTypeDescription(type_name=HEADER, fields=[Field(name='a', type=kind)])
    )


def another() -> Any:
    """Another type under its name."""
    return answer(of=IndividualTypeDescription(type_name=HEADER, fields=[Field(name='a')]))


def nothing() -> None:
    """No answer yet."""


BAD: dict[str, tuple[Answer, str]] = {
    'its name': (refuse, 'Invalid service name'),
    'its text': (not_utf8, 'somebody in the ROS graph tells what cannot be read'),
    'its refusal': (fails, r'does not describe it: no\\nsuch type'),
    'its size': (flood, 'describes it by more than 10,000 fields'),
    'its defaults': (wordy, 'describes it with defaults of 20,001 characters'),
    'its depth': (deep, 'its answer makes no sense: RecursionError'),
    'its parts': (answer, 'tells nothing of builtin_interfaces/msg/Time'),
    'its lie': (another, 'describes another one: RIHS01_'),
    'its silence': (nothing, r'has not answered \(it may be off: start_type_description_service'),
}


@pytest.mark.parametrize(('give', 'said'), BAD.values(), ids=BAD)
def test_guarantee_6b_an_answer_of_no_use_is_told_with_its_node_and_the_cure(
    give: Answer, said: str
) -> None:
    with pytest.raises(RouteError, match=f'^nobody describes it: /robot .*{said}') as raised:
        asked({'/robot': give})
    assert str(raised.value).endswith('of ros.message_path, or install its package')
    assert '\n' not in str(raised.value)


@pytest.mark.parametrize('give', [give for give, _ in BAD.values()], ids=BAD)
def test_guarantee_6b_the_right_answer_of_another_node_counts(give: Answer) -> None:
    found = asked({'/bad': give, '/good': right})
    assert (found.types, found.origin) == (TYPES, 'is described by the node /good')


def test_guarantee_6b_a_type_whose_smallest_message_would_take_all_memory_is_not_taken() -> None:
    response = huge()
    wanted = type_hash(HEADER, {HEADER: _plain(response.type_description.type_description)})
    with pytest.raises(RouteError, match='describes a message of 800,000,000 bytes or more'):
        asked({'/robot': lambda: response}, wanted=wanted)


def test_a_question_that_was_lost_is_asked_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(type_request, '_AGAIN_S', 0.02)
    sent: list[Any] = []
    asked({'/busy': lambda: right() if len(sent) > 1 else None}, sent=sent)
    assert [(it.type_name, it.type_hash) for it in sent[:2]] == [(HEADER, HASH)] * 2


def test_types_that_it_does_not_hold_are_left_out() -> None:
    more = IndividualTypeDescription(type_name='a/msg/B', fields=[Field(name='x')])
    assert (
        asked({'/robot': lambda: answer(told('builtin_interfaces/msg/Time'), more)}).types == TYPES
    )


def test_no_more_than_five_nodes_are_asked_and_each_once() -> None:
    with pytest.raises(RouteError) as raised:
        asked(dict.fromkeys([f'/robot{number}' for number in range(9)], fails))
    assert str(raised.value).count('does not describe it') == 5
    assert asked({'/robot': right}, ['/robot', '/robot']).types == TYPES


def test_that_nobody_uses_it_any_more_is_told() -> None:
    node = RosNode(SimpleNamespace(), None)
    with pytest.raises(RouteError, match='no node that could be asked uses it'):
        ask_users(node, list, HEADER, HASH, patience_s=0.05)
