"""Sending dead letters again: what `dead-letters replay` does.

Each letter and the mark that it was replayed are written in one transaction: both, or none. Where
that may be in danger (see `Transactions.spent`), others are opened, and the marks read anew. The
transactional id belongs to the dead-letter topic, so a second replay shuts out the first before it
reads the marks. Whatever ends a replay, the next one knows exactly what is left.
"""

import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from functools import cache
from typing import Final, NamedTuple

from ros2_kafka_bridge.commands.dead_letters.replay_ros import open_channels
from ros2_kafka_bridge.commands.dead_letters.report import Found as Looked
from ros2_kafka_bridge.commands.dead_letters.report import (
    LetterQuery,
    no_such_letter,
    none_there,
    open_reader,
    unseen_in_words,
)
from ros2_kafka_bridge.commands.dead_letters.restore import Again, Restorer
from ros2_kafka_bridge.commands.dead_letters.types import LetterTypes, open_asking, why_packages
from ros2_kafka_bridge.commands.screen import waiting
from ros2_kafka_bridge.config.settings import Config, KafkaToRosRoute
from ros2_kafka_bridge.dead_letters.filter import Index, LetterFilter, limited, read_index
from ros2_kafka_bridge.dead_letters.letter import Letter, LetterPlace, mark
from ros2_kafka_bridge.dead_letters.shown import escaped
from ros2_kafka_bridge.errors import BridgeError, ConfigError, RecordError
from ros2_kafka_bridge.kafka.letters import LetterReader, Originals
from ros2_kafka_bridge.kafka.properties import producer_properties
from ros2_kafka_bridge.kafka.transactions import Parcel, Send, Transactions
from ros2_kafka_bridge.logs.text import count
from ros2_kafka_bridge.ros.node import RosNode
from ros2_kafka_bridge.threads.stop import Stop, handling

_BATCH: Final = 200
_BATCH_BYTES: Final = 8_000_000
_GO_ON: Final = 'the same command goes on with the rest'


class ReplayOptions(NamedTuple):
    """How to replay.

    Args:
        to_ros: Publish straight to ROS instead of producing to the original topic.
        dry_run: Say what would be done, and do nothing.
        again: Also what was replayed before.
        force: Also what would fail again, back to its topic.
        all: No filter is meant.
    """

    to_ros: bool
    dry_run: bool
    again: bool
    force: bool
    all: bool


class Ready(NamedTuple):
    """A letter that can be sent."""

    letter: Letter
    again: Again

    @property
    def size_bytes(self) -> int:
        """What it takes in memory, about."""
        return len(self.again.record.value or b'') + 1000


class ReplayTally:
    """What became of the letters."""

    def __init__(self) -> None:
        self.sent: Counter[str] = Counter()
        self.unvouched: Counter[str] = Counter()
        self.left = 0
        self.before = 0
        self.foreign = 0

    def send(self, again: Again, to: str) -> None:
        """Count a letter that was sent, or would be."""
        self.sent[to] += 1
        if again.unvouched:
            self.unvouched[again.unvouched] += 1

    def leave(self, letter: Letter, reason: str) -> None:
        """Say why a letter stays one."""
        self.left += 1
        _say(f'left: {letter.place}: {reason}')

    def text(self, *, dry_run: bool) -> str:
        """All of it in a line."""
        verb = 'would be replayed' if dry_run else 'replayed'
        total = count(sum(self.sent.values()), 'letter')
        parts = [f'{total} {verb}' + _to(self.sent)]
        parts += [f'{self.left} left as they are'] * bool(self.left)
        parts += [f'{self.before} replayed before (--again)'] * bool(self.before)
        parts += [f'{self.foreign} not dead letters of a bridge'] * bool(self.foreign)
        return '; '.join(parts)

    @property
    def vouching(self) -> str:
        """Of which letters nothing else shows that a bridge has written them; empty if of all."""
        kinds = ', '.join(f'{number} {kind}' for kind, number in self.unvouched.items())
        return kinds and (
            f'not vouched for: {kinds}: nothing but the letter tells of them, and whoever may '
            'write to the dead-letter topic could have written it'
        )


def replay(query: LetterQuery, options: ReplayOptions) -> int:
    """Replay the letters that are meant; returns the exit status.

    Raises:
        ConfigError: The options do not go together, or there is no such letter.
        BridgeError: Kafka was away from the start, or does not let this user in.
    """
    _check(query.filter, options)
    tally, stop = ReplayTally(), Stop()
    with ExitStack() as stack:
        reader = stack.enter_context(open_reader(query.config))
        originals = stack.enter_context(open_reader(query.config))
        missing = [topic for topic in query.topics() if not reader.has(topic)]
        there = [topic for topic in query.topics() if topic not in missing]
        run = _Run(query, options, tally, stop, reader, originals, stack)
        try:
            for topic in there:
                run.replay(topic)
        except ConfigError:
            raise
        except BridgeError as error:
            if not run.began:
                raise
            rest = (
                f'; {_GO_ON}, some of it perhaps again'
                if options.to_ros
                else f', perhaps the batch in hand, too; {_GO_ON}, exactly'
            )
            text = f'{escaped(str(error))}; {tally.text(dry_run=False)}{rest}'
            print(text, file=sys.stderr)  # noqa: T201 (the words for the user)
            if tally.vouching:
                _say(tally.vouching)
            return 1
    looked = Looked([], {}, missing, list(reader.unseen.values()))
    return _end(query, options, tally, looked, cut=run.cut)


def _check(letter_filter: LetterFilter, options: ReplayOptions) -> None:
    mistakes = []
    if not letter_filter.is_narrow and not options.all:
        mistakes.append('which letters? Give a filter such as --route or --since, or --all')
    if options.to_ros and options.force:
        mistakes.append('--force goes with --to kafka only: ROS would take garbage silently')
    if mistakes:
        raise ConfigError(mistakes)


def _end(
    query: LetterQuery,
    options: ReplayOptions,
    tally: ReplayTally,
    looked: Looked,
    *,
    cut: bool,
) -> int:
    nothing = not (tally.sent or tally.left or tally.before or tally.foreign)
    if nothing and not cut:
        if query.filter.offset is not None:
            raise no_such_letter(query, looked)
        _say(none_there(query, looked))
        return 0
    for place in looked.unseen:
        _say(unseen_in_words(place))
    text = tally.text(dry_run=options.dry_run)
    _say(f'stopped: {text}; {_GO_ON}' if cut else text)
    if tally.vouching:
        _say(tally.vouching)
    return 1 if tally.left or cut else 0


class _Run:
    """One replay over all its topics."""

    def __init__(
        self,
        query: LetterQuery,
        options: ReplayOptions,
        tally: ReplayTally,
        stop: Stop,
        reader: LetterReader,
        originals: LetterReader,
        stack: ExitStack,
    ) -> None:
        self.began = False
        self.cut = False
        self._todo: set[LetterPlace] | None = None  # of the topic; None: not looked at yet
        self._config: Config = query.config
        self._filter = query.filter
        self._options = options
        self._tally = tally
        self._stop = stop
        self._reader = reader
        self._channels = cache(lambda: stack.enter_context(open_channels(query.config, stop)))
        self._asking = cache(lambda: stack.enter_context(open_asking(query.config)))
        self._restorer = Restorer(
            query.config,
            reader.partitions,
            Originals(originals).fetch,
            LetterTypes(
                query.config, self._join_ros, why_packages(query.config, to_ros=options.to_ros)
            ),
            force=options.force,
        )

    def _join_ros(self) -> RosNode:
        # Fast DDS takes the histories of the channels from the first node of a process alone.
        return self._channels().node if self._options.to_ros else self._asking()

    def replay(self, topic: str) -> None:
        """Replay the letters of one dead-letter topic."""
        if self._is_cut():
            return
        self._todo = None
        if self._options.dry_run:
            for letter in self._chosen(topic, whole=False):
                self._tell(letter)
            return
        while not self._is_cut() and self._goes_on(topic):
            pass

    def _goes_on(self, topic: str) -> bool:
        """Replay with one client; tells whether another has to go on with what is left."""
        properties = producer_properties(self._config.kafka, client_id=self._config.name)
        # First the door is shut behind which others could write marks, then these are read.
        with (
            ExitStack() as stack,
            Transactions(properties, f'{topic}.replay', self._stop) as transactions,
        ):
            letters = self._chosen(topic, whole=True)
            # The first signal ends it after the batch in hand, also while the transactions end; at
            # the second it does not wait for Kafka.
            stack.enter_context(handling(self._stop.on_signal))
            for batch in self._batches(letters):
                self._send(batch, transactions)
                if transactions.spent:
                    return bool(self._todo)
        return False

    def _chosen(self, topic: str, *, whole: bool) -> Iterator[Letter]:
        """The letters to replay, with their values, in the order of each partition."""
        with waiting(f'Reading {topic}'):
            found = self._reader.letters(topic, self._filter.since_ms, whole=whole)
            index = read_index(found, self._filter)
        if self._todo is None:  # what comes later may be what is replayed, and has failed again
            self._todo = {letter.place for letter in index.letters}
        left = None
        if self._filter.limit is not None:
            left = self._filter.limit - sum(self._tally.sent.values()) - self._tally.left
        offsets: dict[int, set[int]] = {}
        for letter in limited(self._open(index), left):
            offsets.setdefault(letter.place.partition, set()).add(letter.place.offset)
        for partition, wanted in offsets.items():
            yield from self._reader.fetch(topic, partition, wanted)

    def _open(self, index: Index) -> Iterator[Letter]:
        """Those that are not replayed, and that can be."""
        for letter in index.letters:
            if letter.place not in (self._todo or ()):
                continue
            if letter.about is None:
                self._tally.foreign += 1
            elif letter.place in index.marks and not self._options.again:
                self._tally.before += 1
            else:
                yield letter
                continue
            self._done(letter)

    def _done(self, letter: Letter) -> None:
        if self._todo:
            self._todo.discard(letter.place)

    def _restored(self, letter: Letter) -> Again | None:
        try:
            if self._options.to_ros:
                return self._restorer.for_ros(letter)
            return self._restorer.for_kafka(letter)
        except RecordError as error:
            self._leave(letter, error)
            return None

    def _leave(self, letter: Letter, error: RecordError) -> None:
        self._done(letter)
        self._tally.leave(letter, escaped(str(error)))

    def _tell(self, letter: Letter) -> None:
        if again := self._restored(letter):
            to = self._target(again)
            self._tally.send(again, to)
            _say(f'would replay: {letter.place} to {escaped(to)}')

    def _target(self, again: Again) -> str:
        if self._options.to_ros:
            assert again.route is not None, 'the restorer says so'
            return f'ros:{again.route.ros_topic}'
        return again.record.topic

    def _batches(self, letters: Iterator[Letter]) -> Iterator[list[Ready]]:
        batch: list[Ready] = []
        for letter in letters:
            if self._is_cut():
                return
            if again := self._restored(letter):
                batch.append(Ready(letter, again))
            if len(batch) >= _BATCH or sum(r.size_bytes for r in batch) > _BATCH_BYTES:
                yield batch
                batch = []
        if batch and not self._is_cut():
            yield batch

    def _is_cut(self) -> bool:
        """Whether to leave what is next to another replay."""
        self.cut = self.cut or self._stop.asked
        return self._stop.asked

    def _send(self, batch: Sequence[Ready], transactions: Transactions) -> None:
        self.began = True
        if not self._options.to_ros:
            self._write(batch, transactions)
            return
        routes = {route.name: route for route in self._config.to_ros}
        for name in dict.fromkeys(one.again.route.name for one in batch if one.again.route):
            part = [one for one in batch if one.again.route and one.again.route.name == name]
            if self._is_cut() or transactions.spent:
                return
            self._publish(routes[name], part, transactions)

    def _publish(
        self, route: KafkaToRosRoute, part: Sequence[Ready], transactions: Transactions
    ) -> None:
        """Publish, and mark what all readers have, also where not all of it comes so far."""
        channel = self._channels().open(route)
        try:
            channel.deliver([one.again.record for one in part])
        finally:
            self._write(part[: channel.delivered], transactions)
        self.cut = self.cut or channel.delivered < len(part)

    def _write(self, batch: Sequence[Ready], transactions: Transactions) -> None:
        """Write records and marks, or after publishing the marks alone."""
        parcels = [self._parcel(number, one) for number, one in enumerate(batch)]
        refused, not_yet = transactions.write(parcels)
        bad = {one.parcel.number: one.error for one in refused}
        left = {parcel.number for parcel in not_yet}
        for number, one in enumerate(batch):
            if number in bad:
                self._leave(one.letter, bad[number])
            elif number not in left:
                self._done(one.letter)
                self._tally.send(one.again, self._target(one.again))

    def _parcel(self, number: int, one: Ready) -> Parcel:
        place = one.letter.place
        done = Send(mark(place, self._target(one.again)), place.partition)
        if self._options.to_ros:
            return Parcel(number, [done])
        return Parcel(number, [Send(one.again.record, one.again.partition), done])


def _to(sent: Counter[str]) -> str:
    if not sent:
        return ''
    if len(sent) == 1:
        return f' to {escaped(next(iter(sent)))}'
    return f' ({", ".join(f"{number} to {escaped(to)}" for to, number in sent.items())})'


def _say(text: str) -> None:
    print(text, flush=True)  # noqa: T201 (the words for the user)
