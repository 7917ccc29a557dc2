"""What a changed configuration changes in a running bridge.

    python -m ros2_kafka_bridge.process.config_diff --plan FD --result FD

reads the file of that plan again and tells what it found, as a line of JSON. The process that
runs the bridge starts it: to read a configuration needs much, and might even fail badly.
"""

import argparse
import contextlib
import signal
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import msgspec

from ros2_kafka_bridge.process.plan import Plan, plan_of, read_plan

_OF_ALL_ROUTES: Final = ('name', 'kafka', 'membership', 'ros', 'schema_registry', 'tracing')
_AT_NEXT_START: Final = ('listen', 'node', 'start')
_NONE: Final = 'nothing'


class Difference(msgspec.Struct, frozen=True):
    """What differs between two configurations.

    Args:
        added: Names of routes.
        removed: Names of routes.
        changed: Names of routes that have to be started again.
        unchanged: Names of routes that are not touched.
        lines: What differs, for a person, with every secret masked.
        at_next_start: What differs and counts only when the bridge is started again.
    """

    added: tuple[str, ...] = ()
    removed: tuple[str, ...] = ()
    changed: tuple[str, ...] = ()
    unchanged: tuple[str, ...] = ()
    lines: tuple[str, ...] = ()
    at_next_start: tuple[str, ...] = ()

    @property
    def is_empty(self) -> bool:
        """Whether nothing differs."""
        return not (self.lines or self.at_next_start)

    @property
    def all_lines(self) -> tuple[str, ...]:
        """What differs, whenever it counts."""
        return (*self.lines, *(f'{x} (from the next start on)' for x in self.at_next_start))


class Checked(msgspec.Struct, frozen=True):
    """What was found in a file: a plan and what differs, or its mistakes."""

    plan: Plan | None = None
    difference: Difference = Difference()
    problems: tuple[str, ...] = ()


def difference(before: Plan, after: Plan) -> Difference:
    """Tell what a bridge that runs one configuration has to do to run another."""
    old, new = _routes(before), _routes(after)
    everywhere = any(before.values.get(n) != after.values.get(n) for n in _OF_ALL_ROUTES)
    common = [name for name in new if name in old]
    changed = [name for name in common if everywhere or old[name] != new[name]]
    added = [name for name in new if name not in old]
    removed = [name for name in old if name not in new]
    lines = [line for name in _OF_ALL_ROUTES for line in _lines(before, after, name)]
    for name in changed:
        lines += _compared(f'routes.{name}', old[name], new[name])
    lines += [f'routes.{name}: added' for name in added]
    lines += [f'routes.{name}: removed' for name in removed]
    at_next_start: list[str] = []
    for line in (*_lines(before, after, 'workers'), *_lines(before, after, 'monitoring')):
        later = line.startswith(('workers:', 'monitoring:')) or any(
            line.startswith(f'monitoring.{name}:') for name in _AT_NEXT_START
        )
        (at_next_start if later else lines).append(line)
    return Difference(
        tuple(added),
        tuple(removed),
        tuple(changed),
        tuple(name for name in common if name not in changed),
        tuple(lines),
        tuple(at_next_start),
    )


def _routes(plan: Plan) -> dict[str, Any]:
    runs = set(plan.names)
    return {route['name']: route for route in plan.values['routes'] if route['name'] in runs}


def _lines(before: Plan, after: Plan, name: str) -> list[str]:
    return list(_compared(name, before.values.get(name), after.values.get(name)))


def _compared(path: str, before: Any, after: Any) -> Iterator[str]:
    """A line for each value that differs; two mappings are compared in their parts."""
    if before == after:
        return
    if isinstance(before, Mapping) and isinstance(after, Mapping):
        for name in {**before, **after}:
            yield from _compared(f'{path}.{name}', before.get(name), after.get(name))
        return
    shown = _shown(path, before), _shown(path, after)
    if shown[0] == shown[1]:
        yield f'{path}: has changed'
    else:
        yield f'{path}: {shown[0]} -> {shown[1]}'


def _shown(path: str, value: Any) -> str:
    from ros2_kafka_bridge.config.base import masked_value  # noqa: PLC0415 (heavy)
    from ros2_kafka_bridge.kafka.properties import is_secret  # noqa: PLC0415
    from ros2_kafka_bridge.logs.text import printable  # noqa: PLC0415
    from ros2_kafka_bridge.outside.masking import MASK  # noqa: PLC0415

    if value is None:
        return _NONE
    parts = path.split('.')
    if any(is_secret('.'.join(parts[first:])) for first in range(len(parts))):
        return MASK
    masked = masked_value(path, _said(value))
    return printable(masked if isinstance(masked, str) else msgspec.json.encode(masked).decode())


def _said(value: Any) -> Any:
    """The same value without what is left out."""
    if isinstance(value, Mapping):
        return {name: _said(item) for name, item in value.items() if item is not None}
    return [_said(item) for item in value] if isinstance(value, list) else value


def check(before: Plan) -> Checked:
    """Read the file of a plan again."""
    from ros2_kafka_bridge.errors import BridgeError, ConfigError  # noqa: PLC0415 (heavy)
    from ros2_kafka_bridge.process.load import chosen, load_checked  # noqa: PLC0415

    file = Path(before.file)
    try:
        config = load_checked(file)
        plan = plan_of(config, file, chosen(config, ','.join(before.chosen)))
    except ConfigError as error:
        return Checked(problems=tuple(error.problems))
    except BridgeError as error:
        return Checked(problems=(str(error),))
    return Checked(plan, difference(before, plan))


def main(arguments: Sequence[str] | None = None) -> int:
    """Tell what is found in the file of a plan; returns the exit status."""
    parser = argparse.ArgumentParser(prog='python -m ros2_kafka_bridge.process.config_diff')
    parser.add_argument('--plan', type=int, required=True, metavar='FD')
    parser.add_argument('--result', type=int, required=True, metavar='FD', help='where it is told')
    options = parser.parse_args(arguments)
    # Held back at the start, as the others: but when its supervisor has gone, who could end it?
    signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGTERM])
    found = check(read_plan(options.plan))
    with (
        contextlib.suppress(BrokenPipeError),  # nobody waits for it any more
        open(options.result, 'wb', closefd=False) as output,
    ):
        output.write(msgspec.json.encode(found) + b'\n')
    return 0


if __name__ == '__main__':
    sys.exit(main())
