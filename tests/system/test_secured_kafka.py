"""A closed cluster: each way in, with the permissions of docs/security.md and no more."""

import re
import uuid
from collections.abc import Iterator
from pathlib import Path

import pytest
from harness import Bench, values
from secured import (
    CLIENT_SECRET,
    DOCS,
    PASSWORD,
    USER,
    SecuredKafka,
    documented,
    make_round,
    mended,
    running,
    topic_right,
    watched,
)

from ros2_kafka_bridge.config.file import loads
from ros2_kafka_bridge.kafka.property_check import property_problems
from ros2_kafka_bridge.testing.orders import encode, orders

WAYS = ('SCRAM', 'PLAIN', 'mTLS', 'OAUTHBEARER')
COUNT = 500
SECRETS = (PASSWORD, CLIENT_SECRET)


@pytest.fixture(scope='module')
def secured(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SecuredKafka]:
    with running(tmp_path_factory.mktemp('secured')) as kafka:
        kafka.set_password(USER, PASSWORD)
        yield kafka


@pytest.fixture
def bench(tmp_path: Path, secured: SecuredKafka, ros_domain: int) -> Bench:
    """The administration goes through the plain listener, past all permissions."""
    return Bench(tmp_path, secured.node.bootstrap_servers, ros_domain)


@pytest.fixture
def name() -> str:
    """A name of the bridge that nobody else uses: its groups begin with it."""
    return f'bridge-{uuid.uuid4().hex[:8]}'


def sent(count: int = COUNT) -> list[bytes]:
    source = orders(seed=5)
    return [encode(next(source)) for _ in range(count)]


@pytest.mark.parametrize('way', WAYS)
def test_orders_go_through_both_directions_with_the_permissions_of_the_docs(
    secured: SecuredKafka, bench: Bench, name: str, way: str
) -> None:
    goods = make_round(bench, 'orders')
    secured.allow(USER, goods.rights(name))
    kafka = secured.properties(way, bench.place)
    config = bench.config(goods.routes, name=name, kafka=kafka)
    orders_sent = sent()
    bench.produce(goods.source, list(orders_sent))
    with watched(bench, config, SECRETS, KAFKA_PASSWORD=PASSWORD) as bridge:
        received = values(bench.records(goods.returned, COUNT))
        assert bridge.end() == 0
        assert 'ERROR' not in bridge.output()
        assert 'Kafka is away' not in bridge.output()
    assert received == orders_sent


def test_a_dead_letter_needs_write_on_its_topic(
    secured: SecuredKafka, bench: Bench, name: str
) -> None:
    goods = make_round(bench, 'orders')
    dead = f'{goods.source}.dead-letters'
    bench.create_topic(dead)
    secured.allow(USER, [*goods.rights(name), topic_right(dead, 'WRITE')])
    kafka = secured.properties('SCRAM', bench.place)
    bench.produce(goods.source, [b'one', b'\xff', b'two'])
    config = bench.config(goods.routes, name=name, kafka=kafka)
    with watched(bench, config, SECRETS) as bridge:
        assert values(bench.records(goods.returned, 2)) == [b'one', b'two']
        assert values(bench.records(dead, 1)) == [b'\xff']
        assert bridge.end() == 0


def test_a_dead_letter_topic_is_created_with_create(
    secured: SecuredKafka, bench: Bench, name: str
) -> None:
    goods = make_round(bench, 'orders')
    dead = f'{goods.source}.dead-letters'
    more = [topic_right(dead, right) for right in ('CREATE', 'WRITE')]
    secured.allow(USER, [*goods.rights(name), *more])
    kafka = secured.properties('SCRAM', bench.place)
    bench.produce(goods.source, [b'\xff'])
    config = bench.config(
        goods.routes[:1], name=name, kafka=kafka, defaults={'min_subscribers': 0}
    )
    with watched(bench, config, SECRETS) as bridge:
        assert values(bench.records(dead, 1)) == [b'\xff']
        assert bridge.end() == 0


def test_a_transient_local_publisher_needs_read_on_the_sink_topic(
    secured: SecuredKafka, bench: Bench, name: str
) -> None:
    goods = make_round(bench, 'orders')
    secured.allow(USER, goods.rights(name))
    kafka = secured.properties('SCRAM', bench.place)
    config = bench.config(goods.routes[1:], name=name, kafka=kafka)
    bench.produce(goods.returned, [b'from before'])
    options = ('--count', '20', '--durability', 'transient_local', '--readers', '0')
    with bench.publisher('/orders', *options), watched(bench, config, SECRETS) as bridge:
        bridge.wait_for(f'topic {goods.returned} cannot be read')
        bridge.wait_for('give this user READ on the topic (ACL); tried again in')
        secured.allow(USER, [topic_right(goods.returned, 'READ')])
        found = values(bench.records(goods.returned, 21))
        assert found == [b'from before', *(b'%d' % number for number in range(20))]
        assert bridge.end() == 0


@pytest.mark.parametrize('way', WAYS)
def test_check_shows_no_secret_and_finds_nothing_to_complain_of(
    secured: SecuredKafka, bench: Bench, name: str, way: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv('KAFKA_PASSWORD', PASSWORD)
    goods = make_round(bench, 'orders')
    secured.allow(USER, goods.rights(name))
    kafka = secured.properties(way, bench.place)
    config = bench.config(goods.routes, name=name, kafka=kafka)
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
    goods = make_round(bench, 'orders')
    wrong = 'not-the-password-31b0'
    kafka = mended(
        secured.properties('SCRAM', bench.place),
        bootstrap_servers=secured.address(listener),
        sasl_password=wrong,
    )
    config = bench.config(goods.routes, kafka=kafka)
    status, out, err = bench.command('check', str(config), '--connect', timeout_s=60)
    assert status == 1, out + err
    assert cure in out
    assert wrong not in out + err


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
