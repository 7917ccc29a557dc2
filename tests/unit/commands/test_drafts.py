"""What `init --from-graph` makes of a graph; every file that it writes is right."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from ros2_kafka_bridge.commands.init.drafts import Draft, drafts
from ros2_kafka_bridge.commands.init.write import graph_text, scalar
from ros2_kafka_bridge.commands.names import kafka_name, stem, unique
from ros2_kafka_bridge.config.file import loads
from ros2_kafka_bridge.config.settings import Config, KafkaToRosRoute
from ros2_kafka_bridge.errors import RouteError
from ros2_kafka_bridge.ros.node import Topic
from ros2_kafka_bridge.ros.peer import Peer
from ros2_kafka_bridge.ros.shown_types import ShownTypes, TypeOrError
from ros2_kafka_bridge.ros.types import load_type

TEXT = 'std_msgs/msg/String'


def peer(node: str = '/robot', message_type: str = TEXT, **qos: Any) -> Peer:
    return Peer.of_qos(node, message_type, b'gid', '', QoSProfile(depth=10, **qos))


def topic(name: str, publishers: Sequence[Peer] = (), subscribers: Sequence[Peer] = ()) -> Topic:
    types = sorted({found.message_type for found in [*publishers, *subscribers]})
    return Topic(name, types, list(publishers), list(subscribers))


def not_here(topics: Sequence[Topic]) -> ShownTypes:
    """What is known of types that are not installed: nodes describe those of `told` alone."""
    known: dict[str, TypeOrError] = {
        'told/msg/Own': load_type(TEXT)._replace(name='told/msg/Own'),
        'other/msg/Own': RouteError('nobody describes it: put its .msg files somewhere'),
    }
    return {(it.name, name): known[name] for it in topics for name in it.types if name in known}


def drafted(topics: list[Topic], kafka: list[str] | None = None) -> list[Draft]:
    return drafts(topics, not_here(topics), kafka)


def written(topics: list[Topic], kafka: list[str] | None = None) -> tuple[str, Config]:
    """The file for a graph, and what it says."""
    text = graph_text(Path('bridge.yaml'), 'localhost:9092', topics, drafted(topics, kafka))
    return text, loads(text, 'bridge.yaml', {})


def one(found: list[Draft]) -> Draft:
    [draft] = found
    return draft


def test_what_is_published_goes_to_kafka_and_what_is_only_read_comes_from_it() -> None:
    graph = [
        topic('/both', [peer('/a')], [peer('/b')]),
        topic('/command', [], [peer()]),
        topic('/odom', [peer()]),
    ]
    found = drafted(graph)
    assert [(d.name, d.way) for d in found] == [
        ('both', 'to Kafka'),
        ('command', 'from Kafka'),
        ('odom', 'to Kafka'),
    ]


@pytest.mark.parametrize(
    'name', ['/rosout', '/parameter_events', '/clock', '/_hidden', '/arm/_action/feedback']
)
def test_what_ros_itself_uses_is_left_out_and_named(name: str) -> None:
    text, config = written([topic(name, [peer()]), topic('/odom', [peer()])])
    assert [route.name for route in config.routes] == ['odom']
    assert f'# Left out, because ROS itself uses them or only a bridge does: {name}.\n' in text


def test_a_topic_that_only_a_bridge_publishes_is_read_by_others() -> None:
    bridged = topic('/orders', [peer('/kafka_bridge_warehouse_1')], [peer('/planner')])
    assert one(drafted([bridged])).way == 'from Kafka'


def test_text_is_text_pictures_are_bytes_and_all_else_is_json() -> None:
    types = [TEXT, 'std_msgs/msg/Bool', 'sensor_msgs/msg/Image']
    _, config = written([topic(f'/t{n}', [peer(message_type=t)]) for n, t in enumerate(types)])
    assert [route.format for route in config.routes] == ['text', 'json', 'cdr']


def test_two_types_and_a_type_that_nobody_describes_become_comments_with_the_reason() -> None:
    mixed = topic('/mixed', [peer('/a'), peer('/b', 'std_msgs/msg/Bool')])
    text, config = written([mixed, topic('/own', [peer(message_type='other/msg/Own')]),
                            topic('/odom', [peer()])])  # fmt: skip
    assert [route.name for route in config.routes] == ['odom']
    assert '# /mixed has types std_msgs/msg/Bool and std_msgs/msg/String: a route' in text
    assert '  # nobody describes it: put its .msg files somewhere.\n' in text
    assert '  # - name: mixed\n' in text
    assert '  # - name: own\n' in text


def test_a_type_that_a_node_describes_is_a_route_with_a_comment_that_says_so() -> None:
    text, config = written([topic('/own', [peer(message_type='told/msg/Own')])])
    assert [route.name for route in config.routes] == ['own']
    assert '# Its type is not installed here: the bridge asks a node that uses it.\n' in text
    mixed = topic('/mixed', [peer(message_type='told/msg/Own'), peer(message_type='z/msg/B')])
    assert 'Its type' not in written([mixed, topic('/odom', [peer()])])[0]


def test_what_a_publisher_offers_is_said_where_it_matters() -> None:
    lossy = peer('/camera', reliability=ReliabilityPolicy.BEST_EFFORT)
    latched = peer('/map_server', durability=DurabilityPolicy.TRANSIENT_LOCAL)
    text, _ = written([topic('/image', [lossy]), topic('/map', [latched])])
    assert '# Best effort from /camera: what the network loses is lost before the bridge.' in text
    assert '# Transient local from /map_server: what it published before' in text


def test_a_subscriber_that_asks_for_what_was_before_is_given_it() -> None:
    asks = peer('/planner', durability=DurabilityPolicy.TRANSIENT_LOCAL)
    _, config = written([topic('/map', [], [asks])])
    [route] = config.routes
    assert isinstance(route, KafkaToRosRoute)
    assert route.sink.qos.durability == 'transient_local'


def test_a_name_that_kafka_has_for_the_topic_is_used() -> None:
    text, _ = written([topic('/robot1/odom', [peer()])], ['robot1_odom', 'else'])
    assert '    to: {kafka: robot1_odom}\n' in text
    text, _ = written([topic('/robot1/odom', [peer()])], ['else'])
    assert '    to: {kafka: robot1.odom}\n' in text
    assert '  # Kafka has no topic robot1.odom yet.\n' in text


def test_names_that_kafka_takes_for_one_become_two() -> None:
    _, config = written([topic('/a/b', [peer()]), topic('/a_b', [peer()])])
    topics = [
        route.sink.kafka for route in config.routes if not isinstance(route, KafkaToRosRoute)
    ]
    assert topics == ['a.b', 'a_b-2']
    assert len({route.name for route in config.routes}) == 2


def test_a_name_from_the_network_cannot_break_out_of_its_comment() -> None:
    evil = topic('/odom', [peer('/robot\nroutes: [x]\x07')])
    _, config = written([evil])
    assert [route.name for route in config.routes] == ['odom']


@pytest.mark.parametrize(
    'word', ['true', 'null', '~', '12', '1e3', 'a: b', '', "'x", 'a #b', 'a, b']
)
def test_a_word_that_yaml_would_read_as_something_else_is_quoted(word: str) -> None:
    quoted = scalar(word)
    assert quoted[0] == quoted[-1] == "'"
    assert scalar('orders.in') == 'orders.in'


def test_names_correspond_whatever_stands_between_their_words() -> None:
    names = ['/robot1/odom', 'robot1.odom', 'robot1_odom', 'Robot1-odom']
    assert {stem(name) for name in names} == {'robot1.odom'}
    assert stem('robot1odom') != 'robot1.odom'


def test_a_name_that_is_taken_gets_a_number_and_stays_legal() -> None:
    taken: set[str] = set()
    names = [unique(kafka_name('/' + 'x' * 240), taken) for _ in range(3)]
    assert len(set(names)) == 3
    assert all(len(name) <= 236 for name in names)


WORDS = st.from_regex(r'[A-Za-z][A-Za-z0-9_]{0,12}', fullmatch=True)
NAMES = st.one_of(
    st.lists(WORDS, min_size=1, max_size=4).map(lambda words: '/' + '/'.join(words)),
    st.sampled_from(['/true', '/null', '/on', '/a/b', '/a_b', '/1x', '/x-y', '/' + 'y' * 246]),
)
PEERS = st.lists(
    st.builds(
        peer,
        st.text(min_size=1, max_size=20),
        st.sampled_from([TEXT, 'std_msgs/msg/Bool', 'other/msg/Own', 'told/msg/Own']),
        reliability=st.sampled_from([ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT]),
        durability=st.sampled_from([DurabilityPolicy.VOLATILE, DurabilityPolicy.TRANSIENT_LOCAL]),
    ),
    max_size=3,
)
GRAPHS = st.lists(st.builds(topic, NAMES, PEERS, PEERS), max_size=8, unique_by=lambda t: t.name)


@settings(max_examples=60)
@given(GRAPHS, st.one_of(st.none(), st.lists(WORDS, max_size=3)))
def test_the_file_is_right_whatever_the_graph_is(
    graph: list[Topic], kafka: list[str] | None
) -> None:
    graph.append(topic('/surely', [peer()]))
    _, config = written(graph, kafka)
    usable = [draft.name for draft in drafted(graph, kafka) if not draft.problem]
    assert [route.name for route in config.routes] == usable
