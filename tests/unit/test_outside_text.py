"""What comes from outside is said: no words quote it, forge a line or command a terminal."""

import json
import logging
from collections.abc import Callable
from io import StringIO
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given, strategies
from rich.console import Console
from support.ros.ends import end_of

from ros2_kafka_bridge.commands.screen import Finding, show_findings, show_line, show_table
from ros2_kafka_bridge.errors import RecordError
from ros2_kafka_bridge.formats import FORMATS
from ros2_kafka_bridge.formats.scope import Scope
from ros2_kafka_bridge.logs import lines as logs
from ros2_kafka_bridge.logs.text import printable, printable_lines
from ros2_kafka_bridge.message_types.layout import Field, Layout, Primitive, Sequence, String
from ros2_kafka_bridge.ros.node import RosNode
from ros2_kafka_bridge.ros.peer import Peer
from ros2_kafka_bridge.ros.publishers import Publishers
from ros2_kafka_bridge.ros.subscribers import Subscribers
from ros2_kafka_bridge.ros.types import MessageType

SCOPE = Scope('topic')
LOG = logging.LoggerAdapter(logging.getLogger('test'), {})
STRING = Layout('std_msgs/msg/String', (Field('data', String()),))
HOSTILE = 'a\n2026-01-01 00:00:00,000 ERROR   b\r\x1b[31mc\x9b\u202ed\u2028e\x7f'


def error_of(convert: Callable[[bytes], object], value: bytes) -> str:
    try:
        convert(value)
    except RecordError as error:
        return str(error)
    return ''


@given(strategies.binary(max_size=60))
def test_no_error_quotes_what_a_value_holds(value: bytes) -> None:
    rich = Layout(
        'x/msg/X',
        (
            Field('flag', Primitive('bool')),
            Field('texts', Sequence(String(bound=3))),
            Field('wide', String(wide=True)),
        ),
    )
    marked = b'SECRET' + value + b'SECRET'
    for name, layout in (('text', STRING), ('cdr', STRING), ('cdr', rich)):
        for cdr in (marked, b'\0\1\0\0' + marked, b'\0\1\0\0\x20\0\0\0' + marked):
            for convert in (
                FORMATS[name].make_decode(layout, SCOPE),
                FORMATS[name].make_encode(layout, SCOPE),
            ):
                said = error_of(convert, cdr)
                assert 'SECRE' not in said
                assert b'SECRE'.hex(' ') not in said


@pytest.mark.parametrize('log_format', ['text', 'json'])
def test_hostile_text_forges_no_line_of_the_log(
    log_format: logs.LogFormat, capfd: pytest.CaptureFixture[str]
) -> None:
    logger = logging.getLogger('ros2_kafka_bridge')
    before = logger.handlers, logger.level, logger.propagate
    try:
        logs.set_up(log_format)
        logs.route_log('orders').warning('%s', HOSTILE)
        logs.route_log('orders').error('a bug', exc_info=ValueError(HOSTILE))
    finally:
        logger.handlers, logger.level, logger.propagate = before
    said = capfd.readouterr().err
    first, second, *rest = said.rstrip('\n').split('\n')
    assert all(character.isprintable() or character == '\n' for character in said)
    if log_format == 'json':
        assert not rest
        messages = [json.loads(line) for line in (first, second)]
        assert all(text.isprintable() for text in (messages[0]['message'], messages[1]['message']))
        assert '\x1b' not in messages[1]['traceback']
    else:
        assert first.endswith(printable(HOSTILE))
        assert all(line.startswith('    ') for line in rest), said


def test_what_is_printable_stays_as_it_is() -> None:
    text = 'Grüße, 世界 🤖 \\ "x"'
    assert printable(text) == text
    assert printable_lines('a\nb\x1b') == 'a\nb\\x1b'


@pytest.mark.parametrize('terminal', [True, False])
def test_hostile_names_command_no_terminal(terminal: bool) -> None:  # noqa: FBT001 (a parameter)
    out = StringIO()
    console = Console(file=out, force_terminal=terminal, color_system=None, width=200)
    show_table(console, 'Seen', ['topic', 'node'], [[[HOSTILE], ['fine']]])
    show_findings(console, 'Found', [Finding('bad', 'topic', HOSTILE, HOSTILE)])
    show_line(console, HOSTILE.replace('\n', ' '))
    assert '\x1b[31m' not in out.getvalue()
    assert not set('\r\x9b\u202e\u2028\x7f') & set(out.getvalue())
    assert not any(line.lstrip().startswith('2026') for line in out.getvalue().split('\n'))


def test_names_in_the_ros_graph_are_made_printable_where_they_are_read() -> None:
    qos = SimpleNamespace(
        durability=SimpleNamespace(name='VOLATILE'), reliability=SimpleNamespace(name='RELIABLE')
    )
    info = SimpleNamespace(
        node_namespace='/', node_name=HOSTILE, topic_type=HOSTILE, endpoint_gid=bytes(16),
        qos_profile=qos,
    )  # fmt: skip
    handle = SimpleNamespace(
        get_fully_qualified_name=lambda: '/me',
        get_topic_names_and_types=lambda: [(HOSTILE, [HOSTILE])],
        get_publishers_info_by_topic=lambda _: [info],
        get_subscriptions_info_by_topic=lambda _: [],
    )
    [topic] = RosNode(handle, None).topics()
    [peer] = topic.publishers
    assert all(text.isprintable() for text in (topic.name, *topic.types, peer.node))


def test_nodes_that_come_and_go_fill_neither_memory_nor_log(
    caplog: pytest.LogCaptureFixture,
) -> None:
    peers: list[Peer] = []
    node: Any = SimpleNamespace(subscribers=lambda _: peers)
    message_type = MessageType('p/msg/T', object, Layout('p/msg/T', ()), None)
    end = end_of(node, message_type)
    subscribers, publishers = Subscribers(end), Publishers(end)
    for number in range(50):
        peers = [Peer(f'/{number}', 'p/msg/X', bytes(16), '', 'reliable', 'volatile', None)]
        subscribers._note(peers)
        publishers._say_other_types(peers)
    assert len(subscribers._told) == len(publishers._strangers) == 1
    assert len(caplog.messages) == 10, 'five of each in ten seconds'
