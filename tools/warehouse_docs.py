"""The drawings and the table of docs/warehouse.md, from `ros2_kafka_warehouse.topics`."""

import re
from collections import defaultdict
from collections.abc import Iterable

from ros2_kafka_warehouse.topics import BRIDGE, KAFKA, TOPICS, Topic

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
            raise SystemExit(f'docs/warehouse.md has no part "{name}"')
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
    """The way over the bridge, both ways."""
    by_name = {topic.name: topic for topic in TOPICS}
    lines = []
    for number, kafka in enumerate(KAFKA):
        ros, box = by_name[kafka.ros], f'k{number}[("{kafka.name}")]'
        if kafka.to_ros:
            lines += [f'    {box} --> bridge', *_arrows(BRIDGE, ros, ros.subscribers)]
        else:
            publisher = ros.publishers[0]
            lines += [f'    {publisher} -- "{ros.name}" --> bridge', f'    bridge --> {box}']
    names = sorted({name for line in lines for name in re.findall(r'\b[a-z]+_?[a-z]+\b', line)})
    modules = {name for topic in TOPICS for name in (*topic.publishers, *topic.subscribers)}
    boxes = [f'    {name}["{_title(name)}"]' for name in names if name in modules]
    return _mermaid('flowchart LR', [*boxes, *lines])


def _arrows(publisher: str, topic: Topic, subscribers: Iterable[str]) -> list[str]:
    return [f'    {publisher} -- "{topic.name}" --> {name}' for name in subscribers]


def _table() -> str:
    rows = ['| topic | said by | heard by | what | QoS |', '|---|---|---|---|---|']
    for topic in TOPICS:
        said = ', '.join(_title(name) for name in topic.publishers)
        heard = ', '.join(_title(name) for name in topic.subscribers) or 'who wants to look on'
        what = f'`{topic.content}`' if topic.type.endswith('String') else topic.content
        kind = '' if topic.type.endswith('String') else f' ({topic.type})'
        rows.append(f'| `{topic.name}` | {said} | {heard} | {what}{kind} | {_qos(topic)} |')
    return '\n'.join([*rows, ''])


def _qos(topic: Topic) -> str:
    if topic.history:
        return 'transient local, keep all'
    return 'transient local, depth 1' if topic.latched else 'volatile'


def _title(name: str) -> str:
    return name.replace('_', ' ').title() if name != BRIDGE else 'the bridge'


def _mermaid(kind: str, lines: Iterable[str]) -> str:
    return '\n'.join(['```mermaid', kind, *lines, '```', ''])
