"""A real Schema Registry: the same as with the strict one of the unit tests, where it matters."""

import json
import math
import urllib.request
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from confluent_kafka.schema_registry import (
    Schema,
    SchemaReference,
    SchemaRegistryClient,
    SchemaRegistryError,
)
from support.formats.avro import (
    ROBOT,
    STOP,
    avro_bytes,
    cdr_from,
    fields_of,
    framed,
    json_text,
    scope_of,
)
from support.formats.messages import extremes, layout_of
from support.registry.apicurio import NoRegistryError, local_registry

from ros2_kafka_bridge.errors import ConfigError, DecodeError
from ros2_kafka_bridge.formats import FORMATS
from ros2_kafka_bridge.formats.avro import make_decode, make_encode
from ros2_kafka_bridge.formats.avro.schema import avro_schema
from ros2_kafka_bridge.formats.protobuf.schema import make_files, protobuf_sources
from ros2_kafka_bridge.message_types import type_names
from ros2_kafka_bridge.message_types.layout import (
    Array,
    Constant,
    Field,
    Layout,
    Primitive,
    Sequence,
    String,
)

PROTOBUF = FORMATS['protobuf']
NEWER = Layout(ROBOT.type_name, (*ROBOT.fields, Field('battery', Primitive('float32'))))


@pytest.fixture(scope='module')
def registry() -> Iterator[str]:
    try:
        with local_registry() as url:
            yield url
    except NoRegistryError as error:
        pytest.skip(str(error))


def require(url: str, subject: str, level: str) -> None:
    """Make a subject take only what is compatible: a registry of this make takes all."""
    request = urllib.request.Request(  # noqa: S310 -- our own registry
        f'{url}/config/{subject}',
        json.dumps({'compatibility': level}).encode(),
        {'Content-Type': 'application/vnd.schemaregistry.v1+json'},
        method='PUT',
    )
    with urllib.request.urlopen(request, timeout=10):  # noqa: S310 -- the same
        pass


def test_every_type_comes_back_through_a_real_registry(registry: str) -> None:
    for name in type_names():
        scope = scope_of(registry, name.replace('/', '.'))
        encode, decode = make_encode(layout_of(name), scope), make_decode(layout_of(name), scope)
        for value in extremes(name):
            assert decode(encode(value)) == value, name


def test_a_real_registry_keeps_the_schema_whole(registry: str, topic_name: str) -> None:
    make_encode(ROBOT, scope_of(registry, topic_name))
    with SchemaRegistryClient({'url': registry}) as client:
        kept = client.get_latest_version(f'{topic_name}-value').schema.schema_str
    assert kept is not None
    assert json.loads(kept) == avro_schema(ROBOT)


@pytest.mark.parametrize('strategy', ['topic', 'record', 'topic_record'])
def test_a_schema_is_looked_up_in_a_real_registry(
    registry: str, unique: Callable[[str], str], strategy: str
) -> None:
    """Spaces, as people print it, make no other schema."""
    layout = Layout(f'demo_msgs/msg/{unique("One").replace("-", "_")}', STOP.fields)
    topic = unique('topic')
    scope = scope_of(registry, topic, auto_register=False, subject=strategy)
    with pytest.raises(ConfigError, match='has no schema of demo_msgs/msg/One'):
        make_encode(layout, scope)
    name = layout.type_name.replace('/', '.')
    subject = {'topic': f'{topic}-value', 'record': name, 'topic_record': f'{topic}-{name}'}
    with SchemaRegistryClient({'url': registry}) as client:
        text = json.dumps(avro_schema(layout), indent=2)
        client.register_schema(subject[strategy], Schema(text, 'AVRO'))
    value = cdr_from(layout, {'x': 1.5})
    assert make_decode(layout, scope)(make_encode(layout, scope)(value)) == value


def test_a_real_registry_says_what_is_incompatible(registry: str, topic_name: str) -> None:
    scope = scope_of(registry, topic_name)
    make_encode(ROBOT, scope)
    require(registry, f'{topic_name}-value', 'FULL_TRANSITIVE')
    # A field that comes and one that goes are compatible both ways, because all have defaults.
    more = Layout(ROBOT.type_name, (*ROBOT.fields[1:], Field('battery', Primitive('float32'))))
    make_encode(more, scope)
    changed = Layout(ROBOT.type_name, (Field('level', String()), *ROBOT.fields[2:]))
    with pytest.raises(ConfigError, match='the schema is not compatible') as raised:
        make_encode(changed, scope)
    assert f'subject {topic_name}-value' in str(raised.value)
    assert 'reader type: STRING not compatible with writer type: INT' in str(raised.value)


def test_a_real_registry_compares_a_type_with_what_avro_can_say_no_default_of(
    registry: str, topic_name: str
) -> None:
    """It does so in Java, whose library looks at each default."""
    kind = Primitive('uint64')
    inner = Layout('demo_msgs/msg/Inner', (Field('v', Primitive('float32'), math.nan),))
    fields = (Field('one', inner), Field('large', Array(Primitive('float64'), 5000)))
    most = Constant('MOST', kind, 2**64 - 1)
    old = Layout('demo_msgs/msg/Odd', fields, (most,))
    new = Layout('demo_msgs/msg/Odd', (*fields, Field('id', kind, 7)), (most,))
    make_encode(old, scope_of(registry, topic_name))
    require(registry, f'{topic_name}-value', 'FULL_TRANSITIVE')
    make_encode(new, scope_of(registry, topic_name))


def test_another_version_is_read_from_a_real_registry(registry: str, topic_name: str) -> None:
    scope = scope_of(registry, topic_name)
    raw = Field('raw', Array(Primitive('uint8'), 2), (1, 255))
    newer = Layout(ROBOT.type_name, (*ROBOT.fields, raw, Field('id', Primitive('uint64'), 7)))
    old = make_encode(ROBOT, scope)(cdr_from(ROBOT, {'level': 3}))
    new = make_encode(newer, scope)(cdr_from(newer, {'level': 4, 'raw': b'ab'}))
    found: Any = fields_of(make_decode(newer, scope)(old), newer)
    assert (found['level'], found['raw'], found['id']) == (3, b'\x01\xff', 7)
    assert fields_of(make_decode(ROBOT, scope)(new), ROBOT)['level'] == 4


def test_references_are_read_from_a_real_registry(registry: str, topic_name: str) -> None:
    part = avro_schema(STOP)
    layout = Layout('demo_msgs/msg/Way', (Field('stops', Sequence(STOP)),))
    whole: Any = avro_schema(layout)
    payload = avro_bytes(whole, {'stops': [{'x': 1.5, 'mark': 'm'}]})
    whole['fields'][0]['type']['items'] = 'demo_msgs.msg.Stop'
    with SchemaRegistryClient({'url': registry}) as client:
        client.register_schema(f'{topic_name}-part', Schema(json_text(part), 'AVRO'))
        reference = SchemaReference('demo_msgs.msg.Stop', f'{topic_name}-part', 1)
        schema = Schema(json_text(whole), 'AVRO', [reference])
        schema_id = client.register_schema(f'{topic_name}-value', schema)
    found = make_decode(layout, scope_of(registry, topic_name))(framed(schema_id, payload))
    assert fields_of(found, layout) == {'stops': [{'x': 1.5, 'mark': 'm'}]}


def test_an_id_that_a_real_registry_does_not_know_is_a_bad_record(registry: str) -> None:
    decode = make_decode(ROBOT, scope_of(registry))
    with pytest.raises(DecodeError, match='has no schema with the id 2147480000'):
        decode(framed(2147480000, b'\0'))


def test_every_type_comes_back_through_a_real_registry_as_protobuf(registry: str) -> None:
    for name in type_names():
        layout, scope = layout_of(name), scope_of(registry, f'protobuf.{name.replace("/", ".")}')
        encode, decode = PROTOBUF.make_encode(layout, scope), PROTOBUF.make_decode(layout, scope)
        for value in extremes(name):
            assert decode(encode(value)) == value, name


def test_another_version_of_protobuf_is_read_from_a_real_registry(
    registry: str, topic_name: str
) -> None:
    scope = scope_of(registry, topic_name)
    old = PROTOBUF.make_encode(ROBOT, scope)(cdr_from(ROBOT, {'level': 3}))
    new = PROTOBUF.make_encode(NEWER, scope)(cdr_from(NEWER, {'level': 4, 'battery': 0.5}))
    found: Any = fields_of(PROTOBUF.make_decode(NEWER, scope)(old or b''), NEWER)
    assert (found['level'], found['battery']) == (3, 0)
    assert fields_of(PROTOBUF.make_decode(ROBOT, scope)(new or b''), ROBOT)['level'] == 4


def test_a_real_registry_that_cannot_compare_descriptors_is_told_with_the_cure(
    registry: str, topic_name: str
) -> None:
    scope = scope_of(registry, topic_name)
    PROTOBUF.make_encode(ROBOT, scope)
    require(registry, f'{topic_name}-value', 'BACKWARD')
    PROTOBUF.make_encode(ROBOT, scope)
    with pytest.raises(ConfigError, match='cannot compare a descriptor') as raised:
        PROTOBUF.make_encode(NEWER, scope)
    assert 'ros2-kafka-bridge schema demo_msgs/msg/Robot --format protobuf' in str(raised.value)
    assert len(str(raised.value)) < 500


def test_versions_that_were_registered_as_text_are_looked_up_in_a_real_registry(
    registry: str, topic_name: str
) -> None:
    """With the rule that keeps them compatible."""
    scope = scope_of(registry, topic_name, auto_register=False)
    with pytest.raises(ConfigError, match='has no schema of demo_msgs/msg/Robot'):
        PROTOBUF.make_encode(ROBOT, scope)
    for layout in (ROBOT, NEWER):
        register_text(registry, f'{topic_name}-value', layout)
        require(registry, f'{topic_name}-value', 'BACKWARD')
        value = cdr_from(layout, {'level': 3})
        record = PROTOBUF.make_encode(layout, scope)(value)
        assert PROTOBUF.make_decode(layout, scope)(record) == value
    changed = Layout(ROBOT.type_name, (Field('name', Primitive('float64')), *ROBOT.fields[1:]))
    with pytest.raises(SchemaRegistryError, match='Incompatible artifact'):
        register_text(registry, f'{topic_name}-value', changed)


def register_text(url: str, subject: str, layout: Layout) -> None:
    """Register what `schema` prints, as a user does."""
    sources = protobuf_sources(layout)
    references: dict[str, SchemaReference] = {}
    *inner, root = make_files(layout)
    with SchemaRegistryClient({'url': url}) as client:
        for file in (*inner, root):
            place = subject if file is root else file.name
            imported = [references[name] for name in file.dependency if name in references]
            schema = Schema(sources[file.name], 'PROTOBUF', imported)
            client.register_schema(place, schema)
            version = client.lookup_schema(place, schema).version
            references[file.name] = SchemaReference(file.name, place, version)
