"""What can happen to a source of ROS messages, its publishers, its graph and its Kafka."""

import logging
import math
import select
from collections import Counter, defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from types import SimpleNamespace
from typing import Literal, NamedTuple

import pytest
from support.ros.ends import end_of, source_of, still_node
from support.worlds.network import Network, Poll, Publisher, RCLError, Reader, Sample, is_match

from ros2_kafka_bridge.config.settings import QoS
from ros2_kafka_bridge.endpoints import Message, Offer
from ros2_kafka_bridge.errors import BridgeError, RouteError, TransportError
from ros2_kafka_bridge.message_types.layout import Layout
from ros2_kafka_bridge.ros import arrivals, rcl
from ros2_kafka_bridge.ros.types import MessageType

LOG = logging.LoggerAdapter(logging.getLogger('reader'), {})
NAME = 'p/msg/T'
HASH = 'RIHS01_' + '77' * 32
MOST_PUBLISHERS = 6
POSTPONED_S = 10.5
AWAY, REFUSES = TransportError('Kafka is away'), RouteError('the topic may not be read')
KAFKA = {'away': AWAY, 'refuses': REFUSES, 'back': None}
OFFERS = [
    Offer(reliability, durability)
    for reliability in ('reliable', 'best_effort')
    for durability in ('volatile', 'transient_local')
]
PASSES_S = (0.01, 0.05, 0.05, 0.11, 0.11, 0.11, 0.11, 0.5, 1.01, 3.0, 10.1, 12.0)
OF_THE_SOURCE = frozenset({'take', 'wait', 'look', 'hash', 'take fails'})
OF_A_PUBLISHER = frozenset({'publish', 'leaves', 'shown', 'far', 'near'})


TYPE = MessageType(NAME, type('Data', (), {'__doc__': NAME}), Layout(NAME, ()), HASH)


class Event(NamedTuple):
    """Something that happens.

    Args:
        what: It is.
        where: To which publisher or subscription, where it is to one.
        how: Much, mostly.
    """

    what: str
    where: int = 0
    how: int = 1


class World:
    """One source over a network, and what has become of each message.

    Args:
        network: All of it.
        qos: What the route fixes.
    """

    def __init__(self, network: Network, qos: QoS) -> None:
        self.network, has_gid = network, network.has_gid
        network.on_taken, network.on_told = self._taken, self._told
        network.on_created, network.on_destroyed = self._created, self._destroyed
        self.end = end_of(still_node(network, network), TYPE)._replace(qos=qos, log=LOG)
        self.source = source_of(self.end, has_gid=has_gid, on_offer=self._asked)
        [self.reader] = self.source._readers.values()
        self._qos = qos
        self._has_gid = has_gid
        self._is_open = self._closes = False
        self._asks: Literal['source', 'hash', 'graph'] = 'source'
        self._kafka: BridgeError | None = None  # what it says, where it does not answer
        self._may_open: Offer | None = None
        self._answered: dict[Offer, float] = {}  # whether Kafka has, or until when it is not asked
        self._read: list[Publisher] = []  # what the graph has told, as the source has it
        self._ever_read: set[Publisher] = set()
        self._known: set[Publisher] = set()  # the same, but where a hash alone was asked for
        self._handed: dict[Publisher, list[int]] = defaultdict(list)
        self._owed: dict[Publisher, set[int]] = defaultdict(set)
        self._top: Counter[Publisher] = Counter()  # as its own subscription gave
        self._blind: Counter[Publisher] = Counter()  # up to there, while nobody knew its offer
        self._untold: Counter[bytes] = Counter()  # taken less handed over, without gid

    # What must be true

    def _own(self, publisher: Publisher) -> Offer:
        """What is asked of a publisher."""
        offer, qos = publisher.offer, self._qos
        return Offer(qos.reliability or offer.reliability, qos.durability or offer.durability)

    def _wanted(self, told: list[Publisher]) -> set[Offer]:
        offers = {self._own(publisher) for publisher in told if publisher.type_name == NAME}
        if self._has_gid or not offers:
            return offers
        weakest = Offer(min(o.reliability for o in offers), max(o.durability for o in offers))
        return {weakest}

    def _told(self) -> None:
        """What the graph has answered to the source; what it tells by itself waits."""
        if self._asks == 'graph':
            return
        self._read = told = self.network.told
        self._ever_read |= set(told)
        if self._asks == 'source':
            self.network.followed = told
            self._known |= set(told)

    def _acts(self) -> None:
        """The source reads what the graph has told, and acts on it."""
        if self.network.told_trouble is None:
            self._told()

    def _graph_tells(self) -> None:
        """Some time after it has changed, which may be long."""
        self._asks = 'graph'
        self.end.node.graph.look()
        self._asks = 'source'

    def _asked(self, offer: Offer) -> None:
        if self._kafka is not None and offer.durability == 'transient_local':
            self.network.clock.sleep(1.0)
            if self._kafka is AWAY:
                until_s = self.network.clock.monotonic() + POSTPONED_S
                self._answered[offer] = max(until_s, self._answered.get(offer, 0.0))
            raise self._kafka
        self._may_open, self._answered[offer] = offer, math.inf

    def _created(self, reader: Reader) -> None:
        assert reader.offer == self._may_open, 'it opens without asking for that'
        self._may_open = None

    def _destroyed(self, reader: Reader) -> None:
        offers = [other.offer for other in self.network.open_readers]
        if self._closes or (reader.failed > 1 and reader.offer in offers):  # made anew
            return
        if isinstance(self.network.told_trouble, ValueError):
            # It goes on with what it has followed last, and may have been told of others since.
            return
        wanted = self._wanted(self.network.followed)
        assert wanted, 'nobody else offers'
        assert reader.offer not in wanted, 'it is still offered'
        # Who is not in the graph may send already: that goes with a subscription that it matches,
        # where nobody known offers that and the last take had left it empty.
        left = [sample for sample in reader.cache if not sample.unseen]
        assert not [it for it in left if self._counts(it, reader)], 'it was not empty'

    def _counts(self, sample: Sample, reader: Reader) -> bool:
        """Whether nobody else has to bring it: through that of another offer it need not count."""
        publisher, seq = sample.publisher, sample.seq
        if not self._has_gid:
            offers = [it.offer for it in self.network.open_readers if it is not reader]
            # Where Kafka cannot be asked for a while, a history comes again.
            is_kept = publisher.offer.durability == 'transient_local'
            return not is_kept and not any(is_match(publisher.offer, it) for it in offers)
        return self._own(publisher) == reader.offer and seq > self._top[publisher]

    def _taken(self, reader: Reader, sample: Sample) -> None:
        publisher, seq = sample.publisher, sample.seq
        self._untold[b'%d:%d' % (publisher.number, seq)] += 1
        if self._counts(sample, reader):
            self._top[publisher] = seq
            if not self._handed[publisher] or seq > self._handed[publisher][-1]:
                self._owed[publisher].add(seq)

    def _handed_over(self, message: Message) -> Publisher:
        number, seq = map(int, message.cdr.split(b':'))
        publisher = self.network.publishers[number - 1]
        gid = publisher.gid if self._has_gid else b''
        assert message[1:] == (gid, seq, 1000 * seq)
        self._untold[message.cdr] -= 1
        before = self._handed[publisher]
        if self._has_gid:
            if not before and publisher in self._read:
                answered = self._answered.get(self._own(publisher), 0.0)
                assert self.network.clock.monotonic() <= answered, 'it may be in Kafka already'
            assert not before or before[-1] < seq, f'{seq} of {number} comes behind {before}'
        before.append(seq)
        self._owed[publisher].discard(seq)
        return publisher

    def _nothing_waits(self) -> None:
        assert not any(reader.cache for reader in self.network.open_readers), 'some can be taken'
        if not self._has_gid:
            assert not any(self._untold.values()), self._untold
            return
        for publisher, owed in self._owed.items():
            # What came of one that the graph did not show counts in the order that it came in.
            late = {seq for seq in owed if seq > self._blind[publisher]}
            assert not late, f'{late} of {publisher.number} were taken, and not handed over'

    def look(self) -> None:
        """Look at all that must be true at any time."""
        readers = [reader.offer for reader in self.network.open_readers]
        assert len(readers) == len(set(readers)), readers
        told = self._read
        of_type = [it for it in told if it.type_name == NAME]
        unmatched = [it for it in of_type if not is_match(it.offer, self._own(it))]
        matched = len(of_type) - len(unmatched)
        assert self.source.matches == (matched, len(told) - matched)
        if self._has_gid:
            ranges = [(it[-1] - it[0] + 1, len(it)) for it in self._handed.values() if it]
            lost = sum(all_of_them - handed for all_of_them, handed in ranges)
            assert self.source.lost_upstream == lost

    # What happens

    def happens(self, event: Event) -> None:
        what, where, how = event
        network = self.network
        if what in OF_THE_SOURCE:
            if self._is_open:
                self._does(what, where, how)
                self.look()
        elif what == 'publisher':
            self._comes(where, how)
        elif what == 'time':
            network.clock.sleep(PASSES_S[how - 1])
        elif what == 'graph tells':
            self._graph_tells()
        elif what in OF_A_PUBLISHER:
            if network.publishers:
                self._befalls(what, network.publishers[where % len(network.publishers)], how)
        elif what in KAFKA:
            self._kafka = KAFKA[what]
        else:
            network.happens(what)

    def _comes(self, where: int, how: int) -> None:
        network = self.network
        number, offer = len(network.publishers) + 1, OFFERS[how % 4]
        if number <= MOST_PUBLISHERS:
            publisher = Publisher(
                number,
                offer,
                'p/msg/Other' if where == 5 else NAME,
                None if where == 4 else bytes([number]) * 32,
                is_lossy=where == 3 or (how > 8 and offer.reliability == 'best_effort'),
                depth=2 if where == 2 else 1_000_000,
            )
            network.publishers.append(publisher)
            network.publish(publisher, where % 3)

    def _befalls(self, what: str, publisher: Publisher, how: int) -> None:
        """What happens to a publisher."""
        match what:
            case 'publish':
                self.network.publish(publisher, how)
            case 'leaves':
                if how > 4:
                    self.network.publish(publisher, how - 4)
                publisher.has_gone = True
                if how % 2:
                    self.network.show(publisher)
            case 'shown':
                self.network.show(publisher)
            case 'far':
                publisher.is_near = False
            case _:
                assert what == 'near'
                self.network.come_near(publisher)

    def opens(self) -> None:
        """Open the source, where ROS does not refuse it."""
        self.network.heal()
        self.source.open()
        self._is_open = True
        self.look()

    def _does(self, what: str, where: int, how: int) -> None:
        """What the source does, or one of its subscriptions."""
        readers, publishers = self.network.open_readers, self.network.publishers
        match what:
            case 'take':
                self.network.clock.sleep(where * 0.04)
                self._take(min(how, 10), 0.0)
            case 'wait':
                if publishers:
                    publisher = publishers[where % len(publishers)]
                    self.network.meanwhile = partial(self.network.publish, publisher, how)
                self._take(10, 0.5)
                self.network.meanwhile = lambda: None
            case 'look':
                for _ in range(1 + where % 3):
                    self._look()
                    self.network.clock.sleep(0.11)
            case 'hash':
                if publishers:
                    self._ask_hash(publishers[where % len(publishers)])
            case _:
                if readers:
                    reader = readers[where % len(readers)]
                    reader.failures, reader.fails_after = (1, 2, 5)[how % 3], how // 4

    def _take(self, limit: int, timeout_s: float) -> bool:
        """Whether it went well, and nothing came."""
        was_exhausted, known = self.source.exhausted, set(self._known)
        waited = sum(count > 0 for count in self._untold.values())
        heard = {publisher for publisher, handed in self._handed.items() if handed}
        self._acts()
        try:
            messages = self.source.take(limit, timeout_s)
        except BridgeError:
            assert was_exhausted or not self.source.exhausted or self._is_empty()
            return False
        # One of each subscription at the least, behind what waited for its publisher to be known.
        most = max(limit, len(self.network.open_readers))
        assert len(messages) <= most + waited
        for publisher in {self._handed_over(message) for message in messages}:
            is_known = publisher in heard | self._ever_read or not self._has_gid
            assert is_known or self.network.trouble is None, 'it waits until the graph can tell'
            if not self._can_tell(publisher) or publisher in heard - known:
                self._blind[publisher] = self._handed[publisher][-1]
        if self.source.exhausted:
            self._nothing_waits()
        return not messages

    def _can_tell(self, publisher: Publisher) -> bool:
        """Whether the source knows a publisher, or need only ask."""
        return publisher in self._known or (publisher.is_shown and self.network.trouble is None)

    def _is_empty(self) -> bool:
        return not any(reader.cache for reader in self.network.open_readers)

    def _look(self) -> None:
        self._acts()
        try:
            self.source.look()
        except BridgeError:
            refuses = self.network.refuses or self._kafka is REFUSES
            assert refuses or isinstance(self.network.told_trouble, RCLError)

    def _ask_hash(self, publisher: Publisher) -> None:
        self.network.clock.sleep(0.03)  # it asks no more often
        self._asks = 'hash'
        told = self.reader.type_hash(publisher.gid)
        self._asks = 'source'
        known = HASH if publisher.type_hash is None else f'RIHS01_{publisher.type_hash.hex()}'
        assert told == (known if publisher in self._ever_read else None)
        assert told is not None or not self._can_tell(publisher)

    # The end

    def ends(self) -> None:
        """All is well again; it becomes quiet, and all has come."""
        network = self.network
        network.heal()
        self._kafka = None
        for publisher in network.publishers:
            network.come_near(publisher)
        network.happens('graph')
        self._graph_tells()
        self._becomes_quiet()
        told = [publisher for publisher in network.publishers if publisher.is_shown]
        assert network.told == told
        wanted = self._wanted(told)
        readers = {reader.offer for reader in network.open_readers}
        assert readers == wanted or (readers and not wanted)
        for publisher in told:
            self._ask_hash(publisher)
            network.publish(publisher, 1)
        self._becomes_quiet()
        self._closes = network.sticks = True
        self.source.close()
        assert not network.open_readers

    def _becomes_quiet(self) -> None:
        quiet = 0
        for _ in range(100):
            self.network.clock.sleep(1.0)
            quiet = quiet + 1 if self._take(50, 0.0) and self.source.exhausted else 0
            self.look()
            if quiet > 12:  # as long as one waits for Kafka
                break
        else:
            pytest.fail('it is never quiet')


@contextmanager
def a_world(qos: QoS, seed: int, *, has_gid: bool) -> Iterator[World]:
    """A world whose time passes only where somebody waits."""
    with pytest.MonkeyPatch.context() as patch:
        network = Network(seed, has_gid=has_gid)
        kernel = SimpleNamespace(epoll=lambda: Poll(network), EPOLLIN=select.EPOLLIN)
        patch.setattr(arrivals, 'select', kernel)
        patch.setattr(rcl, 'notify', network.notify)
        patch.setattr(rcl, 'notify_nobody', network.notify_nobody)
        patch.setattr('time.monotonic', network.clock.monotonic)
        patch.setattr('time.sleep', network.clock.sleep)
        yield World(network, qos)
