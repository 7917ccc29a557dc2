"""A flight recorder: the last that a Kafka client said of itself, read when it was of no use."""

import logging
import time
from collections import defaultdict, deque
from collections.abc import Mapping
from functools import partial
from typing import Any, Final

_DEBUG: Final = 'debug'
_OF_A_KIND: Final = 40
_OF_ALL: Final = 200
_NOISE: Final = ('DUMP', 'CGRPOP')  # its own lists, and what it hands on inside


def with_recording(properties: Mapping[str, Any]) -> dict[str, Any]:
    """Properties of a client that says what a `Recorder` keeps; what the user asks for is kept."""
    return {_DEBUG: 'cgrp,fetch', **properties}


class Recorder:
    """Takes the place of a client's logger, and keeps what it gets; passes on what is no detail.

    One that is assigned and never fetches says nothing wrong; what it did in the seconds before
    tells why. Of each kind of line the last few are kept, so that the many fetches of one
    partition do not push out the one assignment of another.

    Args:
        logger: For what is more than a detail.
    """

    def __init__(self, logger: logging.Logger) -> None:
        self._logger = logger
        self._kinds: defaultdict[str, deque[tuple[float, str]]] = defaultdict(
            partial(deque, maxlen=_OF_A_KIND)
        )

    def log(self, level: int, form: str, kind: str, client: str, text: str) -> None:
        """Take a line (called by confluent_kafka in the thread that polls the client).

        Args:
            level: As in `logging`.
            form: For the other three.
            kind: librdkafka's word for it, such as `FETCH` or `HEARTBEAT`.
            client: Name of the client.
            text: What it says.
        """
        if not kind.startswith(_NOISE):
            self._kinds[kind].append((time.monotonic(), text))
        if level > logging.DEBUG:
            self._logger.log(level, form, kind, client, text)

    def tell(self, log: logging.LoggerAdapter[logging.Logger], most: int = _OF_ALL) -> None:
        """Write out the last lines that are kept, oldest first, and forget all."""
        now_s = time.monotonic()
        lines = [(at_s, kind, text) for kind, of in self._kinds.items() for at_s, text in of]
        self._kinds.clear()
        for at_s, kind, text in sorted(lines)[-most:]:
            log.info('the Kafka client, %.3f s ago: %s %s', now_s - at_s, kind, text)
