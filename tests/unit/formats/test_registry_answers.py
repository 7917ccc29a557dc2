"""What stands at the address of a Schema Registry may answer anything: guarantee 6b."""

import json
import time
import tracemalloc
from collections.abc import Iterator
from typing import Any

import pytest
from support.formats.avro import (
    ROBOT,
    avro_bytes,
    cdr_from,
    fields_of,
    framed,
    json_text,
    scope_of,
)
from support.registry import answers as endless
from support.registry.answers import ONCE, decode_error, encode_error
from support.registry.server import RegistryServer

from ros2_kafka_bridge.errors import ConfigError, DecodeError, RouteError
from ros2_kafka_bridge.formats import answers, avro, protobuf, registry
from ros2_kafka_bridge.formats.avro import make_decode
from ros2_kafka_bridge.formats.avro.schema import avro_schema

SCHEMA = json_text(avro_schema(ROBOT))
BODY = avro_bytes(avro_schema(ROBOT), fields_of(cdr_from(ROBOT, {}), ROBOT))
OTHER_404 = b'{"error_code": 404, "message": "HTTP 404 Not Found"}'
FORMATS = pytest.mark.parametrize('module', [avro, protobuf])


@pytest.fixture
def server() -> Iterator[RegistryServer]:
    with RegistryServer() as one:
        yield one


def asked(server: RegistryServer) -> list[str]:
    return [request.path for request in server.requests]


@FORMATS
@pytest.mark.parametrize('number', [2**31, 2**32 - 1])
def test_an_id_that_no_registry_gives_is_not_asked_for(
    server: RegistryServer, number: int, module: Any
) -> None:
    decode = module.make_decode(ROBOT, scope_of(server.url))
    with pytest.raises(DecodeError, match=f'the id {number} of a schema, and none is above'):
        decode(framed(number, b'\0a'))
    assert asked(server) == []


@FORMATS
def test_300_records_of_an_unknown_id_ask_once(server: RegistryServer, module: Any) -> None:
    decode = module.make_decode(ROBOT, scope_of(server.url))
    for _ in range(300):
        with pytest.raises(DecodeError, match='has no schema with the id 77'):
            decode(framed(77, b'\0a'))
    assert asked(server) == ['/schemas/ids/77']


def test_an_unknown_id_is_asked_for_again_after_some_seconds(
    server: RegistryServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(registry, '_MISSING_S', 0.0)
    decode = make_decode(ROBOT, scope_of(server.url))
    with pytest.raises(DecodeError, match='has no schema with the id 1'):
        decode(framed(1, BODY))
    assert server.register('robots-value', SCHEMA) == 1
    assert decode(framed(1, BODY)) == cdr_from(ROBOT, {})


def test_many_unknown_ids_are_not_all_remembered(server: RegistryServer) -> None:
    opened = registry.open_registry(scope_of(server.url))
    for number in range(1, 3000):
        opened._remember_missing(number)
    assert len(opened._missing) <= 1000


def test_a_404_of_http_is_a_bad_record_where_a_registry_answers(server: RegistryServer) -> None:
    """Some registries have no code of their own for it."""
    server.answer(404, 1, OTHER_404)
    server.answer(200, 1, b'{"compatibilityLevel": "BACKWARD"}')
    server.answer(404, 1, OTHER_404)
    error = decode_error(server.url, framed(77, b'\0a'))
    assert type(error) is DecodeError
    assert asked(server) == ['/schemas/ids/77', '/config', '/schemas/ids/77']


@pytest.mark.parametrize('body', [OTHER_404, b'{}', b'<html>', b'[]', b'{"compatibility": 1}'])
def test_a_404_of_something_else_loses_no_record(server: RegistryServer, body: bytes) -> None:
    server.answer(404, 1, OTHER_404)
    server.answer(404 if body == OTHER_404 else 200, 1, body)
    number = server.register('robots-value', SCHEMA)
    decode = make_decode(ROBOT, scope_of(server.url, 'robots', ONCE))
    with pytest.raises(RouteError, match=r'status 404\); does url name a Schema Registry'):
        decode(framed(number, BODY))
    assert decode(framed(number, BODY)) == cdr_from(ROBOT, {})


@pytest.mark.parametrize('answer', [endless.blanks_as_gzip, endless.blanks, endless.lists])
def test_an_answer_without_end_takes_little_memory(answer: endless.Answer) -> None:
    with endless.answering(answer) as url:
        tracemalloc.start()
        try:
            error = decode_error(url, framed(1, BODY))
            peak_bytes = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
    assert type(error) is RouteError
    assert 'its answer has more than 4,000,000 bytes: does url name a Schema Reg' in str(error)
    assert peak_bytes < 8 * answers.MOST_BYTES


def test_many_answers_to_one_question_have_a_bound_as_well(
    server: RegistryServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(answers, 'MOST_BYTES_IN_ALL', 10)
    assert 'its answers have more than 10 bytes' in str(decode_error(server.url, framed(1, BODY)))


@pytest.mark.parametrize('answer', [endless.slow_body, endless.slow_head, endless.nothing])
def test_an_answer_that_does_not_end_is_left(
    answer: endless.Answer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(answers, 'MOST_S', 0.5)
    began_s = time.monotonic()
    with endless.answering(answer) as url:
        for error in (decode_error(url, framed(1, BODY)), encode_error(url)):
            assert type(error) is RouteError
            assert f'Schema Registry {url}: ' in str(error)
    assert time.monotonic() - began_s < 15


def test_it_says_that_the_time_was_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(answers, 'MOST_S', 0.3)
    with endless.answering(endless.slow_body) as url:
        said = str(decode_error(url, framed(1, BODY)))
    assert 'its answers have not ended after 0.3 s: does url name a Schema Registry?' in said


@pytest.mark.parametrize(
    'answer', [endless.packed_otherwise, endless.many_heads, endless.redirects]
)
def test_an_answer_that_nobody_has_asked_for_is_an_error_of_the_route(
    answer: endless.Answer,
) -> None:
    with endless.answering(answer) as url:
        assert type(decode_error(url, framed(1, BODY))) is RouteError


def test_the_next_question_has_bounds_of_its_own(
    server: RegistryServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A registry that was slow once is asked again, by the same client."""
    number = server.register('robots-value', SCHEMA)
    decode = make_decode(ROBOT, scope_of(server.url, 'robots', ONCE))
    monkeypatch.setattr(answers, 'MOST_BYTES', 10)
    with pytest.raises(RouteError, match='its answer has more than 10 bytes'):
        decode(framed(number, BODY))
    monkeypatch.undo()
    assert decode(framed(number, BODY)) == cdr_from(ROBOT, {})


ODD = [
    b'{"id":' + b'9' * 5000 + b'}',
    b'{"schema":"\xff"}',
    b'[' * 100_000,
    b'{"a":' * 100_000,
    b'{"guid":"g"}',
    b'{"schema":"{}","ruleSet":{"domainRules":[{"mode":"X"}]}}',
    b'{"schema":1}',
    b'{"schema":true}',
    b'{"schema":NaN}',
    b'{"schema":"{}","schemaType":1}',
    b'{"schema":"{}","references":[{"name":"a","subject":"\\ud800","version":1}]}',
    b'{"schema":"{}","references":7}',
]


@FORMATS
@pytest.mark.parametrize('body', ODD, ids=range(len(ODD)))
def test_an_odd_answer_to_the_id_of_a_record_loses_none(
    server: RegistryServer, module: Any, body: bytes
) -> None:
    """It says nothing of the record, and is not remembered."""
    server.answer(200, 1, body)
    decode = module.make_decode(ROBOT, scope_of(server.url, 'robots', ONCE))
    with pytest.raises(RouteError, match='does url name a Schema Registry'):
        decode(framed(1, b'\0' + BODY))


@FORMATS
@pytest.mark.parametrize('status', [200, 404, 409, 422, 500])
@pytest.mark.parametrize('body', [*ODD[:5], b'{"id":1e999}', b'{"error_code":[1]}', b'{"id":"x"}'])
def test_an_odd_answer_to_a_schema_is_an_error_of_the_route(
    server: RegistryServer, module: Any, body: bytes, status: int
) -> None:
    server.answer(status, 4, body)
    with pytest.raises((RouteError, ConfigError)):
        module.make_encode(ROBOT, scope_of(server.url, 'robots', ONCE))


def test_an_odd_code_of_an_error_is_none(server: RegistryServer) -> None:
    server.answer(404, 1, b'{"error_code": [1], "message": {}}')
    assert type(decode_error(server.url, framed(1, BODY))) is RouteError


@pytest.mark.parametrize('items', ['float', 'double', 'boolean'])
def test_a_value_that_skips_beyond_its_end_is_a_bad_record_at_once(
    server: RegistryServer, items: str
) -> None:
    """Behind the end fastavro goes on, for as many items as it says: no other thread runs then."""
    extra = {'name': 'zz', 'type': {'type': 'array', 'items': items}}
    schema = avro_schema(ROBOT)
    wider = {**schema, 'fields': [*schema['fields'], extra]}
    number = server.register('robots-value', json.dumps(wider))
    decode = make_decode(ROBOT, scope_of(server.url, 'robots', ONCE))
    began_s = time.monotonic()
    with pytest.raises(DecodeError, match='it ends in the middle of a field'):
        decode(framed(number, BODY + zigzag(2**40)))
    assert time.monotonic() - began_s < 5
    assert decode(framed(number, BODY + b'\0')) == cdr_from(ROBOT, {})


@pytest.mark.parametrize(
    ('kind', 'value'),
    [
        ('bytes', b'\xd0\x0fab'),
        ('string', b'\xd0\x0fab'),
        ('double', b'abc'),
        ({'type': 'fixed', 'name': 'F', 'size': 8}, b'abc'),
    ],
)
def test_a_value_that_ends_in_a_field_that_is_skipped_is_a_bad_record(
    server: RegistryServer, kind: Any, value: bytes
) -> None:
    schema = avro_schema(ROBOT)
    wider = {**schema, 'fields': [*schema['fields'], {'name': 'zz', 'type': kind}]}
    number = server.register('robots-value', json.dumps(wider))
    decode = make_decode(ROBOT, scope_of(server.url, 'robots', ONCE))
    with pytest.raises(DecodeError, match='it ends in the middle of a field'):
        decode(framed(number, BODY + value))


def zigzag(number: int) -> bytes:
    """A number as Avro has it."""
    left, made = number << 1, bytearray()
    while left > 127:
        made.append(left & 127 | 128)
        left >>= 7
    return bytes([*made, left])
