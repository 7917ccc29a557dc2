"""What can happen to a route from Kafka, its member of a group, and their Kafka."""

import logging
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from threading import Thread
from typing import NamedTuple

import pytest
from confluent_kafka import KafkaError
from support.kafka.source_stubs import NEW, ToldIds
from support.worlds.clocks import let_waits_pass
from support.worlds.group_routes import Route
from support.worlds.kafka import Gap, Kafka, Log, Stored, Told
from support.worlds.kafka_client import MemoryClient

from ros2_kafka_bridge.errors import BridgeError
from ros2_kafka_bridge.kafka.consumer import KafkaSource

LOG = logging.LoggerAdapter(logging.getLogger('group'), {})
CLIENT = 'ros2_kafka_bridge.kafka.group_client.Consumer'
FAILURES = {
    'fenced': 'Static consumer fenced by other consumer with same group.instance.id',
    'fatal': 'Broker: Unknown member',
}
STUCK = 'the Kafka client does not read'
REFUSED = (KafkaError.COORDINATOR_NOT_AVAILABLE, KafkaError.REQUEST_TIMED_OUT)
MOST_PARTITIONS = 4
OF_THE_BRIDGE = frozenset({'poll', 'stay', 'end', 'commit', 'time', 'fails', 'stops', 'is killed'})


class Event(NamedTuple):
    """Something that happens.

    Args:
        what: It is.
        where: In which partition, where it is in one.
        how: Much, mostly.
        when: After so many times that a client has worked; 0: at once.
    """

    what: str
    where: int = 0
    how: int = 0
    when: int = 0


class World:
    """Runs of a bridge one after the other, and what has become of each record.

    Args:
        partitions: How many the topic has.
        start: Where the group begins.
    """

    def __init__(self, partitions: int, start: str) -> None:
        self._ended: set[tuple[int, int]] = set()  # also by another member
        self._owed: Mapping[int, int] = {}  # to the group, at a hand-over
        self._wrong: list[str] = []  # what is raised inside of a client may be passed over
        self.kafka = Kafka(partitions, self._committed)
        self.kafka.on_assigned = self._assigned
        self.kafka.on_handed_over = self._handed_over
        self._start = start
        self._lost = 0  # as earlier sources and other members have counted
        self._gaps: list[Gap] = []  # of this source

    def begin(self) -> None:
        """Begin the life of another source."""
        self.source = KafkaSource({'group.id': 'g'}, 't', self._start, ToldIds(NEW), LOG)
        self._gaps.clear()
        self.kafka.gaps.clear()
        self._open()

    def _open(self) -> None:
        self.route = Route(self, self.source)
        self.source.open(self.route)

    @property
    def client(self) -> MemoryClient:
        client = self.kafka.newest
        assert isinstance(client, MemoryClient)
        return client

    # What must be true

    def ended(self, number: int, offset: int) -> None:
        self._ended.add((number, offset))

    def handed_out(self, record: Told, kept: int) -> None:
        number, offset = record.partition(), record.at
        if offset < kept:
            self._wrong.append(f'{number}:{offset} comes again, all before {kept} have ended')
        if record.reading.is_gone:
            self._wrong.append(f'{number}:{offset} was handed out though it was taken away')
        has = self.kafka.group.offsets.get(number, Stored(0, '')).offset
        if offset < has and number in self.kafka.group.held:
            self._wrong.append(f'{number}:{offset} was handed out, the group has {has}')

    def _committed(self, number: int, offset: int) -> None:
        """The group is about to be told of an offset by the bridge."""
        log, group = self.kafka.logs[number], self.kafka.group
        if not group.offsets:  # its first start
            end = offset if self._start == 'latest' else min(offset, log.low)
            log.passed |= {it for it in log.shown if it < end}
        unread = (log.gone | log.passed) - self.route.open(number)
        owed = {it for it in log.shown - unread if it < offset}
        if left := {it for it in owed if (number, it) not in self._ended}:
            self._wrong.append(f'{number}: the group is told {offset}, not ended: {sorted(left)}')
        if number in group.offsets and offset < group.offsets[number].offset:
            self._wrong.append(f'{number}: told {offset} behind {group.offsets[number].offset}')

    def _assigned(self, numbers: frozenset[int]) -> None:
        for number in numbers - self.kafka.group.offsets.keys():
            self.route.kept.pop(number, None)  # nothing tells whether another has read it
        if left := [number for number in numbers if self.route.open(number)]:
            self._wrong.append(f'{left} are given anew, and were not taken from the route before')

    def hands_over(self, owed: Mapping[int, int]) -> None:
        self._owed, self.kafka.group.has_refused = owed, False

    def _handed_over(self, numbers: frozenset[int]) -> None:
        if not self.kafka.group.has_refused:
            owed = {n: at for n, at in self._owed.items() if n in numbers}
            self.is_told(owed, 'at a hand-over')

    def is_told(self, owed: Mapping[int, int], when: str) -> None:
        offsets = self.kafka.group.offsets
        for number, at in owed.items():
            if number not in offsets or offsets[number].offset < at:
                self._wrong.append(f'{number}: {when} the group has not got {at}: {offsets}')

    def look(self) -> None:
        """Look at all that must be true at any time."""
        lag, come = self.source.lag(), self.route.come()
        most = sum(self.kafka.logs[n].high - come.get(n, 0) for n in self.client.readings)
        assert lag is None or 0 <= lag <= most
        if not self.kafka.gaps:
            least, most = self._missing(lambda gap: gap.low), self._missing(lambda g: g.reached)
            assert least <= self.source.lost_upstream <= most, self._gaps
        assert not self._wrong, self._wrong

    def _missing(self, until: Callable[[Gap], int]) -> int:
        return len(
            {(gap.number, at) for gap in self._gaps for at in range(gap.wanted, until(gap))}
        )

    # What happens

    def happens(self, event: Event) -> None:
        what, where, how, when = event
        if what in OF_THE_BRIDGE:
            self._does(what, where, how)
        elif when:
            self.kafka.later.append((when, partial(self._befalls, what, where, how)))
        else:
            self._befalls(what, where, how)
        self.look()

    def _befalls(self, what: str, where: int, how: int) -> None:
        """What happens around the bridge."""
        number = where % len(self.kafka.logs)
        match what:
            case 'partition':
                if len(self.kafka.logs) < MOST_PARTITIONS:
                    self.kafka.grow()
            case 'share':
                self.route.finishes = where
                shared = [it for it in self.kafka.numbers if how >> it & 1]
                self.kafka.group.share = frozenset(shared)
            case 'another':
                self._another_reads(number, how)
            case 'retention':
                self._delete(number, how)
            case 'away':
                self.kafka.is_away = True
                self.client.goes_away()
            case 'back':
                self.kafka.is_away = False
            case _:
                self._befalls_log(what, self.kafka.logs[number], how)

    def _befalls_log(self, what: str, log: Log, how: int) -> None:
        match what:
            case 'records':
                log.append(how)
            case 'marks':
                log.mark(how)
            case 'transaction':
                log.begin(how)
            case 'its end':
                log.end(aborted=how % 2 == 0)
            case 'compaction':
                log.compact(how)
            case _:
                self._befalls_member(what, how)

    def _befalls_member(self, what: str, how: int) -> None:
        group = self.kafka.group
        match what:
            case 'refusals':
                group.refusals += [REFUSED[how % 2]] * (1 + how % 3)
            case 'no metadata':
                group.takes_metadata = False
            case 'unsaid':
                group.unsaid += 1
            case 'late answers' | 'answers':
                group.holds_answers = what == 'late answers'
            case 'session ends':
                self.client.is_given_up()
            case 'no brokers':
                self.client.forget_brokers()
            case _:
                self.client.fail(FAILURES[what])

    def _does(self, what: str, where: int, how: int) -> None:
        """What the bridge does."""
        match what:
            case 'poll':
                self._poll(1 + where, how, commits=where % 2 == 1)
            case 'stay':
                self._stay(how)
            case 'end':
                self.route.end(1 + how % 5, where)
            case 'commit':
                self._commit()
            case 'time':
                self.kafka.clock.sleep(how)
            case 'fails':
                self._runs_again()
            case 'stops':
                self.route.close()
                self._next_life()
            case _:
                assert what == 'is killed'
                self.client.is_killed(late=how % 2 == 0)
                self._next_life()

    def _run(self, step: Callable[[], int]) -> int:
        """Let the route do something; where it fails, it is run again."""
        try:
            found = step()
        except BridgeError as error:
            if STUCK in str(error):
                self._wrong.append(str(error))
            self._runs_again()
            return 0
        self._gaps += self.kafka.gaps
        self.kafka.gaps.clear()
        return found

    def _poll(self, times: int, limit: int, *, commits: bool) -> None:
        for _ in range(times):
            self._run(partial(self.route.poll, limit))
            if commits:  # as a route does every 0.2 s
                self._commit()

    def _stay(self, times: int) -> None:
        """Stay for a while: once all that it has was paused, nothing comes."""
        client, paused = self.client, -1
        for _ in range(times):
            before = client.assignments
            found = self._run(self.route.stay)
            assert not (found and paused == client.assignments), 'it reads on'
            client, paused = self.client, before if client is self.client else -1

    def _commit(self) -> None:
        """Commit in passing: one at a time, and none while Kafka is away."""
        client, is_away = self.client, self.source.away
        before = client.waits
        self.source.commit()
        assert client.waits == before or not (before or is_away)

    def _runs_again(self) -> None:
        self.route.close()
        self.kafka.gaps.clear()  # what was not told to the route is met again
        self._open()

    def _next_life(self) -> None:
        self._lost += self.source.lost_upstream
        self.begin()

    def _delete(self, number: int, count: int) -> None:
        log = self.kafka.logs[number]
        log.delete(count)
        if number not in self.kafka.group.offsets:  # the group begins behind that
            log.passed |= {it for it in log.shown if it < log.low}

    def _another_reads(self, number: int, count: int) -> None:
        """Another member reads on where nobody else does, and has it committed."""
        log, group = self.kafka.logs[number], self.kafka.group
        if number in group.held or number not in group.offsets:
            return
        begin, metadata = group.offsets[number]
        ahead = [it for it in log.records if max(begin, log.low) <= it < log.stable][:count]
        self._ended |= {(number, it) for it in ahead}
        if ahead:
            self._lost += max(0, log.low - begin)
            group.offsets[number] = Stored(ahead[-1] + 1, metadata)

    # The end

    def ends(self) -> None:
        """All is well again; it becomes quiet, and all has come."""
        kafka, group = self.kafka, self.kafka.group
        kafka.later.clear()
        kafka.is_away = group.holds_answers = False
        group.refusals.clear()
        group.unsaid, group.share = 0, kafka.numbers
        for log in kafka.logs:
            log.end(aborted=False)
        for _ in range(150):
            found = self._run(partial(self.route.poll, 50))
            self.route.end_all()
            self.source.commit()
            self.kafka.clock.sleep(1.0)
            self.look()
            if not found and self._is_quiet():
                break
        else:
            pytest.fail(f'it is never quiet: {group.offsets}, {kafka.logs}, {self.source.lag()}')
        self._look_at_all()
        assert self.route.close(), 'all was committed, and is said not to be'
        assert not self._wrong, self._wrong
        assert self._has_all()

    def _is_quiet(self) -> bool:
        return self.route.is_empty and self._has_all() and self.source.lag() == 0

    def _has_all(self) -> bool:
        offsets = {number: stored.offset for number, stored in self.kafka.group.offsets.items()}
        return offsets == {number: log.high for number, log in enumerate(self.kafka.logs)}

    def _look_at_all(self) -> None:
        never = 0
        for number, log in enumerate(self.kafka.logs):
            left = {it for it in log.shown - log.passed if (number, it) not in self._ended}
            assert left <= log.gone, f'{number}: {left - log.gone} never ended'
            never += len(left & log.deleted)
        told = self._lost + self.source.lost_upstream
        assert never <= told, 'what is lost is counted'


@contextmanager
def a_world(partitions: int, start: str) -> Iterator[World]:
    """A world whose time passes only where somebody waits."""
    with pytest.MonkeyPatch.context() as patch:
        world = World(partitions, start)
        clock = world.kafka.clock
        patch.setattr(CLIENT, lambda properties, **_: MemoryClient(world.kafka, properties))
        patch.setattr('ros2_kafka_bridge.threads.unattended.start', _awaited)
        patch.setattr('time.monotonic', clock.monotonic)
        patch.setattr('time.sleep', clock.sleep)
        let_waits_pass(patch, clock.sleep)
        world.begin()
        yield world


def _awaited(name: str, target: Callable[[], object]) -> Thread:
    """A thread that has ended: what is done in it is done at a moment that is known."""
    thread = Thread(target=target, name=name)
    thread.start()
    thread.join()
    return thread
