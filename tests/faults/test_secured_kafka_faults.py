"""A closed cluster that does not let the bridge in, or no longer.

Each of these is one clear error that names its cure, said once for each try; nobody else is
disturbed; nothing is lost once it is mended. No secret is ever shown.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from support.bridges.routes import values
from support.kafka.secured import (
    OTHER,
    PASSWORD,
    USER,
    WRONG,
    Right,
    Round,
    SecuredKafka,
    group_right,
    let_in,
    make_round,
    mended,
    running,
    topic_right,
    watched,
)
from support.processes.harness import Bench, Process, eventually

COUNT = 300
CREDENTIALS = 'check sasl.username and sasl.password'
NO_CERTIFICATE = 'the broker refuses the certificate of this bridge'


@pytest.fixture(scope='module')
def secured(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SecuredKafka]:
    with running(tmp_path_factory.mktemp('secured')) as kafka:
        yield kafka


@pytest.fixture
def bench(tmp_path: Path, secured: SecuredKafka, ros_domain: int) -> Bench:
    """The administration goes through the plain listener, past all permissions."""
    return Bench(tmp_path, secured.node.bootstrap_servers, ros_domain)


@pytest.fixture
def as_user(secured: SecuredKafka, bench: Bench) -> dict[str, Any]:
    """How a user comes in that is named as the bridge is, and that nobody else uses."""
    secured.set_password(bench.name, PASSWORD)
    return mended(secured.properties('SCRAM', bench.place), sasl_username=bench.name)


def send(bench: Bench, goods: Round, count: int = COUNT, first: int = 0) -> None:
    bench.produce(goods.source, [b'%d' % number for number in range(first, first + count)])


def all_arrive(bench: Bench, goods: Round, count: int = COUNT) -> None:
    """Every record comes, in order; a hand-over may repeat some."""

    def arrived() -> list[bytes]:
        found = values(bench.records(goods.returned, bench.end_offset(goods.returned)))
        return list(dict.fromkeys(found))

    eventually(lambda: len(arrived()) >= count, 60, lambda: f'{arrived()[-3:]} came last')
    assert arrived() == [b'%d' % number for number in range(count)]


def said(bridge: Process, route: str) -> list[str]:
    """What a bridge has complained of for a route."""
    return [
        line
        for line in bridge.output().split('\n')
        if f' {route}: ' in line and (' ERROR ' in line or ' WARNING ' in line)
    ]


def fails_with(bridge: Process, route: str, cure: str) -> None:
    """A route says an error once, with the cure, and nothing else, however often it is tried."""
    eventually(lambda: bool(said(bridge, route)), 60, bridge.output)
    bridge.wait_for(f' {route}: failed (', 60)  # its status, which comes some tries later
    complaints = said(bridge, route)
    assert all(cure in line and 'failed: ' in line for line in complaints), complaints
    # The place where it was met may change: the first connection, a later one.
    texts = [line.partition('failed: ')[2].partition('; tried again')[0] for line in complaints]
    assert len(texts) == len({*texts}), complaints
    assert len(texts) <= 3, complaints
    assert bridge.running


def both_fail_with(bridge: Process, cure: str) -> None:
    for route in ('orders', 'orders_returned'):
        fails_with(bridge, route, cure)


# Nobody is let in


def test_a_wrong_password_names_its_property_and_costs_nothing_once_it_is_put_right(
    secured: SecuredKafka, bench: Bench, as_user: dict[str, Any]
) -> None:
    secured.set_password(bench.name, WRONG)
    goods = let_in(secured, bench, user=bench.name)
    send(bench, goods)
    with watched(bench, goods.routes, as_user) as bridge:
        both_fail_with(bridge, CREDENTIALS)
        secured.set_password(bench.name, PASSWORD)
        all_arrive(bench, goods)


@pytest.mark.parametrize('log_format', ['text', 'json'])
def test_a_wrong_password_of_plain_is_shown_in_no_log(
    secured: SecuredKafka, bench: Bench, log_format: str
) -> None:
    goods = let_in(secured, bench)
    send(bench, goods)
    way = (bench, goods.routes, secured.properties('PLAIN', bench.place))
    options = ('--log-format', log_format)
    with watched(*way, *options, KAFKA_PASSWORD=WRONG) as bridge:
        bridge.wait_for(f'{CREDENTIALS}; tried again in 1 s')
    with watched(*way, *options, KAFKA_PASSWORD=PASSWORD):
        all_arrive(bench, goods)


def is_told_and_then_mended(
    secured: SecuredKafka, bench: Bench, right: dict[str, Any], wrong: dict[str, Any], cure: str
) -> None:
    goods = let_in(secured, bench)
    send(bench, goods)
    with watched(bench, goods.routes, wrong) as bridge:
        both_fail_with(bridge, cure)
    with watched(bench, goods.routes, right):
        all_arrive(bench, goods)


@pytest.mark.parametrize(
    ('listener', 'authority', 'cure'),
    [
        ('SECURE', 'other', 'ssl.ca.location must name the authority that has signed'),
        (
            'EXPIRED',
            'own',
            'certificate has expired (broker); renew the certificate of the broker',
        ),
        ('ELSEWHERE', 'own', "not valid for '127.0.0.1' (broker); write the host in bootstrap"),
    ],
)
def test_a_broker_that_is_not_trusted_is_told_with_the_reason(
    secured: SecuredKafka, bench: Bench, listener: str, authority: str, cure: str
) -> None:
    right = secured.properties('SCRAM', bench.place)
    trusted = secured.other_ca_file if authority == 'other' else secured.ca_file
    wrong = mended(
        right, bootstrap_servers=secured.address(listener), ssl_ca_location=str(trusted)
    )
    is_told_and_then_mended(secured, bench, right, wrong, cure)


def test_a_bridge_without_the_certificate_that_the_broker_asks_for_is_told(
    secured: SecuredKafka, bench: Bench
) -> None:
    right = secured.properties('mTLS', bench.place)
    wrong = mended(right, ssl_certificate_location=None, ssl_key_location=None)
    is_told_and_then_mended(secured, bench, right, wrong, NO_CERTIFICATE)


def test_an_expired_certificate_of_the_bridge_is_told_and_a_new_one_in_its_place_is_read(
    secured: SecuredKafka, bench: Bench
) -> None:
    goods = let_in(secured, bench)
    kafka = secured.properties('mTLS', bench.place)
    place = Path(kafka['ssl.certificate.location']), Path(kafka['ssl.key.location'])
    new = [file.read_bytes() for file in place]
    for file, old in zip(place, secured.client_certificate(USER, expired=True), strict=True):
        file.write_bytes(old.read_bytes())
    send(bench, goods)
    with watched(bench, goods.routes, kafka) as bridge:
        both_fail_with(bridge, NO_CERTIFICATE)
        for file, content in zip(place, new, strict=True):
            file.write_bytes(content)
        all_arrive(bench, goods)


# A permission is missing


@pytest.mark.parametrize(
    ('missing', 'route', 'cure'),
    [
        ('READ', 'broken', 'give this user READ on the topic (ACL)'),
        ('group', 'broken', 'give this user READ on the consumer group'),
        ('WRITE', 'broken_returned', 'give this user WRITE on the topic (ACL)'),
        ('DESCRIBE', 'broken', 'give this user READ on the topic (ACL)'),
    ],
)
def test_a_missing_permission_stops_its_route_alone(
    secured: SecuredKafka,
    bench: Bench,
    as_user: dict[str, Any],
    missing: str,
    route: str,
    cure: str,
) -> None:
    name = bench.name
    well, broken = make_round(bench, 'well'), make_round(bench, 'broken')
    held_back = _held_back(broken, name, missing)
    given = [*well.rights(name), *broken.rights(name)]
    if missing == 'group':
        everywhere = group_right(f'{name}.', prefixed=True)
        given = [right for right in given if right != everywhere]
        given += [group_right(f'{name}.well')]
    given = [right for right in given if right not in held_back]
    if missing == 'READ':
        given += [topic_right(broken.source, 'DESCRIBE')]
    secured.allow(name, given)
    for goods in (well, broken):
        send(bench, goods)
    with watched(bench, [*well.routes, *broken.routes], as_user) as bridge:
        fails_with(bridge, route, cure)
        all_arrive(bench, well)
        assert not said(bridge, 'well')
        assert not said(bridge, 'well_returned')
        secured.allow(name, held_back)
        all_arrive(bench, broken)


def _held_back(goods: Round, name: str, missing: str) -> list[Right]:
    if missing == 'group':
        return [group_right(f'{name}.{goods.name}')]
    topic = goods.returned if missing == 'WRITE' else goods.source
    return [topic_right(topic, 'WRITE' if missing == 'WRITE' else 'READ')]


def test_a_user_that_may_write_nothing_ends_no_bridge(
    secured: SecuredKafka, bench: Bench, as_user: dict[str, Any]
) -> None:
    goods = make_round(bench, 'orders')
    *rights, write = goods.rights(bench.name)
    secured.allow(bench.name, [*rights, topic_right(goods.returned, 'DESCRIBE')])
    send(bench, goods)
    with watched(bench, goods.routes, as_user) as bridge:
        fails_with(bridge, 'orders_returned', 'give this user WRITE on the topic (ACL)')
        secured.allow(bench.name, [write])
        all_arrive(bench, goods)


def test_a_dead_letter_topic_that_may_not_be_written_holds_its_route_back(
    secured: SecuredKafka, bench: Bench, as_user: dict[str, Any]
) -> None:
    well, broken = (let_in(secured, bench, name, bench.name) for name in ('well', 'broken'))
    dead = f'{broken.source}.dead-letters'
    bench.create_topic(dead)
    bench.produce(broken.source, [b'\xff'])
    for goods in (well, broken):
        send(bench, goods)
    with watched(bench, [*well.routes, *broken.routes], as_user) as bridge:
        bridge.wait_for(f'failed: the dead-letter topic {dead} cannot be written')
        bridge.wait_for('give this user WRITE on the topic (ACL); tried again in 4 s', 60)
        tries = [line for line in said(bridge, 'broken') if 'failed: ' in line]
        assert len(tries) <= 4, tries
        all_arrive(bench, well)
        secured.allow(bench.name, [topic_right(dead, 'WRITE')])
        all_arrive(bench, broken)
        assert values(bench.records(dead, 1)) == [b'\xff']


# In mid-run


def test_a_password_changed_in_mid_run_is_told_and_costs_nothing(
    secured: SecuredKafka, bench: Bench, as_user: dict[str, Any]
) -> None:
    goods = let_in(secured, bench, user=bench.name)
    renewed = mended(as_user, bootstrap_servers=secured.address('RENEWED'))
    with watched(bench, goods.routes, renewed) as bridge:
        send(bench, goods)
        all_arrive(bench, goods)
        assert not said(bridge, 'orders')
        secured.set_password(bench.name, OTHER)
        both_fail_with(bridge, CREDENTIALS)
        send(bench, goods, COUNT, COUNT)
        secured.set_password(bench.name, PASSWORD)
        all_arrive(bench, goods, 2 * COUNT)


def by_renewed_tokens(secured: SecuredKafka, bench: Bench) -> dict[str, Any]:
    kafka = secured.properties('OAUTHBEARER', bench.place)
    return mended(kafka, bootstrap_servers=secured.address('RENEWED'))


def test_tokens_are_renewed_in_mid_run_and_no_route_fails(
    secured: SecuredKafka, bench: Bench
) -> None:
    goods = let_in(secured, bench)
    with watched(bench, goods.routes, by_renewed_tokens(secured, bench)) as bridge:
        send(bench, goods, 1)
        all_arrive(bench, goods, 1)
        given = secured.tokens.given
        eventually(lambda: secured.tokens.given >= given + 6, 60)
        send(bench, goods, COUNT, 1)
        all_arrive(bench, goods, COUNT + 1)
        assert ' ERROR ' not in bridge.output()


def test_a_token_that_expires_while_the_endpoint_is_broken_is_told_and_costs_nothing(
    secured: SecuredKafka, bench: Bench
) -> None:
    goods = let_in(secured, bench)
    with watched(bench, goods.routes, by_renewed_tokens(secured, bench)) as bridge:
        send(bench, goods)
        all_arrive(bench, goods)
        with secured.tokens.out_of_order():
            for route in ('orders', 'orders_returned'):
                eventually(
                    lambda route=route: any(  # type: ignore[misc]  # bound here
                        'sasl.oauthbearer.token.endpoint.url' in line
                        for line in said(bridge, route)
                    ),
                    90,
                    bridge.output,
                )
            eventually(secured.tokens.all_expired, 60)
            # The broker has closed what they had opened: from here on nothing gets through.
            bridge.wait_for('waiting (Kafka is away', 60, count=2)
            send(bench, goods, COUNT, COUNT)
            bridge.wait_for('Failed to acquire SASL OAUTHBEARER token', 60, count=5)
            assert bench.end_offset(goods.returned) == COUNT
        all_arrive(bench, goods, 2 * COUNT)
        assert bridge.running
        assert len(said(bridge, 'orders')) <= 10, said(bridge, 'orders')
