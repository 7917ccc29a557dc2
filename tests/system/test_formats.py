"""The formats with schemas, end to end: real Kafka, real DDS, and a strict Schema Registry."""

import json
import sys
from contextlib import ExitStack, closing
from pathlib import Path
from typing import NamedTuple

from confluent_kafka.schema_registry import Schema, SchemaRegistryClient
from support.bridges.routes import lines, values
from support.formats.messages import cdr, layout_of
from support.processes.harness import Bench, Process, eventually, headers
from support.registry.server import RegistryServer
from support.ros.package import build_package, write_package
from support.ros.raw import reader_of, received

from ros2_kafka_bridge.config.formats import SchemaSettings
from ros2_kafka_bridge.formats import FORMATS
from ros2_kafka_bridge.formats.avro.schema import avro_schema
from ros2_kafka_bridge.formats.scope import Scope
from ros2_kafka_bridge.message_types import load_layout
from ros2_kafka_bridge.message_types.layout import Layout

STRING = 'std_msgs/msg/String'
NODE = (sys.executable, '-m', 'rig.peers.ros_node')
FLOAT64 = 'std_msgs/msg/Float64'


def test_a_registry_that_goes_away_in_mid_stream_makes_the_route_wait_and_loses_nothing(
    bench: Bench, topic: str, registry: RegistryServer
) -> None:
    layout = layout_of(STRING)
    sent = [cdr(STRING, data=f'{number}') for number in range(6)]
    scope = Scope(topic, schema=SchemaSettings(), registry={'url': registry.url})
    encode = FORMATS['avro'].make_encode(layout, scope)
    known = [encode(one) or b'' for one in sent]
    # The same fields under another id: a second version, which only the registry knows.
    schema = Schema(json.dumps({**avro_schema(layout), 'doc': 'another'}), 'AVRO')
    with closing(SchemaRegistryClient({'url': registry.url})) as client:
        second = client.register_schema('x-value', schema)
    unknown = [b'\0' + second.to_bytes(4, 'big') + value[5:] for value in known]
    config = bench.config(
        [
            {
                'name': 'a',
                'from': {'kafka': topic, 'start': 'earliest'},
                'to': {'ros': '/out', 'type': STRING},
                'format': 'avro',
            }
        ],
        schema_registry={'url': registry.url, 'max.retries': 0},
    )
    with reader_of(bench, STRING), bench.drained(config) as bridge:
        bench.produce(topic, known[:2])
        assert received(bench, 2, bridge, STRING) == sent[:2]
        registry.stop()
        bench.produce(topic, [known[2], unknown[3], known[4], unknown[5]])
        bridge.wait_for('tried again in')
        bridge.wait_for('reads ', count=2)
        assert f'Schema Registry {registry.url}' in bridge.output()
        eventually(lambda: bench.committed(f'{bench.name}.a', topic) == 3, 60, bridge.output)
        registry.start()
        received(bench, 6, bridge, STRING)
        eventually(lambda: bench.committed(f'{bench.name}.a', topic) == 6, 60, bridge.output)
    assert received(bench, 6, bridge, STRING) == sent


def test_a_registry_that_is_away_at_the_start_holds_the_publishers_back_and_loses_nothing(
    bench: Bench, topic: str, registry: RegistryServer
) -> None:
    registry.stop()
    sent = [cdr(STRING, data=f'{number}') for number in range(50)]
    file = bench.place / 'sent'
    file.write_text(''.join(f'{one.hex()}\n' for one in sent))
    config = bench.config(
        [
            {
                'name': 'a',
                'from': {'ros': '/in', 'type': STRING},
                'to': {'kafka': topic},
                'format': 'protobuf',
            }
        ],
        schema_registry={'url': registry.url, 'max.retries': 0},
    )
    with (
        bench.drained(config) as bridge,
        bench.publisher('/in', '--file', str(file)) as publisher,
    ):
        publisher.wait_for('published 50', 60)
        bridge.wait_for('tried again in', 60)
        registry.start()
        found = values(bench.records(topic, 50))
    scope = Scope(topic, schema=SchemaSettings(), registry={'url': registry.url})
    decode = FORMATS['protobuf'].make_decode(layout_of(STRING), scope)
    assert [decode(value) for value in found] == sent


CRANE, SAID = 'acme_msgs/msg/Crane', {'name': 'north', 'load_t': 2.5}


class Version(NamedTuple):
    """A version of a package: the environment that has it, and the layout of its type."""

    environ: dict[str, str]
    layout: Layout


def versions(place: Path) -> dict[str, Version]:
    """Two of one package, built and installed."""
    made = {}
    for name, more in (('theirs', ''), ('ours', 'bool broken\n')):
        messages = {'Crane': f'string name\nfloat64 load_t\n{more}'}
        package = write_package(place / name, 'acme_msgs', messages)
        environ = build_package(package, place / f'{name}-install')
        made[name] = Version(environ, load_layout(CRANE, [place / name]))
    return made


def test_a_custom_message_is_carried_and_that_of_another_version_is_a_dead_letter(
    bench: Bench, topic_name: str
) -> None:
    built = versions(bench.place)
    hashes = {version: it.layout.type_hash for version, it in built.items()}
    decode = FORMATS['json'].make_decode(built['theirs'].layout, Scope(topic_name))
    cdr_bytes = decode(json.dumps(SAID).encode())
    (bench.place / 'sent').write_text(f'/in {CRANE} {cdr_bytes.hex()}\n')
    bridges = {}
    for version in built:
        bench.create_topic(f'{topic_name}.{version}')
        source, sink = {'ros': '/in', 'type': CRANE}, {'kafka': f'{topic_name}.{version}'}
        route = {'name': 'a', 'from': source, 'to': sink, 'format': 'json'}
        bridges[version] = bench.config([route], name=version)
    with ExitStack() as stack:
        for version, config in bridges.items():
            environ = built[version].environ
            bridge = stack.enter_context(bench.bridge(config, python=None, **environ))
            bridge.wait_for('subscribes to /in')
        words = '--durability', 'volatile', '--readers', '2'
        publisher = [*NODE, '--publish', str(bench.place / 'sent'), *words]
        log = bench.place / 'publisher.log'
        stack.enter_context(Process(publisher, log, bench.environ | built['theirs'].environ))
        [record] = bench.records(f'{topic_name}.theirs', 1)
        [letter] = bench.records(f'{topic_name}.ours.dead-letters', 1)
    assert json.loads(record.value() or b'') == SAID
    assert headers(record)['ros.type_hash'] == hashes['theirs']
    assert letter.value() == cdr_bytes
    error = headers(letter)['dead_letter.error']
    assert f'the publisher sends {CRANE} {hashes["theirs"]}' in error
    assert str(hashes['ours']) in error


def test_a_route_waits_while_a_subscriber_of_another_version_would_misread_it(
    bench: Bench, topic: str
) -> None:
    built = versions(bench.place)
    sent = [json.dumps({**SAID, 'broken': number % 2 == 0}).encode() for number in range(100)]
    source, sink = {'kafka': topic, 'start': 'earliest'}, {'ros': '/out', 'type': CRANE}
    route = {'name': 'to_ros', 'from': source, 'to': sink, 'format': 'json'}

    def reader(version: str) -> Process:
        takes = bench.place / f'{version}.takes'
        takes.write_text(f'/out {CRANE} {bench.place / version}.read\n')
        command = [*NODE, '--take', str(takes), '--durability', 'volatile']
        environ = bench.environ | built[version].environ
        return Process(command, bench.place / f'{version}.log', environ)

    with ExitStack() as stack:
        old = stack.enter_context(reader('theirs'))
        new = stack.enter_context(reader('ours'))
        for one in (old, new):
            one.wait_for('ready')
        environ = built['ours'].environ
        bridge = stack.enter_context(bench.bridge(bench.config([route]), python=None, **environ))
        bridge.wait_for('subscribes to it as')
        bench.produce(topic, sent)
        bridge.wait_for(f'would misread {CRANE}: install the same version of the package')
        assert not lines(bench.place / 'ours.read')
        old.end()
        bridge.wait_for('100 confirmed')
        assert bridge.end() == 0
    scope = Scope(topic)
    decode = FORMATS['json'].make_decode(built['ours'].layout, scope)
    encode = FORMATS['json'].make_encode(built['ours'].layout, scope)
    read = [encode(bytes.fromhex(line)) for line in lines(bench.place / 'ours.read')]
    assert read == [encode(decode(value)) for value in sent]
    assert not lines(bench.place / 'theirs.read')
