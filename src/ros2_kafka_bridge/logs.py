"""Logs: one line each, as text or JSON, with the route it is about."""

import json
import logging
import sys
import time
from datetime import UTC, datetime
from typing import Literal

LogFormat = Literal['text', 'json']

_OFTEN = 5
_PERIOD_S = 10.0


class _JsonFormatter(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        line = {
            'time': datetime.fromtimestamp(record.created, UTC).isoformat(timespec='milliseconds'),
            'level': record.levelname.lower(),
            'route': getattr(record, 'route', None),
            'message': record.getMessage(),
        }
        if record.exc_info:
            line['traceback'] = self.formatException(record.exc_info)
        return json.dumps({key: value for key, value in line.items() if value is not None})


class _TextFormatter(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        route = getattr(record, 'route', None)
        record.about = f'{route}: ' if route else ''
        return super().format(record)


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


class Occasional:
    """Says the first few warnings of every ten seconds, then how many it kept back."""

    def __init__(self, log: logging.LoggerAdapter[logging.Logger]) -> None:
        self._log = log
        self._since_s = 0.0
        self._count = 0

    def warning(self, message: str) -> None:
        """Say a warning, unless there were many just now."""
        now_s = time.monotonic()
        if now_s - self._since_s > _PERIOD_S:
            if self._count > _OFTEN:
                self._log.warning('and %d more like the last ones', self._count - _OFTEN)
            self._since_s, self._count = now_s, 0
        self._count += 1
        if self._count <= _OFTEN:
            self._log.warning('%s', message)
