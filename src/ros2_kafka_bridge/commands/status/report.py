"""How a running bridge is doing, asked where it is watched: what `status` prints."""

import json
import os
import re
import sys
from pathlib import Path
from typing import Final, NamedTuple

import msgspec
from rich.console import Console

from ros2_kafka_bridge.commands.screen import screen, show_line, show_table
from ros2_kafka_bridge.commands.status.ask import BridgeState, RouteState, ShownState, ask
from ros2_kafka_bridge.config.bridge_address import bridge_address
from ros2_kafka_bridge.config.monitoring import ADDRESSES, Address, is_address
from ros2_kafka_bridge.config.settings import Config
from ros2_kafka_bridge.dead_letters.shown import shortened
from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.logs.text import in_mb, printable
from ros2_kafka_bridge.process.load import load_checked
from ros2_kafka_bridge.protocol.limits import OLD_S

_NAME_CHARS: Final = 100


class _Asked(NamedTuple):
    """Which bridge is asked.

    Args:
        address: Where.
        name: Its name; empty for whoever answers there.
        runs: What it has to be run with, to answer there.
    """

    address: Address
    name: str
    runs: str


def report(file: Path | None, address: str, *, as_json: bool) -> int:
    """Ask a bridge how it is doing, and print it.

    Args:
        file: Its configuration, which may have mistakes.
        address: Where it is asked, in place of a file.
        as_json: For programs instead of people.

    Returns:
        0 when it is ready, 1 when it is not.

    Raises:
        ConfigError: It is not said which bridge, or nobody answers there, or somebody else.
    """
    asked = _asked(file, address)
    state, body = ask(asked.address, asked.runs)
    name = state.bridge.name
    if asked.name and name != asked.name:
        other = f'{asked.address} is the bridge {shortened(printable(name), _NAME_CHARS)}'
        cure = 'give each bridge a port of its own in monitoring.listen'
        raise ConfigError([f'{other}, not {asked.name}: {cure}'])
    if as_json:
        sys.stdout.write(f'{_indented(body)}\n')
    else:
        _show(state)
    return 0 if state.bridge.ready else 1


def _indented(body: bytearray) -> str:
    """The same JSON, without characters that might command a terminal."""
    text = msgspec.json.format(body, indent=2).decode(errors='replace')
    return re.sub(r'[^\x00-\x7f]+', lambda found: json.dumps(found[0])[1:-1], text)


def _asked(file: Path | None, address: str) -> _Asked:
    if file is None:
        return _at(address)
    if address:
        raise ConfigError([f'--address: {file} says it already: leave one out'])
    try:
        config = load_checked(file)
    except ConfigError as error:
        return _of_wrong(file, error)
    return _of_config(config, file)


def _at(address: str) -> _Asked:
    if not address:
        raise ConfigError(['which bridge? name its FILE, or --address HOST:PORT'])
    if not is_address(address):
        raise ConfigError([f'--address: expected {ADDRESSES}'])
    return _Asked(Address(address), '', 'this address as monitoring.listen')


def _of_config(config: Config, file: Path) -> _Asked:
    address = config.monitoring.address if config.monitoring else None
    if address is None:
        text = f'{file}: the bridge cannot be asked, because it listens nowhere; add '
        raise ConfigError([f'{text}monitoring: {{listen: 127.0.0.1:9464}} and start it again'])
    return _Asked(address, config.name, str(file))


def _of_wrong(file: Path, error: ConfigError) -> _Asked:
    """The bridge of a file with mistakes: one that runs goes by what it has read before."""
    found = bridge_address(file, os.environ)
    if found is None:
        other = f'{file}: does not tell which bridge to ask: --address HOST:PORT needs no file'
        raise ConfigError([*error.problems, other]) from None
    said = f'has mistakes, as it is read here: ros2-kafka-bridge check {file} shows them'
    sys.stderr.write(f'{file}: {said}\n')
    return _Asked(found.address, found.name, str(file))


def _show(state: ShownState) -> None:
    console, bridge = screen(), state.bridge
    word = 'ready' if bridge.ready else 'not ready'
    well = 'bold yellow' if bridge.old else 'bold green'
    style = well if bridge.ready else 'bold red'
    show_line(console, printable(f'{bridge.name}: {word}, {_told(bridge)}'), style)
    for problem in bridge.problems:
        show_line(console, printable(f'  {problem}'), 'red')
    if state.routes:
        _show_routes(console, state.routes)
    for worker in state.workers:
        if worker.problem:
            show_line(console, printable(f'worker {worker.number}: {worker.problem}'), 'red')
    if state.broker is None:
        show_line(console, 'Kafka: not asked yet')
    elif state.broker.problem:
        show_line(console, printable(f'Kafka: {state.broker.problem}'), 'red')


def _told(bridge: BridgeState) -> str:
    if bridge.lifecycle is None:
        return 'nothing told yet'
    ago = f', told {bridge.report_age_s:g} s ago' if bridge.old else ''
    return f'{bridge.lifecycle}{ago}'


def _show_routes(console: Console, routes: list[RouteState]) -> None:
    """All routes; what waits on disk, and how old numbers are, only where there is such."""
    columns = {
        'route': [it.name for it in routes],
        'state': [it.state for it in routes],
        '#rate /s': [_number(it.rate) for it in routes],
        '#p50': [_seconds(it.delay_s and it.delay_s[0]) for it in routes],
        '#p99': [_seconds(it.delay_s and it.delay_s[1]) for it in routes],
        '#lag': [_number(it.lag) for it in routes],
        '#in flight': [_number(it.in_flight) for it in routes],
        '#on disk': [_number(it.spooled) for it in routes],
        '#dead letters': [_number(it.ended.dead_lettered) for it in routes],
        '#MB at most': [_mb(it.memory_limit) for it in routes],
        '#told': [_ago(it.age_s) for it in routes],
        'reason': [it.reason or '-' for it in routes],
    }
    if all(it.spooled == 0 for it in routes):
        del columns['#on disk']
    if all(it.memory_limit is None for it in routes):
        del columns['#MB at most']
    if all(it.age_s is not None and it.age_s <= OLD_S for it in routes):
        del columns['#told']
    rows = [[[cell] for cell in row] for row in zip(*columns.values(), strict=True)]
    show_table(console, 'Routes', list(columns), rows)


def _number(value: float | None) -> str:
    if value is None:
        return '-'
    return f'{value:g}' if isinstance(value, float) else str(value)


def _mb(size_bytes: int | None) -> str:
    return '-' if size_bytes is None else in_mb(size_bytes).removesuffix(' MB')


def _ago(age_s: float | None) -> str:
    return 'not yet' if age_s is None else f'{age_s:.0f} s ago'


def _seconds(value: float | None) -> str:
    if value is None:
        return '-'
    return f'{value * 1000:.1f} ms' if value < 1 else f'{value:.1f} s'
