"""Keys and headers of the records that carry ROS messages."""

import pytest

from ros2_kafka_bridge.endpoints import Message
from ros2_kafka_bridge.errors import ConfigError, EncodeError
from ros2_kafka_bridge.formats import text
from ros2_kafka_bridge.formats.scope import Scope
from ros2_kafka_bridge.message_types.layout import Field, Layout, String
from ros2_kafka_bridge.route.identity import Author
from ros2_kafka_bridge.route.labels import make_headers, make_key

SCOPE = Scope('topic')
AUTHOR = Author('/orders', 'warehouse-1', 'returned')
LAYOUT = Layout('std_msgs/msg/String', (Field('data', String()),))
GID = bytes(range(16))
MESSAGE = Message(text.make_decode(LAYOUT, SCOPE)(b'shelf-7'), GID, 42, 1_700_000_000_000_000_000)


def test_headers_say_where_a_message_comes_from() -> None:
    headers = make_headers(AUTHOR, 'std_msgs/msg/String', lambda _: 'RIHS01_ab')
    assert headers(MESSAGE) == [
        ('ros.topic', b'/orders'),
        ('bridge.origin', b'warehouse-1'),
        ('bridge.route', b'returned'),
        ('ros.type', b'std_msgs/msg/String'),
        ('ros.type_hash', b'RIHS01_ab'),
        ('ros.gid', GID.hex().encode()),
        ('ros.seq', b'42'),
        ('ros.source_time_ns', b'1700000000000000000'),
    ]


def test_the_hash_of_a_publisher_that_is_not_known_yet_is_asked_again() -> None:
    known = iter([None, 'RIHS01_ab'])
    headers = make_headers(AUTHOR, 'std_msgs/msg/String', lambda _: next(known))
    told = [dict(headers(MESSAGE)).get('ros.type_hash') for _ in range(3)]
    assert told == [None, b'RIHS01_ab', b'RIHS01_ab']


def test_what_the_middleware_does_not_tell_is_left_out() -> None:
    headers = make_headers(AUTHOR, 'std_msgs/msg/String', lambda _: '')
    always = ['ros.topic', 'bridge.origin', 'bridge.route', 'ros.type']
    names = [name for name, _ in headers(MESSAGE._replace(gid=b'', seq=0))]
    assert names == [*always, 'ros.source_time_ns']
    for nothing_ns in (0, -1):
        timeless = headers(MESSAGE._replace(gid=b'', source_time_ns=nothing_ns))
        assert [name for name, _ in timeless] == [*always, 'ros.seq'], '1970 is no time'


@pytest.mark.parametrize(
    ('template', 'key'),
    [
        (None, b'/orders'),
        ('fixed', b'fixed'),
        ('{ros.topic}!', b'/orders!'),
        ('{ros.gid}', GID.hex().encode()),
        ('shelf {message.data}', b'shelf shelf-7'),
    ],
)
def test_a_key_follows_its_template(template: str | None, key: bytes) -> None:
    assert make_key(template, '/orders', LAYOUT)(MESSAGE) == key


def test_a_bug_in_the_making_of_a_key_is_an_error_of_that_message(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr('ros2_kafka_bridge.route.labels.make_reader', lambda *_: {}.__getitem__)
    with pytest.raises(EncodeError, match=r"^the bridge's own encoder failed: KeyError: "):
        make_key('{message.data}', '/orders', LAYOUT)(MESSAGE)


def test_a_key_of_an_unknown_field_is_refused_at_once() -> None:
    with pytest.raises(ConfigError, match='dta'):
        make_key('{message.dta}', '/orders', LAYOUT)
