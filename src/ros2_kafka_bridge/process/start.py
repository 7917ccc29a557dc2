"""What a bridge begins as: it reads the configuration, and becomes the process that runs it.

    python -m ros2_kafka_bridge.process.start FILE [--routes a,b] [--snapshots FD]

That is a worker with all routes, or the supervisor of several. Neither loads what reads and checks
a configuration: it would hold the memory for as long as it runs. With `--snapshots` it is a worker
in any case, which says there how its routes are doing (`process.worker`).
"""

import argparse
import contextlib
import faulthandler
import os
import resource
import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NoReturn

from ros2_kafka_bridge.errors import BridgeError, ConfigError
from ros2_kafka_bridge.process.child_process import become
from ros2_kafka_bridge.process.load import chosen, load_checked
from ros2_kafka_bridge.process.plan import Plan, plan_of, write_plan
from ros2_kafka_bridge.process.signals import Signals
from ros2_kafka_bridge.threads.stop import SIGNALS

_OPEN_FILES: Final = 65_536


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Become the bridge; where its configuration is wrong, end with status 2."""
    faulthandler.enable()  # a crash in a library names the place, in the log of whoever started us
    options = _parse(arguments)
    # Whoever started this process may have held them back.
    signals = Signals(_end)
    signals.install()
    allow_open_files()
    try:
        plan = _plan(options.file, options.routes)
    except BridgeError as error:
        print(error, file=sys.stderr)  # noqa: T201 (the words for the user, as from the command line)
        sys.exit(2)
    _become(plan, options, signals)


def allow_open_files() -> None:
    """Raise the limit of open files as far as this user may, as a route needs nine or so.

    Systems begin with a low one, for programs that cannot count further than 1024.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = _OPEN_FILES if hard == resource.RLIM_INFINITY else min(hard, _OPEN_FILES)
    if soft != resource.RLIM_INFINITY and soft < wanted:
        with contextlib.suppress(OSError, ValueError):
            resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog='python -m ros2_kafka_bridge.process.start', description='Runs a bridge.'
    )
    parser.add_argument('file', type=Path, help='configuration (YAML)')
    parser.add_argument('--routes', default='', help='names with commas (default: all)')
    parser.add_argument('--log-format', choices=('text', 'json'), default='text')
    parser.add_argument('--snapshots', type=int, metavar='FD', help='where snapshots go')
    return parser.parse_args(arguments)


def _end(_number: int) -> NoReturn:
    # No exception: it may come in the middle of a library that passes over it.
    os._exit(0)


def _plan(file: Path, names: str) -> Plan:
    config = load_checked(file)
    routes = chosen(config, names)
    if not file.is_file():
        raise ConfigError([f'{file}: can be read only once: save it as a file, to be run'])
    # A link is followed anew by each reload: a ConfigMap, or a release, is changed by its link.
    place = file.absolute()
    try:
        str(place).encode()
    except UnicodeEncodeError:
        raise ConfigError([f'{place!a}: its path is not UTF-8: rename it']) from None
    return plan_of(config, place, routes)


def _become(plan: Plan, options: argparse.Namespace, signals: Signals) -> NoReturn:
    descriptor = write_plan(plan)
    os.set_inheritable(descriptor, True)  # noqa: FBT003 (the standard library's)
    signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    if signals.take_reload():
        os.kill(os.getpid(), signal.SIGHUP)  # it waits for who hears it next
    words = [f'--log-format={options.log_format}', f'--plan={descriptor}']
    words += ['--terminal'] if signals.had_terminal else []
    tells = [] if options.snapshots is None else [f'--snapshots={options.snapshots}']
    is_supervised = plan.supervised and not tells
    become(
        'process.supervisor' if is_supervised else 'process.worker',
        [*words, *tells, '--', plan.file],
    )


if __name__ == '__main__':
    main()
