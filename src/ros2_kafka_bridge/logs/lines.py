"""Logs: one line each, as text or JSON, with the route it is about."""

import codecs
import json
import logging
import os
import sys
import textwrap
from collections.abc import MutableMapping
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from ros2_kafka_bridge.logs.handler import LogHandler
from ros2_kafka_bridge.logs.summed import FIRST, PERIOD_S, Summed
from ros2_kafka_bridge.logs.text import printable, printable_lines
from ros2_kafka_bridge.outside.masking import masked_addresses

if TYPE_CHECKING:
    from ros2_kafka_bridge.errors import About

LogFormat = Literal['text', 'json']
Log: TypeAlias = logging.LoggerAdapter[logging.Logger]


class RouteLog(Log):
    """The log of one route, with the sums of what repeats in it.

    A call may say which record or message it is about: `extra={'about': About(...)}`. One that
    tells figures may give them to programs, too: `extra={'figures': {'lag': 7}}`.
    """

    def __init__(self, logger: logging.Logger, route: str | None) -> None:
        super().__init__(logger, {'route': route})
        self._sums: dict[tuple[int, float], Summed] = {}

    def process(
        self, msg: Any, kwargs: MutableMapping[str, Any]
    ) -> tuple[Any, MutableMapping[str, Any]]:
        """Add the route to what the call itself brings along."""
        kwargs['extra'] = {**(self.extra or {}), **(kwargs.get('extra') or {})}
        return msg, kwargs

    def summed(self, first: int, period_s: float) -> Summed:
        """What sums lines in this way, the same for all who ask."""
        return self._sums.setdefault((first, period_s), Summed(self, first, period_s))

    def tick(self) -> None:
        """Say what was kept back for a period."""
        for sums in list(self._sums.values()):
            sums.tick()

    def close(self) -> None:
        """Say all that was kept back."""
        for sums in list(self._sums.values()):
            sums.close()


def route_log(route: str | None = None) -> RouteLog:
    """Make the log of one route; without a name, that of the bridge."""
    return RouteLog(logging.getLogger('ros2_kafka_bridge'), route)


def summed(log: Log, first: int = FIRST, period_s: float = PERIOD_S) -> Summed:
    """What sums the lines of a log that repeat; see `Summed`."""
    if isinstance(log, RouteLog):
        return log.summed(first, period_s)
    return Summed(log, first, period_s)


class _JsonFormatter(logging.Formatter):
    def __init__(self, worker: int) -> None:
        super().__init__()
        self._same = {'pid': os.getpid(), 'worker': worker or None}

    def format(self, record: logging.LogRecord) -> str:
        about: About | None = getattr(record, 'about', None)
        line = {
            'time': datetime.fromtimestamp(record.created, UTC).isoformat(timespec='milliseconds'),
            'level': record.levelname.lower(),
            **self._same,
            'thread': record.threadName,
            'route': getattr(record, 'route', None),
            **({} if about is None else about._asdict()),
            'times': getattr(record, 'times', None),
            **getattr(record, 'figures', {}),
            'message': printable(masked_addresses(record.getMessage())),
        }
        if record.exc_info:
            line['traceback'] = _shown_traceback(self.formatException(record.exc_info))
        return json.dumps({key: value for key, value in line.items() if value is not None})


class _TextFormatter(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        route = getattr(record, 'route', None)
        record.head = f'{route}: ' if route else ''
        return super().format(record)

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802 (logging's name)
        about: About | None = getattr(record, 'about', None)
        trace = f' (trace {about.trace_id})' if about and about.trace_id else ''
        record.message = printable(masked_addresses(record.message)) + trace
        return super().formatMessage(record)

    def formatException(self, ei: Any) -> str:  # noqa: N802 (logging's name)
        # Behind blanks, no line of it looks like one of the log's own.
        return textwrap.indent(_shown_traceback(super().formatException(ei)), '    ')


def _shown_traceback(text: str) -> str:
    return printable_lines(masked_addresses(text))


def set_up(log_format: LogFormat, worker: int = 0) -> None:
    """Send the bridge's log to standard error, from the level INFO on.

    There the warnings of libraries come out as well, which Python would write as they are.

    Args:
        log_format: How a line looks.
        worker: Number of this process among the workers of one bridge; 0 where it is none.
    """
    handler = logging.NullHandler() if sys.stderr is None else LogHandler()
    handler.addFilter(_is_no_repetition)
    handler.setFormatter(
        _JsonFormatter(worker)
        if log_format == 'json'
        else _TextFormatter('%(asctime)s %(levelname)-7s %(head)s%(message)s')
    )
    logger = logging.getLogger('ros2_kafka_bridge')
    logger.handlers = [handler]
    logger.setLevel(logging.INFO)
    logger.propagate = False
    logging.lastResort = handler
    codecs.lookup('unicode_escape')  # once no file can be opened any more, it could not be read


def _is_no_repetition(record: logging.LogRecord) -> bool:
    """A Kafka client's own lines repeat what the bridge says with the route and the cure."""
    return record.levelno >= logging.CRITICAL or not record.name.endswith('.librdkafka')


def client_log(module: str, level: int = logging.CRITICAL) -> logging.Logger:
    """Make the log of a module's Kafka client, silent but from `level` on."""
    logger = logging.getLogger(f'{module}.librdkafka')
    logger.setLevel(level)
    return logger


def keep_clients_quiet() -> None:
    """Leave it to a command to say in its own words what the Kafka clients would log."""
    logging.getLogger('ros2_kafka_bridge').addHandler(logging.NullHandler())
