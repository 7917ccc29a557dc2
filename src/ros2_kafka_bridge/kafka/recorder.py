"""A flight recorder: the last that a Kafka client said of itself, told when it was of no use."""

import logging
import time
from collections import defaultdict, deque
from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any, Final

import msgspec

from ros2_kafka_bridge.logs.lines import Log

_DEBUG: Final = 'debug'
_OF_A_KIND: Final = 40
_OF_ALL: Final = 200
_NOISE: Final = ('DUMP', 'CGRPOP')  # its own lists, and what it hands on inside
# librdkafka's STATISTICS.md says what they are.
_GROUP: Final = ('state', 'join_state', 'stateage', 'rebalance_reason', 'assignment_size')
_BROKER: Final = ('state', 'stateage', 'waitresp_cnt', 'rxidle', 'txidle', 'req_timeouts')
_PARTITION: Final = (
    'broker', 'leader', 'fetch_state', 'query_offset', 'next_offset', 'app_offset', 'eof_offset',
    'hi_offset', 'fetchq_cnt',
)  # fmt: skip


def with_recording(properties: Mapping[str, Any]) -> dict[str, Any]:
    """Properties of a client that says what a `Recorder` keeps; what the user asks for is kept.

    Not `fetch`, too: while its queue is full, a client says that of every partition a hundred
    times a second. With 64 of them that took nine tenths of a core, and the lines came faster
    than they were taken. What became of the fetches stands in the statistics.
    """
    return {_DEBUG: 'cgrp', **properties}


class Recorder:
    """Takes the place of a client's logger, and keeps what it gets; passes on what is no detail.

    A client that is assigned and never fetches says nothing wrong; what it did in the seconds
    before, and what it makes of its partitions, tells why. Of each kind of line the last few are
    kept, so that a frequent one does not push out the one assignment.

    Args:
        logger: For what is more than a detail.
    """

    def __init__(self, logger: logging.Logger) -> None:
        self._logger = logger
        self._kinds: defaultdict[str, deque[tuple[float, str]]] = defaultdict(
            partial(deque, maxlen=_OF_A_KIND)
        )
        self._statistics = ''

    def log(self, level: int, form: str, kind: str, client: str, text: str) -> None:
        """Take a line (called by confluent_kafka in the thread that polls the client).

        Args:
            level: As in `logging`.
            form: For the other three.
            kind: librdkafka's word for it, such as `ASSIGN` or `HEARTBEAT`.
            client: Name of the client.
            text: What it says.
        """
        if not kind.startswith(_NOISE):
            self._kinds[kind].append((time.monotonic(), text))
        if level > logging.DEBUG:
            self._logger.log(level, form, kind, client, text)

    def on_statistics(self, text: str) -> None:
        """Take a report of the client, as librdkafka calls back with it."""
        self._statistics = text

    def tell(self, log: Log, most: int = _OF_ALL) -> None:
        """Write out the last lines that are kept, oldest first, and the last report; forget all.

        Args:
            log: Where to write.
            most: So many lines at most, and as many of the report.
        """
        now_s = time.monotonic()
        lines = [(at_s, kind, text) for kind, of in self._kinds.items() for at_s, text in of]
        self._kinds.clear()
        for at_s, kind, text in sorted(lines)[-most:]:
            log.info('the Kafka client, %.3f s ago: %s %s', now_s - at_s, kind, text)
        report, self._statistics = self._statistics, ''
        for _, words in zip(range(most), _reported(report), strict=False):
            log.info('the Kafka client reported: %s', words)


def _reported(text: str) -> Iterator[str]:
    """What a report tells of the group, the brokers and the partitions that are read."""
    try:
        report = msgspec.json.decode(text)
    except msgspec.DecodeError:  # none yet, or a client.id with a quote, which is not escaped
        return
    yield f'group: {_words(report.get("cgrp", {}), _GROUP)}'
    for name, broker in report.get('brokers', {}).items():
        yield f'{name}: {_words(broker, _BROKER)}'
    for topic, told in report.get('topics', {}).items():
        for number, partition in told.get('partitions', {}).items():
            if partition.get('desired'):
                yield f'{topic}[{number}]: {_words(partition, _PARTITION)}'


def _words(told: Mapping[str, object], names: tuple[str, ...]) -> str:
    return ', '.join(f'{name} {told[name]}' for name in names if name in told)
