"""A configuration is read whole, or refused with every mistake in it."""

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import pytest
from pydantic import ValidationError
from support.install.schemas import schema_problems
from support.said import fits, misfits

from ros2_kafka_bridge.config.checks import KeyPart, key_parts
from ros2_kafka_bridge.config.file import load, loads
from ros2_kafka_bridge.config.mistakes import field_names
from ros2_kafka_bridge.config.settings import (
    Config,
    FromKafka,
    JsonSettings,
    KafkaToRosRoute,
    QoS,
    RosToKafkaRoute,
    SchemaRegistrySettings,
    SchemaSettings,
    ToRos,
    masked,
    warnings,
)
from ros2_kafka_bridge.config.validation import plain, validated
from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.kafka.properties import is_secret
from ros2_kafka_bridge.kafka.property_check import property_problems

FILES = Path(__file__).parent / 'files'
SCHEMA = json.loads((Path(__file__).parents[3] / 'docs' / 'bridge.schema.json').read_text('utf-8'))
EXPECTED = '#! '
SECRET = 'hunter2-is-secret'  # noqa: S105  # made up, to be looked for
ENVIRON = {'BROKERS': 'broker:9093', 'PASSWORD': SECRET, 'DOMAIN': '7'}
EXAMPLE = """\
name: warehouse-1
kafka:
  bootstrap.servers: localhost:9092
ros: {domain_id: 0}
defaults: {drain_s: 8}
routes:
  - name: orders
    from: {kafka: orders, start: earliest}
    to: {ros: /orders, type: std_msgs/msg/String}
    format: text
  - name: orders_returned
    from: {ros: /orders}
    to: {kafka: orders.returned}
    format: text
"""


def check_type(name: str, _message_path: Sequence[Path] | None) -> str | None:
    if name.endswith('/Strin'):
        return f'no message type {name} here (did you mean std_msgs/msg/String?)'
    return None


def problems_of(text: str, environ: Mapping[str, str] | None = None) -> list[str]:
    with pytest.raises(ConfigError) as caught:
        loads(text, 'bridge.yaml', environ or {}, check_type, property_problems)
    return caught.value.problems


def with_kafka(line: str) -> str:
    return EXAMPLE.replace('ros: {domain_id', f'  {line}\nros: {{domain_id')


@pytest.mark.parametrize('file', sorted(FILES.glob('bad_*.yaml')), ids=lambda path: path.stem)
def test_a_bad_file_is_refused_with_the_line_the_field_and_the_cure_of_each_mistake(
    file: Path,
) -> None:
    text, *expected = file.read_text('utf-8').split(EXPECTED)
    assert expected, 'the file names no mistake'
    problems = problems_of(text, {'TEXT': 'soon'})
    found = [problem.removeprefix('bridge.yaml:') for problem in problems]
    assert misfits(found, expected) == []


def test_the_example_of_the_docs_is_read() -> None:
    config = loads(EXAMPLE, 'bridge.yaml', {}, check_type, property_problems)
    orders, returned = config.routes
    assert isinstance(orders, KafkaToRosRoute)
    assert isinstance(returned, RosToKafkaRoute)
    assert (orders.source.kafka, orders.source.start) == ('orders', 'earliest')
    assert (orders.sink.ros, orders.sink.type) == ('/orders', 'std_msgs/msg/String')
    assert orders.group(config.name) == 'warehouse-1.orders'
    assert orders.dead_letter_topic == 'orders.dead-letters'
    assert (orders.max_in_flight, orders.min_subscribers, orders.drain_s) == (500, 1, 8)
    assert (returned.source.ros, returned.source.type) == ('/orders', None)
    assert (returned.max_in_flight, returned.max_in_flight_bytes) == (2000, 16 * 1024 * 1024)
    assert returned.dead_letter_topic == 'orders.returned.dead-letters'
    assert warnings(config) == []


def test_everything_can_be_said() -> None:
    config = load(FILES / 'good_full.yaml', ENVIRON, check_type, property_problems)
    orders, returned = config.routes
    assert isinstance(orders, KafkaToRosRoute)
    assert isinstance(returned, RosToKafkaRoute)
    assert config.ros.domain_id == 7
    assert config.kafka['sasl.password'] == SECRET
    assert config.kafka['socket.keepalive.enable'] is True
    assert orders.group(config.name) == 'g'
    assert orders.dead_letter_topic == 'dead'
    assert orders.sink.qos == QoS(
        reliability='reliable', durability='transient_local', history='keep_last', depth=5
    )
    assert returned.sink.properties == {'compression.type': 'zstd'}


def test_a_default_counts_where_it_fits_and_where_the_route_says_nothing() -> None:
    orders, returned = load(FILES / 'good_full.yaml', ENVIRON).routes
    assert isinstance(orders, KafkaToRosRoute)
    assert (orders.format, orders.drain_s, orders.min_subscribers) == ('text', 4, 2)
    assert (returned.format, returned.drain_s) == ('cdr', 4)


def test_a_default_of_a_format_counts_for_the_routes_of_that_format() -> None:
    config = load(FILES / 'good_formats.yaml', ENVIRON)
    plain, own, avro, fixed, text = config.routes
    assert plain.json_settings == JsonSettings(missing='default', non_finite='null')
    assert own.json_settings == JsonSettings(integers='string')
    assert avro.schema_settings == SchemaSettings(auto_register=False)
    assert fixed.schema_settings == SchemaSettings(registry=False)
    assert (text.json_settings, text.schema_settings) == (None, None)
    assert isinstance(plain, KafkaToRosRoute)
    assert not plain.check_type_hash


def test_a_missing_extra_is_a_mistake_of_the_format() -> None:
    text = EXAMPLE.replace('text', 'json', 1)
    with pytest.raises(ConfigError) as caught:
        loads(text, 'bridge.yaml', {}, check_format=lambda name: f'{name} is not here')
    assert caught.value.problems == [
        'bridge.yaml:10: routes[0].format: json is not here',
        'bridge.yaml:14: routes[1].format: text is not here',
    ]


def test_a_type_is_looked_for_in_the_folders_of_the_file_too(tmp_path: Path) -> None:
    seen: list[Path] = []

    def check(_name: str, message_path: Sequence[Path] | None) -> None:
        seen[:] = message_path or ()

    (tmp_path / 'messages').mkdir()
    path = tmp_path / 'bridge.yaml'
    path.write_text(EXAMPLE.replace('domain_id: 0', 'message_path: [messages]'))
    config = load(path, {}, check)
    assert config.ros.message_path == seen == [tmp_path / 'messages']


def test_the_client_of_a_schema_registry_knows_every_property() -> None:
    from confluent_kafka.schema_registry import SchemaRegistryClient  # noqa: PLC0415 (heavy)

    for name in field_names(SchemaRegistrySettings).keys() - {'url'}:
        if not name.startswith('bearer'):  # tokens are read only once their source is named
            with pytest.raises((ValueError, TypeError, OSError)) as caught:
                SchemaRegistryClient({'url': 'http://localhost:1', name: 'a:b', 'no': 1})
            assert name not in str(caught.value).partition('Unrecognized')[2]
    tokens = {
        'bearer.auth.credentials.source': 'STATIC_TOKEN',
        'bearer.auth.token': 'x',
        'bearer.auth.logical.cluster': 'y',
        'bearer.auth.identity.pool.id': 'z',
    }
    SchemaRegistryClient({'url': 'http://localhost:1', **tokens})


def test_a_doubled_dollar_is_no_variable() -> None:
    config = loads(with_kafka("client.id: '$${X}-$5'"), 'bridge.yaml', {})
    assert config.kafka['client.id'] == '${X}-$5'


def test_a_secret_is_read_from_a_file_beside_the_configuration(tmp_path: Path) -> None:
    (tmp_path / 'password').write_text(f'{SECRET}\n')
    (tmp_path / 'key.pem').write_text('two\nlines\r\n')
    path = tmp_path / 'bridge.yaml'
    path.write_text(
        with_kafka(
            'sasl.password: ${file:password}\n  ssl.key.pem: ${file:key.pem}\n'
            f'  client.id: a-${{file:{tmp_path}/password}}'
        )
    )
    kafka = load(path, {}).kafka
    assert kafka['sasl.password'] == SECRET
    assert kafka['ssl.key.pem'] == 'two\nlines'
    assert kafka['client.id'] == f'a-{SECRET}'


@pytest.mark.parametrize(
    ('content', 'expected'),
    [
        (None, 'no such file'),
        (b'\n', 'it is empty'),
        (b'\xff', 'not UTF-8: it holds no text'),
        (b'a' * 1_048_577, 'larger than 1048576 bytes: is it the right file?'),
    ],
)
def test_a_secret_that_cannot_be_read_is_said_with_line_and_field(
    tmp_path: Path, content: bytes | None, expected: str
) -> None:
    if content is not None:
        (tmp_path / 'password').write_bytes(content)
    path = tmp_path / 'bridge.yaml'
    path.write_text(with_kafka('sasl.password: ${file:password}'))
    with pytest.raises(ConfigError) as caught:
        load(path, {})
    assert caught.value.problems == [
        f'{path}:4: kafka.sasl.password: the file {tmp_path}/password: {expected}'
    ]


def test_a_variable_is_not_read_again() -> None:
    config = loads(with_kafka('client.id: ${X}'), 'bridge.yaml', {'X': '${Y}'})
    assert config.kafka['client.id'] == '${Y}'


def test_settings_are_made_in_python_too() -> None:
    route = KafkaToRosRoute(
        name='orders',
        source=FromKafka(kafka='orders'),
        sink=ToRos(ros='/orders', type='std_msgs/msg/String'),
        format='text',
    )
    config = Config(name='b', kafka={'bootstrap.servers': 'x'}, routes=[route])
    assert config.routes == [route]
    wrong = {'name': 'b', 'kafka': {'bootstrap.servers': 'x'}, 'routes': [route, route]}
    with pytest.raises(ValidationError, match='repeats the name of routes'):
        validated(Config, wrong)


@pytest.mark.parametrize(
    'line',
    [
        f'sasl.password: [{SECRET}]',
        f'sasl.password: {{a: {SECRET}}}',
        f'sasl.password: *{SECRET}',
        f'sasl.password: !{SECRET} x',
        f'sasl.password: "{SECRET}',
        f'sasl.password: {SECRET}: x',
        f'sasl.password: {SECRET}\n  sasl.password: {SECRET}',
        f'ssl.key.pem: {SECRET}\n  security.protocol: SSL',
        f'sasl.password: {SECRET}\n  lingr.ms: 5',
        'sasl.password: ${PASSWORD}\n  lingr.ms: 5',
        'ssl.key.pem: ${PASSWORD}\n  security.protocol: SSL',
        'enable.sasl.oauthbearer.unsecure.jwt: 5\n  sasl.oauthbearer.client.secret: ${PASSWORD}',
    ],
)
def test_no_mistake_shows_a_secret(line: str) -> None:
    with pytest.raises(ConfigError) as caught:
        loads(with_kafka(line), 'bridge.yaml', ENVIRON, check_type, property_problems)
    assert SECRET not in str(caught.value) + repr(caught.value)
    assert SECRET not in repr(caught.value.__cause__) + repr(caught.value.__context__)


def test_no_shown_configuration_shows_a_secret() -> None:
    config = load(FILES / 'good_full.yaml', ENVIRON)
    assert SECRET not in repr(config) + str(config) + str(masked(config))
    assert masked(config)['kafka']['sasl.password'] == '***'
    assert masked(config)['kafka']['sasl.username'] == 'robot'


def test_no_shown_configuration_shows_a_secret_of_a_schema_registry() -> None:
    config = load(FILES / 'good_formats.yaml', ENVIRON)
    assert SECRET not in repr(config) + str(config) + str(masked(config))
    registry = masked(config)['schema_registry']
    assert registry['basic.auth.user.info'] == registry['ssl.key.password'] == '***'
    assert registry['proxy'] == 'http://***@proxy:3128'
    assert config.schema_registry is not None
    assert config.schema_registry.properties()['basic.auth.user.info'] == f'bridge:{SECRET}'
    assert warnings(config) == [
        'schema_registry.ssl.ca.location: false: nobody checks who the registry is'
    ]


def test_an_editor_knows_the_secrets_of_a_schema_registry() -> None:
    fields = SCHEMA['$defs']['SchemaRegistrySettings']['properties']
    secret = {name for name, field in fields.items() if field.get('writeOnly')}
    assert secret == {name for name in fields if is_secret(name)}


def test_a_wrong_configuration_made_in_python_shows_no_secret() -> None:
    with pytest.raises(ValidationError) as caught:
        validated(Config, {'name': 'b', 'kafka': {'sasl.password': SECRET}, 'routes': []})
    assert SECRET not in str(caught.value) + repr(caught.value.errors())


def test_a_weaker_property_is_allowed_with_a_warning() -> None:
    text = with_kafka('acks: 1').replace(
        '{kafka: orders.returned}',
        '{kafka: orders.returned, properties: '
        '{enable.idempotence: false, delivery.timeout.ms: 5000, retries: 3}}',
    )
    config = loads(text, 'bridge.yaml', {}, check_type, property_problems)
    own = 'routes[1].to.properties'
    found = [re.split(r' falls?| \((?:order|full)', warning)[0] for warning in warnings(config)]
    assert found == [
        'kafka.acks: 1 also turns idempotence off: guarantee 2',
        f'{own}.enable.idempotence: false: guarantees 2 (without duplicates) and 3',
        f'{own}.delivery.timeout.ms: 5000: guarantees 2 (ROS -> Kafka at least once) and 4',
        f'{own}.retries: 3: guarantee 2 (ROS -> Kafka at least once)',
    ]


def test_a_weaker_quality_of_service_is_allowed_with_a_warning() -> None:
    text = EXAMPLE.replace('{ros: /orders}', '{ros: /orders, qos: {reliability: best_effort}}')
    [said] = warnings(loads(text, 'bridge.yaml', {}))
    assert fits(said, 'routes[1].from.qos.reliability: best_effort: guarantee 2 falls...')


def test_the_parts_of_a_key() -> None:
    assert key_parts('a-{ros.topic}{message.header.frame_id}') == (
        KeyPart('literal', 'a-'),
        KeyPart('ros.topic'),
        KeyPart('message', 'header.frame_id'),
    )


@pytest.mark.parametrize(
    ('content', 'expected'),
    [
        (b'name: b\nkafka: \xff\n', '{}:2: not UTF-8: save the file in this encoding'),
        (b'a' * 1_048_577, '{}: larger than 1048576 bytes: is it the right file?'),
        (None, '{}: no such file'),
    ],
)
def test_an_unreadable_file_is_one_sentence(
    tmp_path: Path, content: bytes | None, expected: str
) -> None:
    path = tmp_path / 'bridge.yaml'
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ConfigError) as caught:
        load(path, {})
    assert caught.value.problems == [expected.format(path)]


def test_a_directory_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(ConfigError) as caught:
        load(tmp_path, {})
    assert caught.value.problems == [f'{tmp_path}: a directory: name the file in it']


@pytest.mark.parametrize(
    ('text', 'line'),
    [
        (
            'a: &a [x, x, x, x, x, x, x, x, x]\n'
            + ''.join(
                f'{b}: &{b} [{", ".join([f"*{a}"] * 9)}]\n'
                for a, b in zip('abcdefgh', 'bcdefghi', strict=True)
            ),
            '1:8: more than 50000 values, aliases counted each time',
        ),
        ('[' * 5000, '1:52: nested too deeply for a configuration'),
    ],
)
def test_a_bomb_is_refused(text: str, line: str) -> None:
    assert problems_of(text) == [f'bridge.yaml:{line}']


@pytest.mark.parametrize('file', sorted(FILES.glob('good_*.yaml')), ids=lambda path: path.stem)
def test_the_schema_accepts_a_good_file(file: Path) -> None:
    text = file.read_text('utf-8').replace('"${DOMAIN}"', '7')
    config = loads(text, file.name, ENVIRON)
    assert not schema_problems(SCHEMA, plain(config))


@pytest.mark.parametrize(
    ('field', 'value'),
    [
        ('name', None),
        ('nmae', 'x'),
        ('routes', []),
        ('routes', [{'name': 'a', 'from': {'kafka': 'a'}, 'to': {'kafka': 'b'}}]),
        ('ros', {'domain_id': 233}),
        ('defaults', {'drain': 3}),
        ('kafka', {}),
        ('kafka', {'bootstrap.servers': [1]}),
    ],
)
def test_the_schema_refuses_a_bad_file(field: str, value: object) -> None:
    good = plain(loads(EXAMPLE, 'bridge.yaml', {}))
    assert not schema_problems(SCHEMA, good)
    assert schema_problems(SCHEMA, good | {field: value})
