"""What the command lines of benchmarks do: measure, print, write it down, tell by their status."""

import argparse
import json
import signal
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from confluent_kafka import KafkaException
from rich.console import Console

from benchmarks.machine import machine, show_machine, versions
from rig.processes import ProcessError
from ros2_kafka_bridge.errors import ConfigError, TransportError

T = TypeVar('T')

Report = Callable[[T, argparse.Namespace], Mapping[str, Any]]
"""Makes what `--json` writes, beside machine and versions."""


def run(
    parser: argparse.ArgumentParser,
    arguments: Sequence[str] | None,
    measure: Callable[[argparse.Namespace, Console], T],
    show: Callable[[T, Console], None],
    report: Report[T],
    is_sound: Callable[[T], bool] = lambda _: True,
    *,
    has_kafka: bool = True,
    says_versions: bool = False,
) -> int:
    """Run a benchmark; returns the exit status: 1 where it failed, or its result is not sound.

    Args:
        parser: Of its options; `--json` is added to them, and `--bootstrap-servers` is that of a
            Kafka which is not ours.
        arguments: Of the command line, those of this process if None.
        measure: What takes its time.
        show: Prints its result; where it was measured comes behind that.
        report: For `--json`.
        is_sound: Whether the result is as it should be.
        has_kafka: Whether a Kafka takes part.
        says_versions: Whether it prints versions, too, and keeps errors apart from the figures.
    """
    parser.add_argument('--json', type=Path, help='write all of it into this file, too')
    options = parser.parse_args(arguments)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    console = Console(highlight=False)
    try:
        result = measure(options, console)
    except KeyboardInterrupt:
        return 130
    except (ConfigError, TransportError, ProcessError, KafkaException, OSError) as error:
        Console(stderr=says_versions, highlight=False).print(str(error), style='red', markup=False)
        return 1
    is_local_kafka = has_kafka and getattr(options, 'bootstrap_servers', None) is None
    told = {'machine': machine()._asdict(), 'versions': versions(is_local_kafka=is_local_kafka)}
    told |= report(result, options)
    show(result, console)
    if says_versions:
        show_machine(told, console)
    else:
        show_cores(console)
    write(options.json, told)
    return 0 if is_sound(result) else 1


def show_cores(console: Console) -> None:
    """Print what it was measured on."""
    here = machine()
    console.print(f'{here.cores} cores of {here.cpu}, {here.memory_gib} GiB')


def write(file: Path | None, told: Mapping[str, Any]) -> None:
    """Write what was measured, if somebody wants it."""
    if file:
        file.write_text(json.dumps(told, indent=2) + '\n', encoding='utf-8')
