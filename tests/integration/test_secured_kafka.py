"""A closed cluster: in by password, with the permissions of docs/security.md and no more.

The other ways in, and what goes wrong on them, are in tests/system and tests/faults.
"""

from pathlib import Path

import pytest
from harness import Bench, values
from secured import CLIENT_SECRET, PASSWORD, USER, make_round, running, watched

from ros2_kafka_bridge.testing.orders import encode, orders

COUNT = 500


def test_orders_go_through_both_directions_with_the_permissions_of_the_docs(
    tmp_path: Path, tmp_path_factory: pytest.TempPathFactory, ros_domain: int
) -> None:
    with running(tmp_path_factory.mktemp('secured')) as secured:
        secured.set_password(USER, PASSWORD)
        bench = Bench(tmp_path, secured.node.bootstrap_servers, ros_domain)
        goods = make_round(bench, 'orders')
        secured.allow(USER, goods.rights(bench.name))
        config = bench.config(goods.routes, kafka=secured.properties('SCRAM', bench.place))
        source = orders(seed=5)
        sent = [encode(next(source)) for _ in range(COUNT)]
        bench.produce(goods.source, list(sent))
        secrets = (PASSWORD, CLIENT_SECRET)
        with watched(bench, config, secrets, KAFKA_PASSWORD=PASSWORD) as bridge:
            received = values(bench.records(goods.returned, COUNT))
            assert bridge.end() == 0
            assert 'ERROR' not in bridge.output()
            assert 'Kafka is away' not in bridge.output()
        bench.close()
    assert received == sent
