"""What is called after a bridge: in ROS, in Kafka, on disk; and how it names a ROS domain."""

from itertools import chain, product
from pathlib import Path

import pytest

from ros2_kafka_bridge.config.checks import bridge_name
from ros2_kafka_bridge.kafka.names import lock_group, lock_topic, reading_group, tail_group
from ros2_kafka_bridge.ros.node import domain_in_words, node_name, own_nodes, worker_name
from ros2_kafka_bridge.spool.store import file_of


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


def test_no_two_bridges_share_a_group_a_lock_or_a_spool() -> None:
    owners: dict[str, str] = {}
    for words in chain.from_iterable(product(('a', 'lock', 'tail'), repeat=n) for n in (2, 3, 4)):
        for cut in range(1, len(words)):
            bridge, route = '.'.join(words[:cut]), '.'.join(words[cut:])
            for name in named_after(bridge, route) if is_legal(bridge) else ():
                assert owners.setdefault(name, bridge) == bridge


def is_legal(bridge: str) -> bool:
    try:
        return bridge_name(bridge) == bridge
    except ValueError:
        return False


def named_after(bridge: str, route: str) -> set[str]:
    groups = {name(bridge, route) for name in (reading_group, tail_group, lock_group)}
    return groups | {lock_topic(bridge), str(file_of(Path('/spools'), bridge, route))}
