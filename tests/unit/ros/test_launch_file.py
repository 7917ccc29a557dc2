"""What the launch file makes, with stand-ins for launch, which is not on PyPI."""

import re
import runpy
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import pytest

ROOT = Path(__file__).parents[3]
FILE = ROOT / 'launch' / 'bridge.launch.py'
UNIT = ROOT / 'packaging' / 'systemd' / 'ros2-kafka-bridge@.service'
MODULES = (
    'launch', 'launch.actions', 'launch.conditions', 'launch.event_handlers', 'launch.events',
    'launch.substitutions', 'launch_ros', 'launch_ros.actions', 'launch_ros.event_handlers',
    'launch_ros.events', 'launch_ros.events.lifecycle',
)  # fmt: skip


class Made(NamedTuple):
    """Anything of launch, and what it was made of."""

    kind: str
    arguments: tuple[Any, ...]
    options: dict[str, Any]


class StandIn(ModuleType):
    """Has all that is imported from it."""

    def __getattr__(self, name: str) -> partial[Made]:
        if name.startswith('__'):
            raise AttributeError(name)
        return partial(made, name)


def made(kind: str, *arguments: Any, **options: Any) -> Made:
    return Made(kind, arguments, options)


@pytest.fixture
def described(monkeypatch: pytest.MonkeyPatch) -> list[Made]:
    for name in MODULES:
        monkeypatch.setitem(sys.modules, name, StandIn(name))
    description = runpy.run_path(str(FILE))['generate_launch_description']()
    return list(everything(description))


def everything(part: object) -> Iterator[Made]:
    """A thing, and all that it was made of."""
    if isinstance(part, Made):
        yield part
        for inner in (*part.arguments, *part.options.values()):
            yield from everything(inner)
    elif isinstance(part, list):
        for inner in part:
            yield from everything(inner)


def declared(described: list[Made]) -> dict[str, str]:
    """The launch arguments with their defaults."""
    return {
        one.arguments[0]: one.options.get('default_value', '')
        for one in described
        if one.kind == 'DeclareLaunchArgument'
    }


def test_every_launch_argument_that_is_asked_for_is_declared(described: list[Made]) -> None:
    asked = {one.arguments[0] for one in described if one.kind == 'LaunchConfiguration'}
    assert asked == declared(described).keys()


def test_a_stop_may_take_as_long_as_systemd_lets_it_and_can_be_given_more(
    described: list[Made],
) -> None:
    node = next(one for one in described if one.kind == 'LifecycleNode')
    assert node.options['sigterm_timeout'] == made('LaunchConfiguration', 'stop_timeout_s')
    [of_systemd] = re.findall(r'^TimeoutStopSec=(\d+)$', UNIT.read_text(), re.MULTILINE)
    assert declared(described)['stop_timeout_s'] == of_systemd


def test_the_page_names_every_launch_argument_and_its_default(described: list[Made]) -> None:
    page = (ROOT / 'docs' / 'ros-workspace.md').read_text()
    section = page.split('## Launch\n')[1].split('\n## ')[0]
    rows = [row.split('|')[1:3] for row in section.splitlines() if row.startswith('| `')]
    told = {
        name: default
        for names, defaults in rows
        for name, default in zip(
            re.findall(r'`(\w+)`', names), [*re.findall(r'`(\w+)`', defaults), ''], strict=False
        )
    }
    assert told == declared(described)
