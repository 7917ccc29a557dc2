"""librdkafka's properties reach the client that they belong to, and wrong ones are found."""

from http.server import BaseHTTPRequestHandler, HTTPServer

import confluent_kafka
import pytest

from ros2_kafka_bridge.kafka.properties import (
    common_properties,
    consumer_properties,
    is_secret,
    member_name,
    producer_properties,
    refusal,
)
from ros2_kafka_bridge.kafka.property_check import property_problems

MIXED: dict[str, str | int | float | bool] = {
    'bootstrap.servers': 'x:9092',
    'linger.ms': 7,
    'topic.acks': 'all',
    'session.timeout.ms': 9000,
    'socket.keepalive.enable': True,
    'statistics.interval.ms': 1e3,
}
OF_ALL = {
    'bootstrap.servers': 'x:9092',
    'client.id': 'bridge',
    'socket.keepalive.enable': 'true',
    'statistics.interval.ms': 1000,
}

TOKENS: dict[str, object] = {
    'security.protocol': 'SASL_SSL',
    'sasl.mechanisms': 'OAUTHBEARER',
    'sasl.oauthbearer.method': 'oidc',
    'sasl.oauthbearer.client.id': 'a',
    'sasl.oauthbearer.client.secret': 'hunter2',
    'sasl.oauthbearer.token.endpoint.url': 'https://login.example.org/token',
}


def test_a_consumer_gets_no_property_of_a_producer() -> None:
    made = consumer_properties(MIXED, group='g', client_id='bridge')
    assert made.items() >= OF_ALL.items()
    assert made['session.timeout.ms'] == 9000
    assert made['partition.assignment.strategy'] == 'cooperative-sticky'
    assert made['queued.max.messages.kbytes'] == 8192, 'docs/tuning.md promises that memory'
    assert made.keys().isdisjoint({'linger.ms', 'topic.acks', 'acks'})


def test_a_consumer_commits_nothing_by_itself_and_begins_nowhere_by_itself() -> None:
    wanted = {
        'group.id': 'g',
        'enable.auto.commit': 'false',
        'enable.auto.offset.store': 'false',
        'auto.offset.reset': 'error',
    }
    theirs: dict[str, str | int | float | bool] = {
        'group.id': 'x', 'enable.auto.commit': True, 'auto.offset.reset': 'latest'
    }  # fmt: skip
    made = consumer_properties(theirs, group='g', client_id='bridge')
    assert made.items() >= wanted.items()


def test_a_producer_gets_no_property_of_a_consumer() -> None:
    made = producer_properties(MIXED, client_id='bridge')
    assert made.items() >= {**OF_ALL, 'topic.acks': 'all', 'linger.ms': 7}.items()
    assert made.keys().isdisjoint({'session.timeout.ms', 'acks', 'group.id'})


def test_a_producer_repeats_nothing_and_never_gives_up_by_itself() -> None:
    made = producer_properties({}, client_id='bridge')
    wanted = {'acks': 'all', 'enable.idempotence': 'true', 'message.timeout.ms': 0}
    assert made.items() >= wanted.items()


def test_any_other_client_gets_what_is_common() -> None:
    made = common_properties(MIXED, client_id='bridge')
    assert made.items() >= OF_ALL.items()
    assert made.keys().isdisjoint({'linger.ms', 'topic.acks', 'session.timeout.ms', 'group.id'})


def test_another_name_of_a_property_replaces_the_bridges_value() -> None:
    made = producer_properties(
        {'delivery.timeout.ms': 5000, 'queue.buffering.max.ms': 3}, client_id='bridge'
    )
    assert made.keys().isdisjoint({'message.timeout.ms', 'linger.ms'})


def test_weaker_acks_turn_idempotence_off() -> None:
    made = producer_properties({'request.required.acks': 1}, client_id='bridge')
    assert made['enable.idempotence'] == 'false'
    assert property_problems({'request.required.acks': 1}) == {}


def test_the_group_protocol_of_brokers_takes_no_timeouts_of_clients() -> None:
    made = consumer_properties({'group.protocol': 'consumer'}, group='g', client_id='bridge')
    assert made.keys().isdisjoint({'session.timeout.ms', 'partition.assignment.strategy'})
    assert property_problems({'group.protocol': 'consumer'}) == {}


@pytest.mark.parametrize('spelled', ['consumer', 'CONSUMER', ' Consumer'])
def test_groups_that_the_brokers_arrange_need_a_librdkafka_that_holds_them(
    spelled: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = {'group.protocol': spelled}
    # As confluent-kafka 2.12.0 tells it, and those behind it.
    for told in ('2.12.0', ('2.9.0', 0x020900FF), ('2.14.2', 0x020E02FF)):
        monkeypatch.setattr(confluent_kafka, 'libversion', lambda told=told: told)
        said = property_problems(asked)['group.protocol']
        version = told if isinstance(told, str) else told[0]
        assert f'librdkafka 2.15.0 or later, and {version} is loaded' in said
        assert 'leave this line out' in said
        assert property_problems({'group.protocol': ' Classic'}) == property_problems({}) == {}
    monkeypatch.setattr(confluent_kafka, 'libversion', lambda: ('2.15.0', 0x020F00FF))
    assert property_problems(asked) == {}


def test_a_misspelled_group_protocol_is_told_as_such_by_every_librdkafka(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(confluent_kafka, 'libversion', lambda: ('2.14.2', 0x020E02FF))
    found = property_problems({'group.protocol': 'consumers'})
    assert found['group.protocol'].startswith('librdkafka refuses it: ')


def test_a_classic_group_is_one_however_librdkafka_lets_it_be_spelled() -> None:
    made = consumer_properties({'group.protocol': ' Classic'}, group='g', client_id='bridge')
    assert made['partition.assignment.strategy'] == 'cooperative-sticky'
    assert member_name({'group.protocol': ' Classic'}, 'static')


def test_a_member_has_a_name_of_its_own_unless_it_is_dynamic_or_the_broker_decides() -> None:
    first, second = (member_name({}, 'static') for _ in range(2))
    assert first.keys() == second.keys() == {'group.instance.id'}
    assert first != second
    assert member_name({}, 'dynamic') == {}
    assert member_name({'group.protocol': 'consumer'}, 'static') == {}


@pytest.mark.parametrize('kind', ['producer', 'consumer'])
def test_a_client_complains_of_no_property(kind: str, capfd: pytest.CaptureFixture[str]) -> None:
    every: dict[str, str | int | float | bool] = {
        'fetch.min.bytes': 1,
        'check.crcs': True,
        'compression.level': 3,
        'batch.size': 1000,
    }
    if kind == 'producer':
        confluent_kafka.Producer(dict(producer_properties(every, client_id='b'))).flush(0)
    else:
        settings = dict(consumer_properties(every, group='g', client_id='b'))
        confluent_kafka.Consumer(settings).close()
    assert 'will be ignored' not in capfd.readouterr().err


def test_all_problems_are_found_not_only_the_first() -> None:
    found = property_problems(
        {
            'bootstrap.servers': 'x:9092',
            'linger.msx': 1,
            'acks': 9999,
            'compression.type': 'zip',
            'client.id': 'right',
            'zzz': 1,
        }
    )
    assert found.keys() == {'linger.msx', 'acks', 'compression.type', 'zzz'}
    assert "(did you mean 'linger.ms'?)" in found['linger.msx']
    assert '9999' in found['acks']
    assert 'zip' in found['compression.type']
    assert 'did you mean' not in found['zzz']


@pytest.mark.parametrize(
    ('properties', 'culprit'),
    [
        ({'acks': 1, 'enable.idempotence': True}, 'acks'),
        ({'max.in.flight': 10}, 'max.in.flight'),
        ({'message.timeout.ms': 1, 'linger.ms': 50}, 'message.timeout.ms'),
        (
            {'client.id': 'x', 'security.protocol': 'ssl', 'ssl.ca.location': '/no'},
            'ssl.ca.location',
        ),
        ({'sasl.mechanisms': 'PLAIN', 'security.protocol': 'sasl_plaintext'}, 'sasl.mechanisms'),
        ({**TOKENS, 'ssl.ca.location': '/no'}, 'ssl.ca.location'),
        ({**TOKENS, 'ssl.key.pem': 'no'}, 'ssl.key.pem'),
    ],
)
def test_properties_that_do_not_fit_together_are_found(
    properties: dict[str, object], culprit: str
) -> None:
    assert list(property_problems(properties)) == [culprit]


def test_no_token_is_asked_for_to_find_problems() -> None:
    with HTTPServer(('127.0.0.1', 0), BaseHTTPRequestHandler) as server:
        server.timeout = 0
        asked: list[object] = []
        server.process_request = asked.append  # type: ignore[assignment]
        url = f'http://127.0.0.1:{server.server_port}/'
        assert property_problems({**TOKENS, 'sasl.oauthbearer.token.endpoint.url': url}) == {}
        server.handle_request()
    assert asked == []


def test_no_problem_shows_a_secret() -> None:
    found = property_problems({'ssl.key.pem': 'hunter2', 'security.protocol': 'ssl'})
    assert list(found) == ['ssl.key.pem']
    assert 'hunter2' not in str(found)


@pytest.mark.parametrize(
    'name',
    [
        'sasl.password', 'ssl.key.password', 'ssl.key.pem', 'ssl.keystore.password',
        'sasl.oauthbearer.client.secret', 'sasl.oauthbearer.config', 'sasl.jaas.config',
        'basic.auth.user.info', 'sasl.oauthbearer.assertion.private.key.passphrase',
        'sasl.oauthbearer.assertion.private.key.pem',
    ],
)  # fmt: skip
def test_a_secret_is_known_by_its_name(name: str) -> None:
    assert is_secret(name)


@pytest.mark.parametrize(
    'name',
    ['sasl.oauthbearer.token.endpoint.url', 'sasl.username', 'ssl.ca.pem', 'ssl.key.location'],
)
def test_what_is_no_secret_is_shown(name: str) -> None:
    assert not is_secret(name)


@pytest.mark.parametrize(
    'name',
    [
        'group.id', 'auto.commit.enable', 'topic.auto.offset.reset', 'transactional.id',
        'error_cb', 'group.instance.id', 'partition.assignment.strategy', 'plugin.library.paths',
        'topic.blacklist', 'internal.termination.signal', 'test.mock.num.brokers',
    ],
)  # fmt: skip
def test_what_the_bridge_keeps_for_itself_is_refused_under_every_name(name: str) -> None:
    assert refusal(name)
