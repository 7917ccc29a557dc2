"""The demonstration: a broker, orders that move, a table, a last line."""

import math
import shutil
import sys
import tempfile
import uuid
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final, NamedTuple

from ros2_kafka_bridge.demo.child import Child
from ros2_kafka_bridge.demo.ends import DemoEnds
from ros2_kafka_bridge.demo.table import Look, say, summary, view
from ros2_kafka_bridge.demo.topics import Topics
from ros2_kafka_bridge.demo.trip import SendPlan, Trip
from ros2_kafka_bridge.errors import ConfigError, TransportError
from ros2_kafka_bridge.kafka.addresses import servers_problem
from ros2_kafka_bridge.outside.extras import missing_ros
from ros2_kafka_bridge.testing.embedded_broker import EmbeddedBroker
from ros2_kafka_bridge.threads.stop import Stop, handling

HIGHEST_RATE: Final = 10_000.0  # what the demonstration itself can send and read beside the bridge
# The embedded broker keeps 5 MiB of a partition, about 9,000 orders: a bridge that is held up for
# some seconds must still find what it has not read.
HIGHEST_EMBEDDED_RATE: Final = 1_000.0
HIGHEST_DOMAIN: Final = 232
STOPPED_AT_ONCE: Final = 130
_SLOW: Final = 0.95
_PATIENCE_S: Final = 10.0  # longer than the session of a consumer of the bridge


class DemoOptions(NamedTuple):
    """What the user asks for.

    Args:
        rate: Orders per second.
        seconds: How long orders are sent.
        bootstrap_servers: Of a real broker; None for the embedded one.
        domain: ROS domain; None for that of the environment.
    """

    rate: float = 300.0
    seconds: float = 20.0
    bootstrap_servers: str | None = None
    domain: int | None = None


def run(options: DemoOptions) -> int:
    """Run the demonstration; returns the exit status.

    0: nothing was lost on the way through the bridge. 1: something was, or a process has failed.
    The first SIGINT or SIGTERM ends the sending, and what was sent is brought to its end and
    counted; the second ends at once (130).

    Raises:
        BridgeError: It could not start.
    """
    plan = _plan(options)
    place = _place()
    keeps_logs = False
    try:
        with _signals() as stop:
            status = _carry(options, plan, stop, place)
        keeps_logs = status != 0
    except KeyboardInterrupt:
        say('ended at once', is_error=True)
        return STOPPED_AT_ONCE
    finally:
        if not keeps_logs:
            shutil.rmtree(place)
    return status


def _place() -> Path:
    try:
        return Path(tempfile.mkdtemp(prefix='ros2-kafka-bridge-demo-'))
    except OSError as error:
        raise TransportError(
            f'there is no directory for temporary files ({error.strerror}): set TMPDIR to one'
        ) from error


def _plan(options: DemoOptions) -> SendPlan:
    rate, servers = options.rate, options.bootstrap_servers
    problems = []
    embedded = servers is None
    highest = HIGHEST_EMBEDDED_RATE if embedded else HIGHEST_RATE
    if not 0 < rate <= highest:
        more = ' with the embedded broker (--bootstrap-servers takes more)' if embedded else ''
        problems.append(
            f'--rate {rate:g}: expected more than 0, at most {highest:,.0f} orders a second{more}'
        )
    if not 0 < options.seconds < math.inf:
        problems.append(
            f'--seconds {options.seconds:g}: expected a number of seconds, more than 0'
        )
    if servers is not None and (problem := servers_problem(servers)):
        problems.append(f'--bootstrap-servers: {problem}; leave it out for an embedded broker')
    if options.domain is not None and not 0 <= options.domain <= HIGHEST_DOMAIN:
        problems.append(f'--domain {options.domain}: expected 0 to {HIGHEST_DOMAIN}')
    if missing := missing_ros():
        problems.append(missing)
    if problems:
        raise ConfigError(problems)
    return SendPlan(rate, max(1, round(rate * options.seconds)))


@contextmanager
def _signals() -> Iterator[Stop]:
    """The first signal asks for an end, the second interrupts, more are ignored."""
    stop = Stop()

    def on_signal(number: int, _frame: Any) -> None:
        was_at_once = stop.at_once
        stop.on_signal(number)
        if stop.at_once and not was_at_once:
            raise KeyboardInterrupt

    with handling(on_signal):
        yield stop


# The orders


def _carry(options: DemoOptions, plan: SendPlan, stop: Stop, place: Path) -> int:
    left: list[str] = []
    environ = {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
    if options.domain is not None:
        environ['ROS_DOMAIN_ID'] = str(options.domain)
    with _ends(options.bootstrap_servers) as ends, _topics(ends, stop, left):
        where = f'Kafka at {ends.bootstrap_servers}'
        if ends.is_embedded:
            where = "embedded broker (librdkafka's mock cluster)"
        title = f'{plan.total:,} orders, {plan.rate:,g} a second, {where}'
        with view(title, is_terminal=sys.stdout.isatty()) as show:
            trip = Trip(ends, _bridge(ends, place, environ), plan, stop, show)
            look = trip.run()
    return _sum_up(look, plan, [*trip.problems, *left, *losses(look)], place)


@contextmanager
def _ends(bootstrap_servers: str | None) -> Iterator[DemoEnds]:
    name = f'demo-{uuid.uuid4().hex[:8]}'
    if bootstrap_servers is None:
        with EmbeddedBroker() as broker:
            yield DemoEnds(name, broker.bootstrap_servers, is_embedded=True)
    else:
        yield DemoEnds(name, bootstrap_servers, is_embedded=False)


@contextmanager
def _topics(ends: DemoEnds, stop: Stop, problems: list[str]) -> Iterator[None]:
    """Make the two topics; on a shared broker delete all that was made there, afterwards."""
    topics = Topics(ends.bootstrap_servers)
    names = [ends.source, ends.sink]
    if ends.is_embedded:
        topics.look_up(names)
        yield
        return
    topics.greet()
    try:
        topics.create(names)
        yield
    finally:
        patience_s = 0.0 if stop.at_once else _PATIENCE_S
        if problem := topics.delete([*names, *ends.dead_letters], ends.groups, patience_s):
            problems.append(problem)


def _bridge(ends: DemoEnds, place: Path, environ: Mapping[str, str]) -> Child:
    file = place / 'bridge.yaml'
    file.write_text(ends.config, encoding='utf-8')
    command = [sys.executable, '-m', 'ros2_kafka_bridge.process.start', str(file)]
    return Child('the bridge', command, place / 'bridge.log', environ)


# Afterwards


def _sum_up(look: Look, plan: SendPlan, problems: Sequence[str], place: Path) -> int:
    """Say what has come out; returns the exit status."""
    if not look.seconds and not problems:
        say('stopped before the first order')
    for problem in problems:
        say(problem, is_error=True)
    if problems:
        say(f'the logs are kept in {place}', is_error=True)
    if not look.seconds:
        return 2 if problems else 0
    if look.rate < _SLOW * plan.rate:
        say(f'note: only {look.rate:,.0f} orders a second could be sent to this bridge')
    say(summary(look))
    return 1 if problems else 0


def losses(look: Look) -> Sequence[str]:
    """Say what was lost through the bridge, and what before the bridge could read it."""
    found = []
    # Some that were given back and deleted then had come through before.
    if deleted := min(look.deleted, look.lost):
        found.append(
            f'the broker deleted {deleted:,} orders before they were read (the embedded one keeps '
            '5 MiB of a partition): send fewer, or use --bootstrap-servers'
        )
    if lost := look.lost - deleted:
        found.append(f'the bridge has lost {lost:,} orders')
    return found
