"""What the bridge is called in the ROS graph, and how it names a ROS domain."""

import pytest

from ros2_kafka_bridge.ros.node import domain_in_words, node_name, own_nodes, worker_name


def test_a_bridge_knows_the_nodes_of_its_workers_from_those_of_a_bridge_with_a_number() -> None:
    own = own_nodes('warehouse')
    assert own.fullmatch(f'/{node_name("warehouse")}')
    assert own.fullmatch(f'/{node_name(worker_name("warehouse", 12))}')
    assert not own.fullmatch(f'/{node_name("warehouse-1")}')
    assert worker_name('warehouse', 1) == 'warehouse-worker-1'
    assert worker_name('warehouse', 0) == 'warehouse'


def test_a_domain_is_said_with_who_chose_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv('ROS_DOMAIN_ID', '7')
    assert domain_in_words(None) == 'domain 7 (ROS_DOMAIN_ID)'
    assert domain_in_words(3) == 'domain 3'
    monkeypatch.delenv('ROS_DOMAIN_ID')
    assert domain_in_words(None) == 'domain 0 (the default)'
