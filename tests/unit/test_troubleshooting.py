"""What the pages for operators quote and name is there."""

import ast
import functools
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import pytest
import typer.main

from ros2_kafka_bridge.cli import app
from ros2_kafka_bridge.monitoring.prometheus import METRICS, PREFIX

ROOT: Final = Path(__file__).parents[2]
SOURCES: Final = ROOT / 'src' / 'ros2_kafka_bridge'
PAGES: Final = ('runbook.md', 'tuning.md', 'troubleshooting.md')
VARIABLE: Final = '\0'


def page(name: str) -> str:
    return (ROOT / 'docs' / name).read_text()


def quotes() -> list[str]:
    return re.findall(r'^> `(.+)`$', page('troubleshooting.md'), re.MULTILINE)


@functools.cache
def said() -> str:
    """All texts of the sources, a line each, with a mark where a value stands."""
    trees = [ast.parse(path.read_text()) for path in sorted(SOURCES.rglob('*.py'))]
    return '\n'.join(text for tree in trees for text in texts(tree))


def texts(tree: ast.AST) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            yield ''.join(
                str(part.value) if isinstance(part, ast.Constant) else VARIABLE
                for part in node.values
            )
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield re.sub(r'%[\d.]*[sdrf]|\{[^{}]*\}', VARIABLE, node.value)


@pytest.mark.parametrize('quote', quotes())
def test_a_sentence_is_quoted_as_the_bridge_says_it(quote: str) -> None:
    fixed = [part for part in re.split(r'\s?\.\.\.', quote) if len(part.strip(' :;,()[].')) > 1]
    assert fixed
    words = said()
    assert [part for part in fixed if part.strip() not in words] == []


def test_every_quote_is_recognised_as_one() -> None:
    lines = [line for line in page('troubleshooting.md').splitlines() if line.startswith('>')]
    assert len(lines) == len(quotes()) > 20


def test_a_sentence_that_nobody_says_is_found() -> None:
    assert 'the bridge has had enough' not in said()


def commands() -> Iterator[tuple[str, list[str]]]:
    files = [ROOT / 'docs' / name for name in PAGES]
    for file in (*files, ROOT / 'packaging' / 'prometheus' / 'alerts.yaml'):
        text = re.sub(r'\s+#.*', '', file.read_text())
        text = re.sub(r'\n +', ' ', text)
        for line in re.findall(r'(?m)(?:`|^)ros2-kafka-bridge ([a-z][^`\n]*)', text):
            yield file.name, line.split()


def test_every_command_and_option_that_is_named_is_there() -> None:
    found = list(commands())
    assert len(found) > 30
    for file, words in found:
        command: Any = typer.main.get_command(app)
        rest = list(words)
        while rest and rest[0] in getattr(command, 'commands', {}):
            command = command.commands[rest.pop(0)]
        assert rest != words, f'{file}: {words}'
        options = {name for parameter in command.params for name in parameter.opts}
        assert {word for word in rest if word.startswith('--')} <= options, f'{file}: {words}'


@pytest.mark.parametrize('name', PAGES)
def test_every_metric_that_is_named_is_there(name: str) -> None:
    known = {metric.full_name for metric in METRICS}
    named = set(re.findall(r'(?<![:\w])ros2_kafka_bridge_\w+', page(name)))
    assert named <= known


@pytest.mark.parametrize(
    ('section', 'other'),
    [('### Kafka -> ROS\n', '(ROS to Kafka).'), ('### ROS -> Kafka\n', '(Kafka to ROS).')],
)
def test_a_bottleneck_is_looked_for_in_what_routes_of_that_direction_tell(
    section: str, other: str
) -> None:
    rows = re.findall(r'^\|.*', page('tuning.md').split(section)[1].split('\n#')[0], re.MULTILINE)
    named = set(re.findall(r'`(\w+)`', ''.join(rows)))
    foreign = {
        metric.full_name.removeprefix(PREFIX) for metric in METRICS if metric.help.endswith(other)
    }
    assert foreign
    assert named & foreign == set()
