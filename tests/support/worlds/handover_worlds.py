"""What can happen to bridges that take turns at a route: nothing is lost but where it may be.

Time is simulated, and passes in steps; what takes a while takes as long as a seed says.
"""

import random
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Final, NamedTuple

import pytest
from support.worlds.handover_bridges import Bridge, Group
from support.worlds.handover_ros import (
    HEARTBEAT_S,
    KNOWN_S,
    LATE_HEARTBEAT_S,
    NEVER,
    Link,
    Reader,
    Sent,
    Voice,
)

from ros2_kafka_bridge.endpoints import Message

TICK_S: Final = 0.05
RESTART_S: Final = 7.0
QUIET_S: Final = 45.0
"""At the end of a world, for all that is under way."""


class Event(NamedTuple):
    """Something that happens.

    Args:
        what: It is.
        whom: To the holder of the lock, to one that hands over, or to another.
        how: Long or late, from 0 to 10.
        after_s: The event before it.
    """

    what: str
    whom: str = 'holder'
    how: int = 0
    after_s: float = 1.0


class World:
    """What is there, and its time.

    Args:
        voices: The publishers.
        events: What happens.
        seed: For how long what takes a while takes.
        slots: How many bridges there may be at a time.
    """

    def __init__(
        self, voices: Sequence[Voice], events: Sequence[Event], seed: int, slots: int
    ) -> None:
        self.draw = random.Random(seed)  # noqa: S311 -- repeatable
        self.now_s = 1000.0
        self.group = Group(self)
        self.readers: list[Reader] = []
        self.kills: list[tuple[float, Bridge]] = []
        self.limit = self.draw.choice([5, 20, 50])
        self._room = 10 + round(sum(2.2 / (TICK_S * voice.every) for voice in voices))
        self._voices = voices
        self._sent: list[Sent] = []
        self._ticks = 0
        self._until_s = NEVER
        at_s, self._due = self.now_s, deque[tuple[float, Event]]()
        for event in events:
            at_s += event.after_s
            self._due.append((at_s, event))
        self._ends_at_s = at_s + QUIET_S
        self._lives = 0
        self._bridges = [self._new_bridge() for _ in range(slots)]

    def _new_bridge(self) -> Bridge:
        self._lives += 1
        return Bridge(self, self._lives.to_bytes(2, 'big'))

    # Time

    def upto(self, most_s: float) -> float:
        """How long something takes."""
        return self.draw.choice([0.0, most_s, self.draw.random() * most_s])

    def pass_time(self, duration_s: float) -> None:
        before_s = self._until_s
        self._until_s = min(before_s, self.now_s + duration_s)
        while self.now_s < self._until_s:
            self._tick()
        self._until_s = before_s

    def run(self) -> None:
        while self.now_s < self._ends_at_s:
            self._tick()

    def _tick(self) -> None:
        self._ticks += 1
        self.now_s = 1000 + self._ticks * TICK_S
        while self._due and self._due[0][0] <= self.now_s:
            self._happens(self._due.popleft()[1])
        if self.now_s < self._ends_at_s - LATE_HEARTBEAT_S - HEARTBEAT_S:
            for number, voice in enumerate(self._voices):
                self._publish(number, voice)
        open_readers = [it for it in self.readers if it.closed_at_s > self.now_s]
        for reader in open_readers:
            reader.flow(self.now_s)
        self.group.tick()
        self._start_anew()
        for bridge in list(self._bridges):
            if bridge.lives and not bridge.stop.asked and self.now_s >= bridge.stops_at_s:
                bridge.is_stopped()
            first, then = bridge.take, bridge.look
            if self._lives % 2:
                first, then = then, first
            first()
            then()

    def _happens(self, event: Event) -> None:
        living = [it for it in self._bridges if it.lives]
        holder = [it for it in living if it is self.group.holder]
        leaving = [it for it in living if it.term is not None and it not in holder]
        others = [it for it in living if it.term is None and it not in holder]
        ranked = {
            'holder': holder + leaving,
            'leaving': leaving + holder,
            'other': others + leaving,
        }[event.whom]
        if ranked:
            self._befalls(ranked[0], event.what, event.how)

    def _start_anew(self) -> None:
        """Let another process come for each that is gone, as a supervisor does."""
        for slot, bridge in enumerate(self._bridges):
            if not bridge.lives and self.now_s >= bridge.ended_at_s + RESTART_S:
                self._bridges[slot] = self._new_bridge()

    def _befalls(self, bridge: Bridge, what: str, how: int) -> None:
        match what:
            case 'stop' if not bridge.stop.asked:
                bridge.is_stopped()
            case 'stop again' if bridge.stop.asked:
                bridge.is_stopped()
            case 'stop early':
                bridge.stops_after_s = how / 5
            case 'kill':
                bridge.is_killed()
            case 'stand still':
                bridge.stands_still(0.5 + how)
            case _:
                self._hinders(bridge, what, how)

    def _hinders(self, bridge: Bridge, what: str, how: int) -> None:
        match what:
            case 'hold up':
                bridge.held_up_s = (self.now_s, self.now_s + 0.5 + how / 2)
            case 'fail':
                bridge.fails_until_s = self.now_s + 0.5 + how
            case 'tell nothing':
                bridge.is_told_nothing = how > 2
            case 'move' if bridge is self.group.holder:
                others = [it for it in self.group.members if it is not bridge]
                if able := [it for it in others if it.lives and not it.is_still]:
                    bridge.seat.late_s = how * 0.9
                    self.group.give(self.draw.choice(able))

    # ROS

    def _publish(self, number: int, voice: Voice) -> None:
        begin_s, end_s = voice.silent_s
        if (self._ticks + number) % voice.every or begin_s <= self.now_s - 1000 < end_s:
            return
        stamp = round((self.now_s + voice.ahead_s) * 1e9)
        sent = Sent(Message(b'', bytes([number]), self._ticks, stamp), self.now_s)
        self._sent.append(sent)
        for reader in self.readers:
            if not reader.is_known_at(number, self.now_s):
                continue
            sent.readers.append(reader)
            link = reader.links[number]
            if not link.waiting and len(reader.cache) < reader.room:
                reader.cache.append(sent)
                continue
            if not link.waiting:
                link.again_at_s = max(link.again_at_s, self.now_s + self.upto(HEARTBEAT_S))
            link.waiting.append(sent)

    def shown(self) -> list[Reader]:
        """What the graph shows."""
        return [it for it in self.readers if it.shown_at_s <= self.now_s < it.gone_at_s]

    def open_reader(self, bridge: Bridge, gid: bytes) -> Reader:
        links = [Link(self.now_s + self.upto(KNOWN_S)) for _ in self._voices]
        reader = Reader(bridge, gid, links, self._room)
        is_hidden = self.draw.random() < 0.15
        reader.shown_at_s = NEVER if is_hidden else self.now_s + self.upto(3.0)
        self.readers.append(reader)
        return reader

    # What must be true

    def check(self) -> None:
        """Nothing is lost, but where it is known why."""
        for sent in self._sent:
            if sent.is_taken or any(it.closed_at_s == NEVER for it in sent.readers):
                continue
            number, at_s = sent.message.gid[0], sent.at_s
            responsible = sent.readers or self._last_known(number, at_s)
            stamp_s = sent.message.source_time_ns / 1e9
            if any(it.late_excuse or stamp_s >= it.newer_s for it in sent.readers):
                continue
            if responsible and not any(self._excuse(it, it.closed_at_s) for it in responsible):
                pytest.fail(self._words(sent, responsible))

    def _last_known(self, number: int, at_s: float) -> list[Reader]:
        """Who was the last that a publisher knew."""
        gone = [it for it in self.readers if it.links[number].known_at_s < it.closed_at_s <= at_s]
        return sorted(gone, key=lambda it: it.closed_at_s)[-1:]

    def _excuse(self, reader: Reader, by_s: float) -> str:
        """Why what it is responsible for may be lost.

        Args:
            reader: It, or one that came after it.
            by_s: When the responsible one closed: it may have outlived those after it.
        """
        if reader.excuse:
            return reader.excuse
        had_s, until_s = self._had_lock_at(reader), reader.waits_until_s
        if any(had_s < at_s <= until_s for at_s, _ in self.kills):
            return 'the one that was to go on was killed'
        after = {it for at_s, it in self.group.given if had_s < at_s <= until_s}
        others = [it for it in self.readers if it.bridge in after and it.opened_at_s <= until_s]
        for other in others:
            is_before = other.closed_at_s <= by_s and self._had_lock_at(other) > had_s
            if is_before and (why := self._excuse(other, by_s)):
                return f'of the next one: {why}'
        came = any(it.closed_at_s > until_s for it in others)
        return '' if came else 'nobody came in time'

    def _had_lock_at(self, reader: Reader) -> float:
        """When its bridge was given the lock last."""
        given = [(at_s, it) for at_s, it in self.group.given if at_s <= reader.closed_at_s]
        return max(at_s for at_s, it in given if it is reader.bridge)

    def _words(self, sent: Sent, responsible: Sequence[Reader]) -> str:
        def told(reader: Reader) -> str:
            known_s = reader.links[sent.message.gid[0]].known_at_s
            return (
                f'{reader.gid.hex()}: open {reader.opened_at_s:.2f} known {known_s:.2f} '
                f'shown {reader.shown_at_s:.2f} closed {reader.closed_at_s:.2f} '
                f'waits until {reader.waits_until_s:.2f} {reader.excuse}'
            )

        given = [f'{at_s:.2f} {it.own.hex()}' for at_s, it in self.group.given]
        return (
            f'lost: publisher {sent.message.gid[0]} at {sent.at_s:.2f}, sent to '
            f'{[it.gid.hex() for it in sent.readers]}; responsible: '
            f'{[told(it) for it in responsible]}; all: {[told(it) for it in self.readers]}; '
            f'given {given}'
        )


class Clock:
    """What the term takes for the module `time`."""

    def __init__(self, world: World) -> None:
        self._world = world

    def monotonic(self) -> float:
        return self._world.now_s

    def time_ns(self) -> int:
        return round(self._world.now_s * 1e9)


@contextmanager
def a_world(
    voices: Sequence[Voice], events: Sequence[Event], seed: int, slots: int
) -> Iterator[World]:
    """Make a world in which time passes only as it says."""
    world = World(voices, events, seed, slots)
    with pytest.MonkeyPatch.context() as patch:
        for module in ('term', 'handover_window'):
            patch.setattr(f'ros2_kafka_bridge.exclusive.{module}.time', Clock(world))
        yield world
