"""Bridges that take turns at a route, and the lock by which they do."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final, cast

from support.worlds.handover_ros import (
    BRIDGE,
    KNOWN_S,
    LATE_HEARTBEAT_S,
    LEASE_S,
    NEVER,
    Graph,
    Reader,
    Sent,
)

from ros2_kafka_bridge.exclusive.term import Term
from ros2_kafka_bridge.ros.successor import SuccessorWatch
from ros2_kafka_bridge.threads.stop import Stop

if TYPE_CHECKING:
    from support.worlds.handover_worlds import World

    from ros2_kafka_bridge.kafka.lock import GroupLock
    from ros2_kafka_bridge.ros.node import RosNode

SESSION_S: Final = 6.0
"""Kafka gives the place of a member away that is silent for so long."""

LEAVING_S: Final = 5.2
"""And one that was left, after so long at most."""

# What a term promises: how long a successor is waited for, and is taken on for after that.
COMING_S: Final = 10.0
MOST_S: Final = 30.0
MOST_AT_END_S: Final = 10.0
HANDOVER_S: Final = 27.5
SLACK_S: Final = 1.0


class Group:
    """The members of a group, one of which has the lock."""

    def __init__(self, world: 'World') -> None:
        self.members: list[Bridge] = []
        self.holder: Bridge | None = None
        self.given: list[tuple[float, Bridge]] = []
        self.changed_at_s = self._gives_at_s = 0.0
        self._world = world

    def tick(self) -> None:
        now_s = self._world.now_s
        for bridge in [it for it in self.members if now_s - it.silent_since_s > SESSION_S]:
            self.remove(bridge, within_s=1.0)
        able = [it for it in self.members if it.lives and not it.is_still]
        if self.holder is None and able and now_s >= self._gives_at_s:
            self.give(self._world.draw.choice(able))

    def give(self, bridge: 'Bridge') -> None:
        self.holder = bridge
        self.changed_at_s = self._world.now_s
        self.given.append((self.changed_at_s, bridge))

    def after(self, bridge: 'Bridge') -> set['Bridge']:
        """Who was given it after this one had it last."""
        last = max((n for n, (_, it) in enumerate(self.given) if it is bridge), default=-1)
        return {it for _, it in self.given[last + 1 :]}

    def remove(self, bridge: 'Bridge', within_s: float) -> None:
        if bridge in self.members:
            self.members.remove(bridge)
        if self.holder is bridge:
            self.holder = None
            self._gives_at_s = self._world.now_s + self._world.upto(within_s)


class Seat:
    """The lock, as one bridge has it: it may learn late that it has lost it."""

    def __init__(self, bridge: 'Bridge', group: Group) -> None:
        self.held = self.is_left = False
        self.late_s = 0.0
        self._bridge = bridge
        self._group = group
        self._world = bridge.world
        self._joins_at_s = self._world.now_s

    def poll(self, timeout_s: float) -> None:
        assert timeout_s == 0.0
        assert not self.is_left, 'it polls a lock that it has left'
        group, now_s = self._group, self._world.now_s
        if self._bridge not in group.members:
            if self._joins_at_s < self._bridge.silent_until_s:  # it is told that it was put out
                self._joins_at_s = now_s + self._world.upto(1.0)
            if now_s < self._joins_at_s:
                return
            group.members.append(self._bridge)
        if group.holder is self._bridge:
            self.held = True
        elif group.holder is not None and now_s >= group.changed_at_s + self.late_s:
            self.held = False
            self.late_s = 0.0

    def has_standby(self) -> bool:
        self._bridge.asks_for(self._world.upto(5.0))
        told = len(self._group.members) > 1 and not self._bridge.is_told_nothing
        if not told:
            self._bridge.may_lose('it is told of no bridge that stands by')
        return told

    def close(self) -> None:
        self.is_left, self.held = True, False
        self._group.remove(self._bridge, LEAVING_S)
        self._bridge.asks_for(self._world.upto(2.0))


class Bridge:
    """A process: a thread looks after the lock, another takes.

    Args:
        world: That it lives in.
        own: What its gids begin with.
    """

    def __init__(self, world: 'World', own: bytes) -> None:
        self.world = world
        self.own = own
        self.stop = Stop()
        self.lives = True
        self.reader: Reader | None = None
        self.term: Term | None = None
        self.seat = Seat(self, world.group)
        self.is_told_nothing = False
        self.still_until_s = self.fails_until_s = self.silent_until_s = 0.0
        self.held_up_s = (0.0, 0.0)  # from when until when
        self.held_at_s = world.now_s  # it had the lock, as it knew, or began to hand over
        self.asked_at_s = NEVER
        self.stops_at_s = self.ended_at_s = NEVER
        self.stops_after_s = NEVER  # it has got the lock
        self._still_since_s = 0.0
        self._busy = False
        self._drains = False
        self._opens_at_s = 0.0
        self._steps = world.draw.randrange(2)
        self._readers = 0

    # How it is

    @property
    def is_still(self) -> bool:
        return self.world.now_s < self.still_until_s

    @property
    def silent_since_s(self) -> float:
        """Since when Kafka hears nothing of it."""
        if self.lives and not self.is_still:
            return self.world.now_s
        return self._still_since_s

    @property
    def takes(self) -> bool:
        runs = self.lives and not self.is_still and not self.fails
        return runs and not self.held_up_s[0] <= self.world.now_s < self.held_up_s[1]

    @property
    def fails(self) -> bool:
        """Whether its route has failed, and is to be tried again."""
        return self.world.now_s < self.fails_until_s

    def asks_for(self, duration_s: float) -> None:
        """Let time pass in which this thread waits for Kafka."""
        self._busy = True
        self.world.pass_time(duration_s)
        self._busy = False

    def may_lose(self, excuse: str) -> None:
        if self.reader is not None and not self.reader.excuse:
            self.reader.excuse = excuse

    # What happens to it

    def is_stopped(self) -> None:
        self.stop.ask()
        self.asked_at_s = min(self.asked_at_s, self.world.now_s)
        if self.stop.at_once:
            self.may_lose('it was stopped twice')

    def is_killed(self) -> None:
        self.lives, self.ended_at_s = False, self.world.now_s
        self._still_since_s = self.world.now_s
        self.world.kills.append((self.world.now_s, self))
        if self.reader is not None:
            self.may_lose('it was killed')
            self._close(LEASE_S)

    def stands_still(self, duration_s: float) -> None:
        if self.is_still or self._busy:
            return
        now_s = self.world.now_s
        self._still_since_s, self.still_until_s = now_s, now_s + duration_s
        self.silent_until_s = self.still_until_s if duration_s > SESSION_S else 0.0
        if self.reader is not None:
            for link in self.reader.links:
                link.again_at_s = self.still_until_s + self.world.upto(LATE_HEARTBEAT_S)

    # What it does

    def take(self) -> None:
        """Go on with the thread that takes."""
        now_s = self.world.now_s
        if self.term is None or not self.takes:
            return
        if self.reader is None:
            if now_s >= self._opens_at_s and not self._drains:
                self._readers += 1
                self.reader = self.world.open_reader(self, self.own + bytes([self._readers]))
            if self._drains:
                self._ends_term()
            return
        if self._drains and not self.stop.at_once:
            while self._take(self.reader):
                pass
        if self._drains:
            self._close(1.0)
            self._ends_term()
        else:
            messages = [sent.message for sent in self._take(self.reader)]
            self.term.note_taken(messages)

    def _take(self, reader: Reader) -> Sequence[Sent]:
        size = min(len(reader.cache), self.world.limit)
        taken = [reader.cache.popleft() for _ in range(size)]
        for sent in taken:
            sent.is_taken = True
        reader.flow(self.world.now_s)
        return taken

    def _close(self, shown_s: float) -> None:
        reader, self.reader = self.reader, None
        assert reader is not None
        reader.closed_at_s = self.world.now_s
        reader.gone_at_s = reader.closed_at_s + self.world.upto(shown_s)

    def _ends_term(self) -> None:
        term, self.term = self.term, None
        assert term is not None
        self._drains = False
        if self.stop.asked:
            self._leaves()
        else:
            term.listen()

    def _leaves(self) -> None:
        if not self.seat.is_left:
            self.seat.close()
        if self.lives:
            self.lives, self.ended_at_s = False, self.world.now_s

    def look(self) -> None:
        """Go on with the thread of the lock, each 0.1 s."""
        self._steps += 1
        if not self.lives or self.is_still or self._busy or self._drains or self._steps % 2:
            return
        if self.term is not None:
            self._step(self.term)
        elif self.stop.asked:
            self._leaves()
        else:
            self.seat.poll(0.0)
            if self.seat.held:
                node = cast('RosNode', Graph(self))
                watch = SuccessorWatch(node, '/t', BRIDGE, self.own)
                self.watch = Watched(watch, self)
                self.term = Term(
                    self.stop, cast('GroupLock', self.seat), cast('SuccessorWatch', self.watch)
                )
                self._opens_at_s = self.world.now_s + self.world.upto(1.0)
                self.stops_at_s = self.world.now_s + self.stops_after_s

    def _step(self, term: Term) -> None:
        at_once = self.stop.at_once
        self._drains = term.step(takes=not self.fails)
        assert self._drains or not at_once, 'it goes on after a second stop'
        if self._drains:
            assert self.stop.asked or not self.seat.held, 'it leaves what it holds'
            self.watch.ends()
        else:
            assert not (term.is_lost and self.seat.held), 'a lock that came back lets it go on'
            self.watch.lasts()


class Watched:
    """What a term is told of its successor, with the times that tell how long it may last.

    Args:
        watch: The real one.
        bridge: Whose term it is.
    """

    def __init__(self, watch: SuccessorWatch, bridge: Bridge) -> None:
        self._watch = watch
        self._bridge = bridge
        self._forget()

    def _forget(self) -> None:
        self._waits_since_s = self._came_at_s = NEVER
        self._is_mistaken = False

    def note_readers(self, *, may_read: bool) -> None:
        self._forget()
        # Also where a lock that has come back is left again.
        self._bridge.held_at_s = self._bridge.world.now_s
        self._watch.note_readers(may_read=may_read)

    def is_needed(self) -> bool:
        return self._watch.is_needed()

    def has_come(self) -> bool:
        has_come, world = self._watch.has_come(), self._bridge.world
        if has_come and self._came_at_s == NEVER:
            self._came_at_s = world.now_s
            after = world.group.after(self._bridge)
            others = [it for it in world.shown() if it.bridge is not self._bridge]
            self._is_mistaken = bool(others) and not any(it.bridge in after for it in others)
        return has_come

    def lasts(self) -> None:
        """The term goes on."""
        bridge, now_s = self._bridge, self._bridge.world.now_s
        if bridge.seat.held:
            self._forget()
            bridge.held_at_s = now_s
            return
        self._waits_since_s = min(self._waits_since_s, now_s)
        since_s = max(bridge.held_at_s, bridge.still_until_s)
        assert now_s - since_s < COMING_S + MOST_S + SLACK_S, 'it does not end'
        since_s = max(since_s, min(bridge.asked_at_s, now_s))
        if bridge.stop.asked:
            assert now_s - since_s < HANDOVER_S + SLACK_S, 'its end takes too long'

    def ends(self) -> None:
        """The term is over."""
        bridge, reader, now_s = self._bridge, self._bridge.reader, self._bridge.world.now_s
        if reader is None:
            return
        if bridge.stop.at_once:
            bridge.may_lose('it was stopped twice')
        most_s = MOST_AT_END_S if bridge.stop.asked else MOST_S
        until_s = min(self._waits_since_s, now_s) + COMING_S
        begin_s = min(self._came_at_s, until_s)
        reader.newer_s = begin_s + KNOWN_S
        if now_s - begin_s > most_s - 0.2:
            reader.late_excuse = 'it took on for as long as it may'
        if bridge.stop.asked and now_s < bridge.still_until_s + LATE_HEARTBEAT_S:
            reader.late_excuse = 'it was stopped when it had just stood still'
        if bridge.fails_until_s > begin_s:
            reader.late_excuse = 'its route has failed meanwhile'
        if self._is_mistaken:
            bridge.may_lose('it has taken another reader for that of the next one')
        reader.waits_until_s = until_s
