"""`ros2-kafka-warehouse run`: broker, bridge, modules and page, each a process, until Ctrl-C."""

import os
import shutil
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from math import inf
from pathlib import Path
from random import Random
from typing import Final

from ros2_kafka_bridge.testing.embedded_broker import EmbeddedBroker
from ros2_kafka_warehouse.children import Child, Program
from ros2_kafka_warehouse.domain.site import Site, site_yaml
from ros2_kafka_warehouse.kafka import AwayError, ask_for_topics, create_topics
from ros2_kafka_warehouse.nodes import MODULES
from ros2_kafka_warehouse.ros_domain import claim_domain, domain_of
from ros2_kafka_warehouse.run_options import Options, StartError, check, site_of
from ros2_kafka_warehouse.topics import TOPICS

_BRIDGE: Final = Path(__file__).parent / 'data' / 'bridge.yaml'
_LOOK_S: Final = 0.1
_START_S: Final = 120.0
_TELL_S: Final = 10.0
_END_S: Final = 30.0
_FAILED: Final = 1
_CANNOT_START: Final = 2


def run(options: Options) -> int:
    """Run the warehouse until SIGINT or SIGTERM; returns the exit status.

    0: it was stopped. 1: a part could not be kept running. 2: it could not start.

    Raises:
        SiteError: The site cannot be.
        FaultError: A fault cannot be.
        ProfileError: A profile cannot be.
        StartError: The port or the ROS domain is taken.
    """
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda *_: stop.set())
    site = site_of(options)
    with ExitStack() as stack:
        stack.enter_context(claim_domain(domain_of(options)))
        check(options, site)
        place = stack.enter_context(_place(options.logs))
        site_file = write_site(site, place)
        try:
            servers = options.bootstrap_servers
            if servers is None:
                servers = _embedded(stack)
            else:
                create_topics(servers)
        except AwayError as error:
            _say(str(error))
            return _CANNOT_START
        _set_environ(options, servers)
        warehouse = _Warehouse(programs_of(options, site_file, servers), place, stop)
        return warehouse.run(options, site, servers)


def write_site(site: Site, place: Path) -> Path:
    """Write a site for the modules; returns its file."""
    text, map_text = site_yaml(site, 'site.map')
    (place / 'site.map').write_text(map_text, encoding='ascii')
    path = place / 'site.yaml'
    path.write_text(text, encoding='utf-8')
    return path


class _Warehouse:
    """All processes.

    Args:
        programs: What runs, in the order in which it is stopped.
        place: Where the logs go.
        stop: Set when all is to end.
    """

    def __init__(self, programs: Sequence[Program], place: Path, stop: threading.Event) -> None:
        self._children = [Child(program, place) for program in programs]
        self._place = place
        self._stop = stop

    def run(self, options: Options, site: Site, servers: str) -> int:
        """Start all, keep all running until the stop; returns the exit status."""
        _say(f'starts {len(self._children)} processes; logs in {self._place}')
        status = 0
        try:
            for child in self._children:
                child.start()
                _say(f'{child.program.name} is process {child.pid}')
            if not self._wait_until_up(options):
                return _CANNOT_START
            with _random_orders(options, site, servers):
                while not self._stop.wait(_LOOK_S):
                    self._look()
                    if all(child.out_of_service for child in self._children):
                        break
        finally:
            if any(child.out_of_service for child in self._children):
                status = _FAILED
            self._end()
        return status

    def _look(self) -> None:
        for child in self._children:
            if news := child.look():
                _say(news)

    def _wait_until_up(self, options: Options) -> bool:
        began_s = time.monotonic()
        # What is left out comes when its user starts it: nobody knows when.
        deadline_s = began_s + _START_S if not options.without else inf
        tell_s = began_s + _TELL_S if options.without else inf
        while not self._stop.is_set():
            for child in self._children:
                child.hear()
            waits = [child for child in self._children if not child.is_ready]
            if not waits:
                where = f' http://{options.host}:{options.port}' if options.port else ''
                _say(f'the warehouse is up:{where} (Ctrl-C stops it)')
                return True
            dead = [child for child in waits if not child.runs]
            if dead or time.monotonic() > deadline_s:
                for child in dead or waits:
                    how = 'has ended' if not child.runs else 'does not come up'
                    _say(f'{child.program.name} {how}:\n{child.story()}')
                return False
            if time.monotonic() > tell_s:
                tell_s = inf
                _say(missing_of(options.without, [child.program.name for child in waits]))
            self._stop.wait(_LOOK_S)
        return True

    def _end(self) -> None:
        """Stop who asks before who answers; what does not end in time is killed."""
        _say('stops')
        deadline_s = time.monotonic() + _END_S
        for child in self._children:
            child.ask_to_end()
            if child.program.name in _FIRST and not child.end(deadline_s):
                _say(f'{child.program.name} was killed:\n{child.story()}')
        for child in self._children:
            if not child.end(deadline_s):
                _say(f'{child.program.name} was killed:\n{child.story()}')


def missing_of(without: Sequence[str], waits: Sequence[str]) -> str:
    """What the nodes that the user runs are still to say, for those that wait."""
    domain = os.environ.get('ROS_DOMAIN_ID') or '0'
    topics = [
        topic.name
        for topic in TOPICS
        if set(without) & set(topic.publishers) and set(waits) & set(topic.subscribers)
    ]
    what = f' that publishes {", ".join(topics)}' if topics else ''
    return (
        f'waits for {", ".join(without)} (you run it): a node in ROS domain {domain}{what}; '
        f'until then {", ".join(waits)} cannot begin'
    )


_FIRST: Final = frozenset(('page', 'bridge'))
_OBEYING: Final = frozenset(('robots', 'monitor'))


def programs_of(options: Options, site_file: Path, servers: str) -> list[Program]:
    """Page and bridge first: they drain what the modules have said, while these still run."""
    python = (sys.executable, '-m')
    place = site_file.parent
    programs = []
    if options.port:
        page = (
            'ros2_kafka_warehouse.page',
            '--bootstrap-servers',
            servers,
            '--site',
            str(site_file),
        )
        where = ('--host', options.host, '--port', str(options.port))
        # The page sends the random orders then, because a person can change their rate there.
        rate = ('--orders-per-minute', str(options.orders_per_minute))
        names = [f'--allow-host={name}' for name in options.allow_hosts]
        command = (*python, *page, *where, *rate, *names)
        programs.append(_program('page', command, 'http://', place))
    bridge = (*python, 'ros2_kafka_bridge', 'run', str(_BRIDGE))
    alive = place / 'bridge.alive'
    programs.append(Program('bridge', bridge, ' runs ', alive, tells_as_service=True))
    shared = (
        '--site', str(site_file), '--bootstrap-servers', servers, '--seed', str(options.seed),
        '--profiles', str(options.profiles), '--failure-profile', str(options.failure_profile),
        '--failures-per-hour', str(options.failures_per_hour),
        *(f'--fail={text}' for text in options.faults),
    )  # fmt: skip
    programs += [
        _program(
            name, (*python, 'ros2_kafka_warehouse', 'module', name, *shared), ': works', place
        )
        for name in MODULES
        if name not in options.without
    ]
    return programs


def _program(name: str, command: Sequence[str], ready: str, place: Path) -> Program:
    alive = place / f'{name}.alive'
    return Program(name, (*command, '--alive', str(alive)), ready, alive)


def _set_environ(options: Options, servers: str) -> None:
    """What the processes of the warehouse find in their environment."""
    os.environ['WAREHOUSE_KAFKA'] = servers
    # A command waits in Kafka for the modules of ours that obey it; a robot of one's own need not.
    ours = _OBEYING.difference(options.without)
    os.environ['WAREHOUSE_COMMAND_READERS'] = str(max(1, len(ours)))
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    os.environ['PYTHONUNBUFFERED'] = '1'
    # A dozen processes that each want all cores for a small matrix only hinder each other.
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    if options.domain is not None:
        os.environ['ROS_DOMAIN_ID'] = str(options.domain)


def _embedded(stack: ExitStack) -> str:
    broker = stack.enter_context(EmbeddedBroker())
    ask_for_topics(broker.bootstrap_servers)
    _say(f'an embedded broker answers at {broker.bootstrap_servers}')
    return broker.bootstrap_servers


@contextmanager
def _place(logs: Path | None) -> Iterator[Path]:
    if logs is not None:
        logs.mkdir(parents=True, exist_ok=True)
        yield logs
        return
    try:
        place = Path(tempfile.mkdtemp(prefix='warehouse-'))
    except OSError as error:
        raise StartError(
            f'there is no directory for temporary files ({error.strerror}): set TMPDIR to one, or '
            'name one for the logs with --logs'
        ) from error
    try:
        yield place
    finally:
        shutil.rmtree(place, ignore_errors=True)


@contextmanager
def _random_orders(options: Options, site: Site, servers: str) -> Iterator[None]:
    """Send random orders meanwhile, evenly, if no page does."""
    if options.orders_per_minute <= 0 or options.port:
        yield
        return
    from ros2_kafka_warehouse.send import send_random  # noqa: PLC0415 (only where orders are sent)

    ended = threading.Event()
    thread = threading.Thread(
        target=send_random,
        args=(
            servers,
            site,
            Random(options.seed),  # noqa: S311 (orders are no secret)
            60 / options.orders_per_minute,
            ended,
        ),
        name='random orders',
        daemon=True,
    )
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join(_END_S)


def _say(sentence: str) -> None:
    print(f'{time.strftime("%H:%M:%S")} {sentence}', flush=True)  # noqa: T201 (for the user)
