"""Logs: one line each, as text or JSON, with the route it is about."""

import json
import logging
import sys
import textwrap
import time
from datetime import UTC, datetime
from typing import Any, Literal, NamedTuple

from ros2_kafka_bridge.plural import count
from ros2_kafka_bridge.printable import printable, printable_lines

LogFormat = Literal['text', 'json']

_OFTEN = 5
_PERIOD_S = 10.0
_AGAIN_S = 60.0


class _JsonFormatter(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        line = {
            'time': datetime.fromtimestamp(record.created, UTC).isoformat(timespec='milliseconds'),
            'level': record.levelname.lower(),
            'route': getattr(record, 'route', None),
            'message': printable(record.getMessage()),
        }
        if record.exc_info:
            line['traceback'] = printable_lines(self.formatException(record.exc_info))
        return json.dumps({key: value for key, value in line.items() if value is not None})


class _TextFormatter(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        route = getattr(record, 'route', None)
        record.about = f'{route}: ' if route else ''
        return super().format(record)

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802 (logging's name)
        record.message = printable(record.message)
        return super().formatMessage(record)

    def formatException(self, ei: Any) -> str:  # noqa: N802 (logging's name)
        # Behind blanks, no line of it looks like one of the log's own.
        return textwrap.indent(printable_lines(super().formatException(ei)), '    ')


def set_up(log_format: LogFormat) -> None:
    """Send the bridge's log to standard error, from the level INFO on."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(
        _JsonFormatter()
        if log_format == 'json'
        else _TextFormatter('%(asctime)s %(levelname)-7s %(about)s%(message)s')
    )
    logger = logging.getLogger('ros2_kafka_bridge')
    logger.handlers = [handler]
    logger.setLevel(logging.INFO)
    logger.propagate = False
    # The client's own lines repeat what the bridge says with the route and the cure.
    for client in ('admin', 'broker', 'consumer', 'overview', 'producer', 'tail'):
        logging.getLogger(f'ros2_kafka_bridge.kafka.{client}.librdkafka').setLevel(
            logging.CRITICAL
        )


def route_log(route: str | None = None) -> logging.LoggerAdapter[logging.Logger]:
    """Make the log of one route; without a name, that of the bridge."""
    return logging.LoggerAdapter(logging.getLogger('ros2_kafka_bridge'), {'route': route})


class Repeated:
    """Says each error once, and again when a minute has passed."""

    def __init__(self, log: logging.LoggerAdapter[logging.Logger]) -> None:
        self._log = log
        self._said: dict[str, _Said] = {}

    def error(self, text: str, more: str = '') -> None:
        """Say an error, unless it was said just now.

        Args:
            text: What has happened.
            more: What follows it; it may differ each time.
        """
        now_s = time.monotonic()
        before = self._said.get(text)
        if before is not None and now_s - before.at_s < _AGAIN_S:
            self._said[text] = before._replace(kept_back=before.kept_back + 1)
            return
        again = '' if before is None else f' ({count(before.kept_back + 1, "time")} more)'
        self._log.error('%s%s%s', text, again, more)
        recent = {t: said for t, said in self._said.items() if now_s - said.at_s < _AGAIN_S}
        self._said = {**recent, text: _Said(now_s)}


class _Said(NamedTuple):
    at_s: float
    kept_back: int = 0


def client_log(module: str, level: int = logging.CRITICAL) -> logging.Logger:
    """Make the log of a module's Kafka client, silent but from `level` on."""
    logger = logging.getLogger(f'{module}.librdkafka')
    logger.setLevel(level)
    return logger


def keep_clients_quiet() -> None:
    """Leave it to a command to say in its own words what the Kafka clients would log."""
    logging.getLogger('ros2_kafka_bridge').addHandler(logging.NullHandler())


class Occasional:
    """Says the first few lines of every ten seconds, then how many it kept back."""

    def __init__(self, log: logging.LoggerAdapter[logging.Logger]) -> None:
        self._log = log
        self._since_s = 0.0
        self._count = 0

    def warning(self, message: str) -> None:
        """Say a warning, unless there were many lines just now."""
        self._say(logging.WARNING, message)

    def error(self, message: str) -> None:
        """Say an error, unless there were many lines just now."""
        self._say(logging.ERROR, message)

    def _say(self, level: int, message: str) -> None:
        now_s = time.monotonic()
        if now_s - self._since_s > _PERIOD_S:
            if self._count > _OFTEN:
                self._log.log(level, 'and %d more like the last ones', self._count - _OFTEN)
            self._since_s, self._count = now_s, 0
        self._count += 1
        if self._count <= _OFTEN:
            self._log.log(level, '%s', message)
