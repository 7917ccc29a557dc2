"""The graph of a running warehouse, and the one that the docs draw."""

import json

from harness import Bench

from ros2_kafka_warehouse.domain.site import Site
from ros2_kafka_warehouse.topics import BRIDGE, TOPICS

BRIDGE_NODE = 'kafka_bridge_warehouse'
Graph = dict[str, dict[str, list[str]]]


def running_graph(bench: Bench, site: Site) -> Graph:
    """Who publishes and who subscribes to each drawn topic, by a node that looks."""
    with bench.script('ros_graph.py', '60', *drawn_graph(site)) as reader:
        assert reader.wait(90) == 0, reader.output()
        found = json.loads(reader.output())
    assert isinstance(found, dict)
    return found


def drawn_graph(site: Site) -> Graph:
    """The graph as `ros2_kafka_warehouse.topics`, and so the drawings, have it."""
    robots = [name.replace('-', '_') for name in site.robots]
    return {
        name: {'publishers': _nodes(topic.publishers), 'subscribers': _nodes(topic.subscribers)}
        for topic in TOPICS
        for name in (
            [topic.name.replace('<robot>', robot) for robot in robots]
            if '<robot>' in topic.name
            else [topic.name]
        )
    }


def _nodes(modules: tuple[str, ...]) -> list[str]:
    return sorted(BRIDGE_NODE if name == BRIDGE else name for name in modules)
