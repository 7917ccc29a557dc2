"""What is not known is not nought, on the page and in `status`: each field has a row.

As in `test_not_known.py`: how a field shows that nobody knows, and how it shows what is bad. A
field without a row fails here.
"""

from typing import Any, Final

import pytest
from support.monitoring.not_known import ALWAYS, NONE, ORDERS, RETURNED, bad_report, unknown_report

from ros2_kafka_bridge.config.settings import QoS
from ros2_kafka_bridge.kafka.overview import ClusterState, TopicState
from ros2_kafka_bridge.monitoring import graph, view
from ros2_kafka_bridge.monitoring.sides import Sides
from ros2_kafka_bridge.protocol.monitor import Lifecycle, Reload, Report
from ros2_kafka_bridge.ros.node import Topic
from ros2_kafka_bridge.ros.peer import Peer
from ros2_kafka_bridge.ros.qos import profile

from .conftest import Told

# The page, and `status`


def rows(*reports: Report) -> list[dict[str, Any]]:
    told = Told()
    for it in reports:
        told.tell(it)
    return view.routes(told.watch)


LATE: Final = [300.0, 300.0]  # and more: the last bucket has no bound
ROUTE_ROWS: Final = {
    # null where nobody knows; then what is bad.
    'name': (ORDERS, ORDERS),
    'worker': (1, 1),
    'state': ('starting', 'failed'),
    'reason': ('', 'no permission'),
    'final': (False, True),
    'age_s': (NONE, 40.0),
    'busy_s': (0.0, 95.0),
    'rate': (NONE, 0.0),
    'bytes_rate': (NONE, 0.0),
    'waited': (NONE, 0.0),
    'taken': (NONE, 72),
    'ended': ({'confirmed': NONE, 'published': NONE}, {'published': 12, 'lost': 3}),
    'spooled': (NONE, 16),
    'in_flight': (NONE, 7),
    'lag': (NONE, 500),
    'lost_upstream': (NONE, 5),
    'repeated': (NONE, 6),
    'unproved': (NONE, 2),
    'delay_s': (NONE, LATE),
    'in_bridge_s': (NONE, LATE),
    'end_to_end_s': (NONE, LATE),
    'produce_s': (NONE, LATE),
    'broker_round_trip_s': (NONE, [3.0, 9.0]),
    'bytes_taken': (NONE, 90),
    'bytes_confirmed': (NONE, 10),
    'bytes_published': (NONE, 30),
    'spool_bytes': (NONE, 4_900_000),
    'waited_s': (NONE, 70.0),
    'rebalances': (NONE, 8),
    'matched': (NONE, 0),
    'mismatched': (NONE, 2),
    'queued': (NONE, 500),
    'queue_limit': (NONE, 500),
    'memory_limit': (NONE, 111_000_000),
    'errors': (NONE, {'DecodeError': 9}),
    'paused': (False, True),
    'advice': ('', 'It is not tried again'),
}


def test_every_field_of_a_route_has_a_row() -> None:
    [found, _] = rows(unknown_report())
    assert set(ROUTE_ROWS) == set(found)


@pytest.mark.parametrize('field', ROUTE_ROWS)
def test_a_field_of_a_route_shows_what_is_not_known_and_what_is_bad(field: str) -> None:
    unknown, bad = ROUTE_ROWS[field]
    assert fits(rows(unknown_report())[0][field], unknown)
    assert fits(rows(bad_report(), bad_report(5))[0][field], bad)


def fits(found: Any, expected: Any) -> bool:
    if isinstance(expected, dict):
        return all(found[name] == value for name, value in expected.items())
    return bool(found == expected or (isinstance(expected, str) and expected in found))


BRIDGE_ROWS: Final = {
    # Before the first report; then what is bad.
    'name': ('test', 'test'),
    'version': (ALWAYS, ALWAYS),
    'file': ('/etc/bridge.yaml', '/etc/bridge.yaml'),
    'now_s': (ALWAYS, ALWAYS),
    'report_age_s': (ALWAYS, ALWAYS),  # before the first report: for how long it waits
    'old': (ALWAYS, ALWAYS),
    'started_s': (NONE, 900.0),
    'lifecycle': (NONE, Lifecycle.INACTIVE),
    'stopping': (NONE, True),
    'ready': (False, False),
    'live': (True, False),
    'problems': (['report: none has come yet'], ['worker/1: it has told nothing for 40 s']),
    'may_change': (True, True),
    'reload': (NONE, Reload(990.0, done=False, text='line 3: unknown field')),
}


@pytest.mark.parametrize('field', view.bridge(Told().watch))
def test_a_field_of_the_bridge_shows_what_is_not_known_and_what_is_bad(field: str) -> None:
    unknown, bad = BRIDGE_ROWS[field]
    told = Told()
    before = view.bridge(told.watch)[field]
    told.tell(bad_report())
    after = view.bridge(told.watch)[field]
    for found, expected in ((before, unknown), (after, bad)):
        if expected is not ALWAYS:
            of_list = isinstance(expected, list) and set(expected) <= set(found)
            assert of_list or found == expected


WORKER_ROWS: Final = {
    'number': (1, 1), 'pid': (0, 0), 'starts': (1, 9), 'problem': ('', 'was ended by SIGKILL'),
    'memory_bytes': (NONE, NONE), 'routes': ([ORDERS, RETURNED], [ORDERS, RETURNED]),
}  # fmt: skip


def test_a_field_of_a_worker_shows_what_is_not_known_and_what_is_bad() -> None:
    for told, place in ((unknown_report(), 0), (bad_report(), 1)):
        it = Told()
        it.tell(told)
        [found] = view.workers(it.watch)
        assert found == {name: row[place] for name, row in WORKER_ROWS.items()}


# Kafka, as the page and `status` show it


class Overview:
    """A cluster with one topic that nobody leads, and others of which it tells nothing."""

    def look(self, topics: set[str]) -> ClusterState:
        hidden = TopicState('', None, 'authorization failed', None, None, None)
        bad = {'returned': TopicState('', 3, '', 2, 1, is_there=True)}
        states = [bad.get(name, hidden)._replace(name=name) for name in sorted(topics)]
        return ClusterState('abc', {}, -1, 4.0, states)

    def begins(self, _: object) -> dict[tuple[str, int], int]:
        return {}

    ends = begins


BROKER_ROWS: Final = {
    # Where nobody has answered: only that. Then what is bad.
    'problem': ('no broker answers', ''),
    'seen_s': (NONE, ALWAYS),
    'cluster_id': (NONE, 'abc'),
    'brokers': (NONE, []),
    'controller': (NONE, -1),
    'round_trip_s': (NONE, 4.0),
    'topics': (NONE, ALWAYS),
}
TOPIC_ROWS: Final = {
    'name': ('orders', 'returned'),
    'is_there': (NONE, True),
    'partitions': (NONE, 3),
    'problem': ('authorization failed', ''),
    'leaderless': (NONE, 2),
    'under_replicated': (NONE, 1),
}
LETTER_ROWS: Final = {
    'topic': 'orders.dead-letters', 'routes': [ORDERS], 'there': NONE, 'held': NONE,
    'problem': 'authorization failed',
}  # fmt: skip


def test_a_field_of_kafka_shows_what_is_not_known_and_what_is_bad(told: Told) -> None:
    sides = Sides(told.watch, lambda: None)
    assert sides.sections() == {'broker': None, 'letters': []}, 'not asked yet'
    sides._note_away('no broker answers')
    away = sides.sections()['broker']
    assert {name: away.get(name) for name in BROKER_ROWS} == {
        name: unknown for name, (unknown, _) in BROKER_ROWS.items()
    }
    sides._look_at_kafka(Overview())  # type: ignore[arg-type]
    broker, [letters, _] = sides.sections().values()
    assert set(broker) == set(BROKER_ROWS)
    for name, (_, bad) in BROKER_ROWS.items():
        assert bad is ALWAYS or broker[name] == bad
    hidden, bad_topic = broker['topics']
    assert hidden == {name: unknown for name, (unknown, _) in TOPIC_ROWS.items()}
    assert bad_topic == {name: bad for name, (_, bad) in TOPIC_ROWS.items()}
    assert letters == LETTER_ROWS


# The ROS graph

GRAPH_ROWS: Final = {
    # A topic that cannot be read; then one that no route can join.
    'name': ('/odd', '/orders'),
    'types': ([], ['a/msg/A', 'b/msg/B']),
    'problem': ('cannot be read: a name that is none', ''),
    'of_ros': (False, False),
    'publishers': ([], []),
    'subscribers': ([], ALWAYS),
    'routes': ([], ALWAYS),
    'matches': ([], ALWAYS),
}


def test_a_field_of_the_graph_shows_what_is_not_known_and_what_is_bad(told: Told) -> None:
    qos = profile(QoS())
    reader = Peer('/robot', 'b/msg/B', b'gid', '', 'reliable', 'volatile', qos)
    odd = Topic('/odd', [], [], [], 'cannot be read: a name that is none')
    bad = Topic('/orders', ['a/msg/A', 'b/msg/B'], [], [reader])
    found = graph.seen(told.watch.config, told.watch.routes, [odd, bad])['topics']
    topics = {topic['name']: topic for topic in found}
    for name, (if_unknown, if_bad) in GRAPH_ROWS.items():
        assert topics['/odd'][name] == if_unknown
        assert if_bad is ALWAYS or topics['/orders'][name] == if_bad
    assert set(topics['/odd']) == set(GRAPH_ROWS)
    [match] = [it for it in topics['/orders']['matches'] if it['node'] == '/robot']
    assert match['problem']


# The last errors


def test_errors_are_told_as_they_came() -> None:
    told = Told()
    assert view.troubles(told.watch) == []
    told.tell(bad_report())
    trouble, _ = view.troubles(told.watch)
    assert trouble.pop('advice')
    assert trouble == {
        'route': ORDERS, 'time_s': 1.0, 'error': 'DecodeError', 'text': 'no JSON', 'times': 9,
    }  # fmt: skip
