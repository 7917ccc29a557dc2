"""What `check` says of a route's format, and of what a Schema Registry would say to it."""

from typing import Any

import pytest
from support.registry.server import RegistryServer

from ros2_kafka_bridge.commands.check.formats import format_findings, registry_findings
from ros2_kafka_bridge.config.settings import Config
from ros2_kafka_bridge.config.validation import validated
from ros2_kafka_bridge.message_types import load_layout
from ros2_kafka_bridge.route.format import encode_of, with_docs

STRING, FLOAT = 'std_msgs/msg/String', 'std_msgs/msg/Float64'


def config(registry: RegistryServer, *, kind: str = STRING, **route: Any) -> Config:
    both = [
        {'name': 'out', 'from': {'ros': '/y', 'type': kind}, 'to': {'kafka': 'x'}, **route},
        {'name': 'in', 'from': {'kafka': 'x'}, 'to': {'ros': '/x', 'type': kind}, **route},
    ]
    return validated(
        Config,
        {
            'name': 'b',
            'kafka': {'bootstrap.servers': 'x'},
            'schema_registry': {'url': registry.url, 'max.retries': 0},
            'routes': both,
        },
    )


def told(made: Config, kind: str = STRING) -> list[tuple[str, str]]:
    """What is found of both routes, without where the registry is."""
    found = [
        finding
        for route in made.routes
        for finding in registry_findings(route, made, load_layout(kind))
    ]
    return [(f.level, f.text.partition(' of http')[0] + ':' + f.text[-60:]) for f in found]


@pytest.mark.parametrize('name', ['avro', 'protobuf'])
def test_a_schema_that_is_there_is_told_with_its_id_and_nothing_is_registered(
    registry: RegistryServer, name: str
) -> None:
    made = config(registry, format=name)
    out, back = told(made)
    assert out[0] == 'ok'
    assert 'is new: the schema is registered at the start' in out[1]
    assert back[0] == 'note'
    assert 'has no schema yet' in back[1]
    route = made.routes[0]
    encode_of(route, made, with_docs(route, made, load_layout(STRING)))  # type: ignore[arg-type]
    out, back = told(made)
    assert 'has the schema, with the id ' in out[1]
    assert 'has version 1, id ' in back[1]
    assert [out[0], back[0]] == ['ok', 'ok']


def test_a_schema_that_is_not_compatible_is_told_before_the_start(
    registry: RegistryServer,
) -> None:
    first = config(registry, format='avro')
    encode_of(first.routes[0], first, load_layout(STRING))  # type: ignore[arg-type]
    other = config(registry, kind=FLOAT, format='avro')
    [out, _] = told(other, FLOAT)
    assert out[0] == 'bad'
    assert out[1].endswith('of another schema, and this one is not compatible')


def test_a_schema_that_is_only_looked_up_and_not_there_is_told(registry: RegistryServer) -> None:
    made = config(registry, format='avro', schema={'auto_register': False})
    [found] = list(registry_findings(made.routes[0], made, load_layout(STRING)))
    assert found.level == 'bad'
    assert f'register what `ros2-kafka-bridge schema {STRING} --format avro` prints' in found.text


def test_a_registry_that_is_away_is_told(registry: RegistryServer) -> None:
    made = config(registry, format='protobuf')
    registry.stop()
    out, back = told(made)
    assert out[0] == back[0] == 'bad'
    assert 'does not answer' in out[1]


def test_a_format_that_cannot_carry_the_type_is_told_without_asking_anybody(
    registry: RegistryServer,
) -> None:
    made = config(registry, format='avro')
    [fine] = format_findings(made.routes[0], made, load_layout(STRING))
    assert (fine.level, fine.text) == ('ok', f'avro carries {STRING}')
    text = config(registry, format='text')
    [found] = format_findings(text.routes[1], text, load_layout(FLOAT))
    assert found.level == 'bad'
    assert f'text carries {STRING}, not {FLOAT}' in found.text
    assert format_findings(made.routes[0], made, None) == []
    assert registry.requests == []
