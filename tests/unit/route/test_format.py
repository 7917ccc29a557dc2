"""The functions of a route's format, with the limits around them."""

import tracemalloc
from typing import Any

import pytest

from ros2_kafka_bridge.config.settings import Config, KafkaToRosRoute, RosToKafkaRoute
from ros2_kafka_bridge.config.validation import validated
from ros2_kafka_bridge.errors import DecodeError, EncodeError, RecordTooLargeError
from ros2_kafka_bridge.formats import FORMATS, Format
from ros2_kafka_bridge.message_types import load_layout
from ros2_kafka_bridge.message_types.layout import Array, Field, Layout, Primitive, Sequence
from ros2_kafka_bridge.outside.extras import install_command, missing_extra
from ros2_kafka_bridge.route.format import asks_registry, decode_of, encode_of, scope_of

NUMBERS = load_layout('std_msgs/msg/Float64MultiArray')
BIG = Layout('demo_msgs/msg/Big', (Field('rows', Array(Primitive('float64'), 4000)),))
BIGS = Layout(
    'demo_msgs/msg/Bigs',
    (
        Field('items', Sequence(BIG)),
        Field('many', Sequence(Layout('demo_msgs/msg/Two', (Field('big', BIG),)))),
    ),
)


def config(**route: Any) -> Config:
    kind = {'type': 'std_msgs/msg/Float64MultiArray'}
    both = [
        {'name': 'in', 'from': {'kafka': 'x'}, 'to': {'ros': '/x', **kind}, **route},
        {'name': 'out', 'from': {'ros': '/y', **kind}, 'to': {'kafka': 'y'}, **route},
    ]
    registry = {'url': 'http://r:8081', 'basic.auth.user.info': 'a:b'}
    return validated(
        Config,
        {
            'name': 'b',
            'kafka': {'bootstrap.servers': 'x'},
            'schema_registry': registry,
            'routes': both,
        },
    )


def test_a_message_that_a_small_value_becomes_is_not_larger_than_the_route_allows() -> None:
    made = config(format='json', json={'missing': 'default'}, max_message_bytes=1000)
    route = made.routes[0]
    assert isinstance(route, KafkaToRosRoute)
    decode = decode_of(route, made, NUMBERS)
    assert decode(b'{"data": [1, 2]}')
    with pytest.raises(RecordTooLargeError, match='as a message: max_message_bytes of the route'):
        decode(b'{"data": [' + b'1,' * 200 + b'1]}')


@pytest.mark.parametrize(
    ('settings', 'small', 'attack'),
    [
        (
            {'format': 'json', 'json': {'missing': 'default'}},
            b'{"items": [{}, {}]}',
            b'{"items": [' + b'{},' * 10_000 + b'{}]}',
        ),
        (
            {'format': 'json', 'json': {'missing': 'default'}},
            b'{"many": [{}, {}]}',
            b'{"many": [' + b'{},' * 10_000 + b'{}]}',
        ),
        (
            {'format': 'protobuf', 'schema': {'registry': False}},
            b'\x0a\0' * 2,
            b'\x0a\0' * 10_000,
        ),
    ],
    ids=['json', 'json, nested', 'protobuf'],
)
def test_a_small_value_that_becomes_a_huge_message_is_refused_before_it_fills_memory(
    settings: dict[str, Any], small: bytes, attack: bytes
) -> None:
    made = config(**settings)
    route = made.routes[0]
    assert isinstance(route, KafkaToRosRoute)
    # The docs of a type that is not installed cannot be looked up.
    decode = FORMATS[route.format].make_decode(BIGS, scope_of(route, made))
    assert len(decode(small)) > 2 * 32_000
    tracemalloc.start()
    try:
        with pytest.raises(RecordTooLargeError, match=r'as a message: .* \(1000000 bytes\)'):
            decode(attack)
        most = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert most < 10_000_000


def test_a_value_that_grows_beyond_the_limit_is_an_error_that_keeps_the_message() -> None:
    made = config(format='json', max_message_bytes=1000)
    loose = config(format='json', json={'missing': 'default'})
    reader, route = loose.routes[0], made.routes[1]
    assert isinstance(reader, KafkaToRosRoute)
    assert isinstance(route, RosToKafkaRoute)
    cdr = decode_of(reader, loose, NUMBERS)(b'{"data": [' + b'0.1234567890123,' * 100 + b'1]}')
    assert len(cdr) < 1000
    with pytest.raises(EncodeError, match=rf'{len(cdr)} bytes as a message, \d+ bytes as json'):
        encode_of(route, made, NUMBERS)(cdr)


def test_a_bug_of_a_format_is_an_error_of_the_one_record(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_: bytes | None) -> bytes:
        raise TypeError('expected str')

    broken = Format(lambda *_: fail, lambda *_: fail, None)
    monkeypatch.setitem(FORMATS, 'json', broken)
    made = config(format='json')
    reader, route = made.routes
    assert isinstance(reader, KafkaToRosRoute)
    assert isinstance(route, RosToKafkaRoute)
    with pytest.raises(DecodeError, match=r"^the bridge's own decoder failed: TypeError: "):
        decode_of(reader, made, NUMBERS)(b'x')
    with pytest.raises(EncodeError, match=r"^the bridge's own encoder failed: TypeError: "):
        encode_of(route, made, NUMBERS)(b'x')


def test_a_format_knows_its_topic_and_the_registry_of_the_file() -> None:
    made = config(format='avro', schema={'subject': 'record'})
    scopes = [scope_of(route, made) for route in made.routes]
    assert [scope.topic for scope in scopes] == ['x', 'y']
    assert scopes[0].schema.subject == 'record'
    assert scopes[0].registry == {'url': 'http://r:8081', 'basic.auth.user.info': 'a:b'}
    assert asks_registry(made.routes[0])
    assert not asks_registry(config(format='avro', schema={'registry': False}).routes[0])
    assert not asks_registry(config(format='json').routes[0])


def test_what_an_extra_installs_is_asked_for_by_its_name(monkeypatch: pytest.MonkeyPatch) -> None:
    assert [missing_extra(name) for name in ('text', 'json', 'avro', 'protobuf')] == [None] * 4
    monkeypatch.setattr('ros2_kafka_bridge.outside.extras.find_spec', lambda _: None)
    assert missing_extra('json') is None
    said = missing_extra('avro') or ''
    assert said.startswith('avro needs fastavro, which is not installed: ')
    assert said.endswith(install_command('avro'))
