"""The drawings and the table of docs/warehouse-modules.md, from `ros2_kafka_warehouse.topics`."""

import re
from collections import defaultdict
from collections.abc import Iterable

from ros2_kafka_warehouse.topics import BRIDGE, KAFKA, STRING, TOPICS, Topic

__all__ = ['fill']

ASIDE = frozenset(('validator', BRIDGE))  # they hear of nearly everything


def fill(page: str) -> str:
    """The page with its marked parts made anew."""
    for name, text in (
        ('modules', _modules()),
        ('kafka', _kafka()),
        ('topics', _table()),
    ):
        part = re.search(rf'<!-- {name}: .*? -->\n(.*?)<!-- end of {name} -->', page, re.DOTALL)
        if part is None:
            raise SystemExit(f'docs/warehouse-modules.md has no part "{name}"')
        page = page[: part.start(1)] + text + page[part.end(1) :]
    return page


def _modules() -> str:
    """Who tells whom, one arrow for each pair."""
    arrows: dict[tuple[str, str], list[str]] = defaultdict(list)
    for topic in TOPICS:
        for publisher in topic.publishers:
            for subscriber in topic.subscribers:
                if not {publisher, subscriber} & ASIDE:
                    arrows[publisher, subscriber].append(topic.name)
    names = sorted({name for pair in arrows for name in pair})
    boxes = [f'    {name}["{_title(name)}"]' for name in names]
    lines = [
        f'    {publisher} -- "{"<br>".join(topics)}" --> {subscriber}'
        for (publisher, subscriber), topics in arrows.items()
    ]
    return _mermaid('flowchart TD', [*boxes, *lines])


def _kafka() -> str:
    """The way over the bridge, both ways: each arrow is a ROS topic."""
    by_name = {topic.name: topic for topic in TOPICS}
    lines: list[str] = []
    modules: set[str] = set()
    for number, kafka in enumerate(KAFKA):
        ros, box = by_name[kafka.ros], f'k{number}[("{kafka.name}")]'
        ends = ros.subscribers if kafka.to_ros else ros.publishers
        modules.update(ends)
        for module in ends:
            way = (box, module) if kafka.to_ros else (module, box)
            lines.append(f'    {way[0]} -- "{ros.name}" --> {way[1]}')
    boxes = [f'    {name}["{_title(name)}"]' for name in sorted(modules)]
    return _mermaid('flowchart LR', [*boxes, *lines])


def _table() -> str:
    head = '| topic | publisher | subscribers | message | QoS of the publisher |'
    rows = [head, '|---|---|---|---|---|']
    for topic in TOPICS:
        publishers = ', '.join(_title(name) for name in topic.publishers)
        subscribers = ', '.join(_title(name) for name in topic.subscribers) or 'for onlookers'
        what = f'`{topic.content}`' if topic.type.endswith('String') else topic.content
        kind = '' if topic.type.endswith('String') else f' ({topic.type})'
        message = f'{what}{kind}'
        qos = _qos(topic)
        rows.append(f'| `{topic.name}` | {publishers} | {subscribers} | {message} | {qos} |')
    return '\n'.join([*rows, ''])


def _qos(topic: Topic) -> str:
    durability = 'transient local' if topic.latched or topic.history else 'volatile'
    if topic.type != STRING:
        return f'{durability}, depth 1'
    return f'{durability}, keep last' if topic.latched else f'{durability}, keep all'


def _title(name: str) -> str:
    return name.replace('_', ' ').title() if name != BRIDGE else 'the bridge'


def _mermaid(kind: str, lines: Iterable[str]) -> str:
    return '\n'.join(['```mermaid', kind, *lines, '```', ''])
