"""A closed cluster: each way in, with the permissions of docs/security.md and no more."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from support.bridges.routes import values
from support.kafka.secured import (
    DOCS,
    PASSWORD,
    SECRETS,
    USER,
    WRONG,
    SecuredKafka,
    carries_orders,
    documented,
    let_in,
    mended,
    running,
    topic_right,
    watched,
)
from support.processes.harness import Bench

from ros2_kafka_bridge.config.file import loads
from ros2_kafka_bridge.kafka.property_check import property_problems

WAYS = ('SCRAM', 'PLAIN', 'mTLS', 'OAUTHBEARER')


@pytest.fixture(scope='module')
def secured(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SecuredKafka]:
    with running(tmp_path_factory.mktemp('secured')) as kafka:
        yield kafka


@pytest.fixture
def bench(tmp_path: Path, secured: SecuredKafka, ros_domain: int) -> Bench:
    """The administration goes through the plain listener, past all permissions."""
    return Bench(tmp_path, secured.node.bootstrap_servers, ros_domain)


@pytest.mark.parametrize('way', WAYS)
def test_orders_go_through_both_directions_with_the_permissions_of_the_docs(
    secured: SecuredKafka, bench: Bench, way: str
) -> None:
    carries_orders(secured, bench, way)


def test_a_dead_letter_needs_write_on_its_topic(secured: SecuredKafka, bench: Bench) -> None:
    goods = let_in(secured, bench)
    dead = f'{goods.source}.dead-letters'
    bench.create_topic(dead)
    secured.allow(USER, [topic_right(dead, 'WRITE')])
    bench.produce(goods.source, [b'one', b'\xff', b'two'])
    with watched(bench, goods.routes, secured.properties('SCRAM', bench.place)):
        assert values(bench.records(goods.returned, 2)) == [b'one', b'two']
        assert values(bench.records(dead, 1)) == [b'\xff']


def test_a_dead_letter_topic_is_created_with_create(secured: SecuredKafka, bench: Bench) -> None:
    goods = let_in(secured, bench)
    dead = f'{goods.source}.dead-letters'
    secured.allow(USER, [topic_right(dead, right) for right in ('CREATE', 'WRITE')])
    bench.produce(goods.source, [b'\xff'])
    route = {**goods.routes[0], 'min_subscribers': 0}
    with watched(bench, [route], secured.properties('SCRAM', bench.place)):
        assert values(bench.records(dead, 1)) == [b'\xff']


def test_a_transient_local_publisher_needs_read_on_the_sink_topic(
    secured: SecuredKafka, bench: Bench
) -> None:
    goods = let_in(secured, bench)
    kafka = secured.properties('SCRAM', bench.place)
    bench.produce(goods.returned, [b'from before'])
    options = ('--count', '20', '--durability', 'transient_local', '--readers', '0')
    with (
        bench.publisher('/orders', *options),
        watched(bench, goods.routes[1:], kafka) as bridge,
    ):
        bridge.wait_for(f'topic {goods.returned} cannot be read')
        bridge.wait_for('give this user READ on the topic (ACL); tried again in')
        secured.allow(USER, [topic_right(goods.returned, 'READ')])
        found = values(bench.records(goods.returned, 21))
        assert found == [b'from before', *(b'%d' % number for number in range(20))]


@pytest.mark.parametrize('way', WAYS)
def test_check_shows_no_secret_and_finds_nothing_to_complain_of(
    secured: SecuredKafka, bench: Bench, way: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv('KAFKA_PASSWORD', PASSWORD)
    goods = let_in(secured, bench)
    config = bench.config(goods.routes, kafka=secured.properties(way, bench.place))
    for options in ((), ('--connect',)):
        status, out, err = bench.command('check', str(config), *options, timeout_s=60)
        assert status == 0, out + err
        assert not [secret for secret in SECRETS if secret in out + err]
    assert '1 broker ' in out


@pytest.mark.parametrize(
    ('listener', 'cure'),
    [
        ('SECURE', 'check sasl.username and sasl.password'),
        ('EXPIRED', 'certificate has expired (broker); renew the certificate of the broker'),
        ('ELSEWHERE', 'write the host in bootstrap.servers as the certificate of the broker'),
    ],
)
def test_check_connect_names_the_cure_and_no_secret(
    secured: SecuredKafka, bench: Bench, listener: str, cure: str
) -> None:
    goods = let_in(secured, bench)
    kafka = mended(
        secured.properties('SCRAM', bench.place),
        bootstrap_servers=secured.address(listener),
        sasl_password=WRONG,
    )
    config = bench.config(goods.routes, kafka=kafka)
    status, out, err = bench.command('check', str(config), '--connect', timeout_s=60)
    assert status == 1, out + err
    assert cure in out
    assert WRONG not in out + err


@pytest.mark.parametrize('way', WAYS)
def test_every_example_of_the_docs_is_right(way: str, tmp_path: Path) -> None:
    """Read by the loader alone: the files that it names are those of the docs."""
    lines = ''.join(f'  {key}: {value}\n' for key, value in documented(way).items())
    lines = lines.replace('/run/secrets', str(tmp_path))
    for secret in ('kafka-password', 'client-secret'):
        (tmp_path / secret).write_text('x')
    text = f'name: b\nkafka:\n{lines}routes: []\n'.replace(
        'routes: []',
        'routes: [{name: a, from: {kafka: a}, to: {ros: /a, type: std_msgs/msg/String}, '
        'format: text}]',
    )
    config = loads(text, 'bridge.yaml', {'KAFKA_PASSWORD': 'x'})
    problems = property_problems(config.kafka)
    # Files of another machine, which only librdkafka itself would open.
    assert {name for name in problems if not name.endswith('.location')} == set()


def test_the_docs_show_every_error_as_it_is_told() -> None:
    """The cures in the table of errors are those of kafka/cures.py, word for word."""
    from ros2_kafka_bridge.kafka.cures import CURES  # noqa: PLC0415

    page = re.sub(r'\s+', ' ', DOCS.read_text('utf-8'))
    told = [cure.text.format(right='WRITE') for cure in CURES if cure.text]
    missing = [
        text for text in told if text not in page and text.replace('WRITE', 'READ') not in page
    ]
    assert missing == []
