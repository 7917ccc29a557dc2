"""Nodes that use types which are not installed where the bridge runs."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Final

from harness import Bench, Process
from messages import Writer
from random_messages import RandomSource
from ros_package import install_package, write_package

from ros2_kafka_bridge.message_types import load_layout
from ros2_kafka_bridge.message_types.layout import Array, Kind, Layout, Primitive, String
from ros2_kafka_bridge.message_types.layout import Sequence as Listed

NEEDS: Final = ('std_msgs', 'builtin_interfaces')


def installed(folder: Path, name: str, messages: Mapping[str, str]) -> Path:
    """Install a package of messages on the robots alone; returns their prefix.

    Its .msg files are in `src` there.
    """
    prefix = folder / 'robots'
    install_package(write_package(prefix / 'src', name, dict(messages)), prefix, NEEDS)
    return prefix


@contextmanager
def robot(
    bench: Bench,
    message_type: str,
    prefix: Path,
    *options: str,
    publishes: Mapping[str, Sequence[bytes]] | None = None,
    takes: Mapping[str, Path] | None = None,
) -> Iterator[Process]:
    """A node with endpoints of one type, TRANSIENT_LOCAL (tests/peers/describing_node.py)."""
    arguments = [message_type, '--prefix', str(prefix), *options]
    for topic, messages in (publishes or {}).items():
        file = bench.place / f'{topic.strip("/")}-{prefix.parent.name}.hex'
        file.write_text('\n'.join(message.hex() for message in messages))
        arguments += ['--publish', f'{topic}={file}']
    for topic, file in (takes or {}).items():
        arguments += ['--take', f'{topic}={file}']
    with bench.script('describing_node.py', *arguments) as process:
        process.wait_for('ready')
        yield process


def random_cdr(message_type: str, folder: Path, count: int) -> list[bytes]:
    """Messages of a type of .msg files, each with other values."""
    layout = load_layout(message_type, [folder])
    return [Writer('<').value_of(_value(layout, RandomSource(n)), layout) for n in range(count)]


def _value(kind: Kind, source: RandomSource) -> Any:
    match kind:
        case Primitive('byte'):
            return bytes([source.number('byte')])
        case Primitive():
            return source.number(kind.name)
        case String():
            return source.text().encode()[: kind.bound].decode(errors='ignore')
        case Array():
            return [_value(kind.item, source) for _ in range(kind.length)]
        case Listed():
            return [_value(kind.item, source) for _ in range(source.length(kind.bound))]
        case Layout():
            return SimpleNamespace(**{it.name: _value(it.kind, source) for it in kind.fields})
