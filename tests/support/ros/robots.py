"""Nodes that use types which are not installed where the bridge runs."""

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Final

from support.formats.messages import RandomSource, Source, Writer, value_of
from support.processes.harness import Bench, Process
from support.ros.package import install_package, write_package

from ros2_kafka_bridge.message_types import load_layout
from ros2_kafka_bridge.message_types.layout import Layout

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
    """A node with endpoints of one type, TRANSIENT_LOCAL (rig/peers/ros_node.py)."""
    words = ends(bench, message_type, publishes or {}, takes or {})
    with bench.peer('ros_node', '--made', str(prefix), *words, *options) as process:
        process.wait_for('ready')
        yield process


def ends(
    bench: Bench,
    message_type: str,
    publishes: Mapping[str, Sequence[bytes]],
    takes: Mapping[str, Path],
) -> Sequence[str]:
    """The options of a node for its ends of one type."""
    place = bench.place / f'{time.monotonic_ns()}'
    sends, reads = place.with_suffix('.sends'), place.with_suffix('.takes')
    sends.write_text(
        ''.join(
            f'{topic} {message_type} {message}\n'
            for topic, messages in publishes.items()
            for message in ('', *(message.hex() for message in messages))
        )
    )
    reads.write_text(''.join(f'{topic} {message_type} {takes[topic]}\n' for topic in takes))
    return '--publish', str(sends), '--take', str(reads)


def random_cdr(message_type: str, folder: Path, count: int) -> list[bytes]:
    """Messages of a type of .msg files, each with other values."""
    layout = load_layout(message_type, [folder])
    return [Writer('<').value_of(_message(layout, RandomSource(n)), layout) for n in range(count)]


def _message(layout: Layout, source: Source) -> SimpleNamespace:
    return SimpleNamespace(
        **{it.name: value_of(it.kind, source, _message) for it in layout.fields}
    )
