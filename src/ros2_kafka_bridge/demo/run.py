"""The demonstration: a broker, orders that move, a table, a last line."""

import math
import shutil
import signal
import sys
import tempfile
import uuid
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final, NamedTuple

from ros2_kafka_bridge.demo.contestants import BRIDGE, PAPER, Contestant, Ends
from ros2_kafka_bridge.demo.table import Look, say, summary, view
from ros2_kafka_bridge.demo.topics import Topics
from ros2_kafka_bridge.demo.trip import SendPlan, Trip
from ros2_kafka_bridge.errors import ConfigError, TransportError
from ros2_kafka_bridge.kafka.addresses import servers_problem
from ros2_kafka_bridge.outside.extras import missing_ros
from ros2_kafka_bridge.testing.embedded_broker import QUICK_FETCH, EmbeddedBroker
from ros2_kafka_bridge.threads.stop import Stop, signals_to_handle

RATE: Final = 300.0
COMPARED_RATE: Final = 1000.0  # where the paper's nodes lose on an ordinary machine
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
        rate: Orders per second; None for the one that fits.
        seconds: How long orders are sent.
        bootstrap_servers: Of a real broker; None for the embedded one.
        compare: Whether the paper's nodes carry the same orders, too.
        domain: ROS domain; None for that of the environment.
    """

    rate: float | None = None
    seconds: float = 20.0
    bootstrap_servers: str | None = None
    compare: bool = False
    domain: int | None = None


class _Kafka(NamedTuple):
    """Where the orders go.

    Args:
        properties: For consumers, by librdkafka's names.
    """

    words: str
    bootstrap_servers: str
    properties: Mapping[str, str]
    is_shared: bool


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
    outcome = None
    try:
        with _signals() as stop, _kafka(options.bootstrap_servers) as kafka:
            outcome = _sum_up(_carry(options, plan, kafka, stop, place), plan, place)
    except KeyboardInterrupt:
        say('ended at once', is_error=True)
        outcome = _Outcome(STOPPED_AT_ONCE, keep_logs=False)
    finally:
        if outcome is None or not outcome.keep_logs:
            shutil.rmtree(place)
    return outcome.status


def _place() -> Path:
    try:
        return Path(tempfile.mkdtemp(prefix='ros2-kafka-bridge-demo-'))
    except OSError as error:
        raise TransportError(
            f'there is no directory for temporary files ({error.strerror}): set TMPDIR to one'
        ) from error


def _plan(options: DemoOptions) -> SendPlan:
    rate = options.rate
    if rate is None:
        rate = COMPARED_RATE if options.compare else RATE
    problems = []
    embedded = options.bootstrap_servers is None
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
    servers = options.bootstrap_servers
    if servers is not None and (problem := servers_problem(servers)):
        problems.append(f'--bootstrap-servers: {problem}; leave it out for an embedded broker')
    if options.domain is not None and not 0 <= options.domain <= HIGHEST_DOMAIN:
        problems.append(f'--domain {options.domain}: expected 0 to {HIGHEST_DOMAIN}')
    if missing := missing_ros():  # the paper's nodes would end with a traceback
        problems.append(missing)
    if problems:
        raise ConfigError(problems)
    return SendPlan(rate, max(1, round(rate * options.seconds)))


# Before


@contextmanager
def _signals() -> Iterator[Stop]:
    """The first signal asks for an end, the second interrupts, more are ignored."""
    stop = Stop()

    def on_signal(number: int, _frame: Any) -> None:
        was_at_once = stop.at_once
        stop.on_signal(number)
        if stop.at_once and not was_at_once:
            raise KeyboardInterrupt

    before = {number: signal.signal(number, on_signal) for number in signals_to_handle()}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def _kafka(bootstrap_servers: str | None) -> Iterator[_Kafka]:
    if bootstrap_servers is None:
        with EmbeddedBroker() as broker:
            words = "embedded broker (librdkafka's mock cluster)"
            yield _Kafka(words, broker.bootstrap_servers, QUICK_FETCH, is_shared=False)
    else:
        Topics({'bootstrap.servers': bootstrap_servers}).greet()
        yield _Kafka(f'Kafka at {bootstrap_servers}', bootstrap_servers, {}, is_shared=True)


@contextmanager
def _topics(kafka: _Kafka, ends: Ends, stop: Stop, problems: list[str]) -> Iterator[None]:
    """Make the two topics; on a shared broker delete all that was made there, afterwards."""
    topics = Topics({'bootstrap.servers': kafka.bootstrap_servers})
    names = [ends.source, ends.sink]
    if not kafka.is_shared:
        topics.look_up(names)
        yield
        return
    try:
        topics.create(names)
        yield
    finally:
        patience_s = 0.0 if stop.at_once else _PATIENCE_S
        if problem := topics.delete([*names, *ends.dead_letters], ends.groups, patience_s):
            problems.append(problem)


# The orders


def _carry(
    options: DemoOptions, plan: SendPlan, kafka: _Kafka, stop: Stop, place: Path
) -> Sequence[Trip]:
    """Let the contestants carry the orders, in turn: none of them shares the processor."""
    environ = {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
    if options.domain is not None:
        environ['ROS_DOMAIN_ID'] = str(options.domain)
    title = f'{plan.total:,} orders, {plan.rate:,g} a second, {kafka.words}'
    trips: list[Trip] = []
    with view(title, is_terminal=sys.stdout.isatty()) as show:
        for contestant in (PAPER, BRIDGE) if options.compare else (BRIDGE,):
            if stop.asked:
                break
            ends = _ends(contestant, kafka, place)
            trip = Trip(contestant, ends, plan, stop, lambda: show([t.look() for t in trips]))
            trips.append(trip)
            with _topics(kafka, ends, stop, trip.problems):
                trip.run(environ)
    return trips


def _ends(contestant: Contestant, kafka: _Kafka, place: Path) -> Ends:
    name = f'demo-{uuid.uuid4().hex[:8]}-{contestant.name}'
    own_place = place / contestant.name
    own_place.mkdir()
    return Ends(name, kafka.bootstrap_servers, kafka.properties, own_place)


# Afterwards


class _Outcome(NamedTuple):
    status: int
    keep_logs: bool


def _sum_up(trips: Sequence[Trip], plan: SendPlan, place: Path) -> _Outcome:
    problems = [problem for trip in trips for problem in trip.problems]
    problems += [problem for trip in trips for problem in losses(trip.look())]
    sent = [trip for trip in trips if trip.started]
    if not sent and not problems:
        say('stopped before the first order')
    for problem in problems:
        say(problem, is_error=True)
    if problems:
        say(f'the logs are kept in {place}', is_error=True)
    for look in (trip.look() for trip in sent):
        if look.rate < _SLOW * plan.rate:
            say(f'note: only {look.rate:,.0f} orders a second could be sent to {look.title}')
    for trip in sent:
        say(summary(trip.look()))
    if problems:
        return _Outcome(1 if sent else 2, keep_logs=True)
    return _Outcome(0, keep_logs=False)


def losses(look: Look) -> Sequence[str]:
    """Say what was lost through the bridge, and what before the bridge could read it."""
    if look.name != BRIDGE.name:
        return []
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
