"""Orders flow both ways for minutes while things break at random; at the end each is looked for.

    make faults
    python -m benchmarks.faults --minutes 10 --seed 7
    python -m benchmarks.faults --faults bridge_kill,broker_kill --rate 200

A real Kafka, a real bridge, real ROS nodes, each a process of its own. Which faults come when is
drawn from a seed, which is printed: the same seed and options repeat the plan. What every process
said and every order that was sent and came is kept in the directory of the run.
"""

import argparse
import random
import shlex
import shutil
import signal
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from types import FrameType, MappingProxyType
from typing import Any, Final

from confluent_kafka import KafkaException
from rich.console import Console

from benchmarks.faults.disk import mount_small_disk
from benchmarks.faults.faults import FAULTS
from benchmarks.faults.memberships import MEMBERSHIPS
from benchmarks.faults.plan import Step, make_plan
from benchmarks.faults.report import keep, show
from benchmarks.faults.run import run
from benchmarks.faults.setting import Setting
from benchmarks.faults.streams import FROM_KAFKA, STREAMS
from benchmarks.faults.world import SPOOLS
from rig.hosts import Hosts, Network
from rig.processes import ProcessError
from ros2_kafka_bridge.errors import ConfigError, TransportError

OUT: Final = Path('build/faults')
MINUTES: Final = 8.0
RATE: Final = 100.0
BROKERS: Final = 3
DOMAIN: Final = 219
FILE: Final = 'faults.json'
_WIDTH: Final = 128
_NEEDS: Final = MappingProxyType(
    {
        'cluster': '--brokers 3',
        'hosts': 'networks of their own (root, and --hosts)',
        'disk': 'a disk of its own (root) and a stream with a spool',
        'one bridge': 'one bridge (no --standby)',
        'two bridges': '--standby',
        'to ROS': f'the stream {FROM_KAFKA.name}',
        'from ROS': f'another stream than {FROM_KAFKA.name}',
    }
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run it; returns 0 where the guarantees held, 1 where not, 2 where it could not start."""
    options = _parse(arguments)
    seed = random.SystemRandom().randrange(10_000) if options.seed is None else options.seed
    console = Console(width=None if sys.stdout.isatty() else _WIDTH)
    tell = _teller(console)
    with ExitStack() as stack:
        try:
            return _run(options, seed, stack, console, tell)
        except KeyboardInterrupt:
            return 1
        except ConfigError as error:
            console.print(str(error), style='red')
            return 2


def _run(
    options: Any, seed: int, stack: ExitStack, console: Console, tell: Callable[[str], None]
) -> int:
    place = options.out.absolute() / f'seed-{seed}'
    _make_place(place)
    setting = _setting(options, seed, place, stack, tell)
    has = abilities(setting)
    faults = [fault for fault in options.faults if fault.needs in has]
    for fault in options.faults:
        if fault not in faults:
            tell(f'left out, for it needs {_NEEDS[fault.needs]}: {fault.name}')
    if not faults:
        raise ConfigError(['none of the faults can be done here: nothing is left to run'])
    plan = make_plan(seed, faults, options.minutes, options.times)
    command = _command(options, seed, [fault.name for fault in faults])
    about = {
        'command': command, 'seed': seed, 'rate': options.rate, 'brokers': options.brokers,
        'membership': options.membership,
    }  # fmt: skip
    _show_plan(tell, seed, plan)
    keep(place / FILE, about, plan, None)
    stop = threading.Event()
    signal.signal(signal.SIGINT, _stopper(stop, tell))
    signal.signal(signal.SIGTERM, _stopper(stop, tell))
    try:
        outcome = run(setting, plan, stop, tell)
    except (ProcessError, TransportError, KafkaException, TimeoutError) as error:
        console.print(f'{error}\n{place} holds what all have said', style='red')
        return 1
    keep(place / FILE, about, plan, outcome)
    show(console, outcome)
    console.print(f'{outcome.done} of {len(plan)} faults, seed {seed}; {place / FILE}')
    console.print(f'again: {command}', soft_wrap=True)
    return 0 if outcome.is_good else 1


def _setting(
    options: Any, seed: int, place: Path, stack: ExitStack, tell: Callable[[str], None]
) -> Setting:
    """Make what the processes run on, as far as it can be made here."""
    has_spool = any(stream.spool is not None for stream in options.streams)
    has_own_disk = has_spool and mount_small_disk(place / SPOOLS, tell)
    hosts = None
    if options.hosts != 'no':
        try:
            hosts = Hosts(*stack.enter_context(Network(*Hosts._fields)))
        except ConfigError as error:
            if options.hosts == 'yes':
                raise
            tell(f'all on one host: {error}')
        else:
            stack.enter_context(hosts.site.entered())
    return Setting(
        place, tuple(options.streams), options.rate, seed, options.domain, options.brokers,
        hosts, 2 if options.standby else 1, has_own_disk, MEMBERSHIPS[options.membership],
    )  # fmt: skip


def abilities(setting: Setting) -> set[str]:
    """What faults can count on."""
    has = {
        '': True,
        'cluster': setting.brokers >= 3,
        'hosts': setting.hosts is not None,
        'disk': setting.has_own_disk,
        'one bridge': setting.bridges == 1,
        'two bridges': setting.bridges == 2,
        'to ROS': any(stream.is_from_kafka for stream in setting.streams),
        'from ROS': any(not stream.is_from_kafka for stream in setting.streams),
    }
    return {name for name, is_there in has.items() if is_there}


def _parse(arguments: Sequence[str] | None) -> Any:
    parser = argparse.ArgumentParser(
        prog='python -m benchmarks.faults',
        description='Breaks things at random, and proves that no order is lost.',
    )
    add = parser.add_argument
    add('--minutes', type=float, default=MINUTES, help='of faults; default: %(default)s')
    add('--times', type=int, help='how often each fault comes, in the place of --minutes')
    add('--seed', type=int, help='of the plan; by default another one each time')
    add('--faults', type=_of(FAULTS), default=','.join(FAULTS), help='default: %(default)s')
    add('--streams', type=_of(STREAMS), default=','.join(STREAMS), help='default: %(default)s')
    add('--rate', type=float, default=RATE, help='orders/s of a stream; default: %(default)s')
    add('--brokers', type=int, default=BROKERS, help='of Kafka; default: %(default)s')
    add('--membership', choices=MEMBERSHIPS, default='static', help='default: %(default)s')
    add('--standby', action='store_true', help='two bridges run the file, one stands by')
    add('--hosts', choices=('auto', 'yes', 'no'), default='auto', help='networks of their own')
    add('--domain', type=int, default=DOMAIN, help='ROS domain; default: %(default)s')
    add('--out', type=Path, default=OUT, help='default: %(default)s')
    return parser.parse_args(arguments)


def _of(table: Any) -> Callable[[str], list[Any]]:
    def parse(text: str) -> list[Any]:
        names = text.split(',')
        if wrong := [name for name in names if name not in table]:
            known = ', '.join(table)
            raise argparse.ArgumentTypeError(f'there is no {", ".join(wrong)}, only {known}')
        return [table[name] for name in names]

    return parse


def _command(options: Any, seed: int, faults: list[str]) -> str:
    words = [
        'python', '-m', 'benchmarks.faults',
        *_length(options), '--membership', options.membership,
        '--seed', str(seed), '--rate', f'{options.rate:g}', '--brokers', str(options.brokers),
        '--streams', ','.join(stream.name for stream in options.streams),
        '--faults', ','.join(faults), '--hosts', options.hosts,
        *(['--standby'] if options.standby else []),
    ]  # fmt: skip
    return shlex.join(words)


def _length(options: Any) -> list[str]:
    if options.times is None:
        return ['--minutes', f'{options.minutes:g}']
    return ['--times', str(options.times)]


def _show_plan(tell: Callable[[str], None], seed: int, plan: Sequence[Step]) -> None:
    tell(f'seed {seed}, {len(plan)} faults:')
    for place, step in enumerate(plan, 1):
        told = f'after {step.wait_s} s, for {step.hold_s} s, at {step.target}'
        tell(f'    {place}. {step.fault} ({told})')


def _make_place(place: Path) -> None:
    """An empty directory; what an earlier run of this seed has left there goes."""
    if (place / FILE).exists():
        shutil.rmtree(place)
    place.mkdir(parents=True)


def _teller(console: Console) -> Callable[[str], None]:
    start_s = time.monotonic()

    def tell(sentence: str) -> None:
        minutes, seconds = divmod(int(time.monotonic() - start_s), 60)
        console.print(f'{minutes:02}:{seconds:02} {sentence}', soft_wrap=True, highlight=False)

    return tell


def _stopper(
    stop: threading.Event, tell: Callable[[str], None]
) -> Callable[[int, FrameType | None], None]:
    """The first signal ends the faults, the second one everything."""

    def on_signal(_number: int, _frame: FrameType | None) -> None:
        if stop.is_set():
            raise KeyboardInterrupt
        stop.set()
        tell('no further faults; what was measured comes in a moment (again: at once, without)')

    return on_signal


if __name__ == '__main__':
    sys.exit(main())
