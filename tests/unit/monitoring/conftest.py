"""A watch that has been told about a bridge with a route each way."""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec
import pytest
from support.monitoring.monitors import TOKEN, report, snapshot

from ros2_kafka_bridge.config.file import loads
from ros2_kafka_bridge.config.validation import plain
from ros2_kafka_bridge.monitoring.state import Watch
from ros2_kafka_bridge.protocol.monitor import Answer, Configured, Report, Request
from ros2_kafka_bridge.route.counters import Measures, State

if TYPE_CHECKING:
    from collections.abc import Callable

CONFIG = f"""
name: test
kafka: {{bootstrap.servers: localhost:9}}
monitoring: {{token: {TOKEN}, allowed_hosts: [ops.example]}}
routes:
  - name: orders
    from: {{kafka: orders}}
    to: {{ros: /orders, type: std_msgs/msg/String}}
    format: text
  - name: returned
    from: {{ros: /orders, type: std_msgs/msg/String}}
    to: {{kafka: returned}}
    format: text
    spool: {{path: /var/tmp/none, max_bytes: 5000000}}
"""


FILE = '/etc/bridge.yaml'


def configured(text: str, *routes: str) -> Configured:
    """What a supervisor tells of a configuration."""
    return Configured(plain(loads(text, FILE, {})), FILE, routes)


class Told:
    """A watch, and the supervisor that it speaks to."""

    def __init__(self, config: str = CONFIG) -> None:
        self.requests: list[Request] = []
        self.answer: Callable[[Request], Answer | None] = lambda asked: Answer(
            asked.number, done=True, text=f'{asked.do} {asked.route}'
        )
        self.watch = Watch(self._hear, patience_s=0.2)
        self.tell(configured(config))

    def tell(self, what: Report | Configured | Answer) -> None:
        self.watch.on_line(msgspec.json.encode(what) + b'\n')

    def _hear(self, line: bytes) -> None:
        asked = msgspec.json.decode(line, type=Request)
        self.requests.append(asked)
        # The reader of the real process is another thread; here it answers once it may.
        if (answer := self.answer(asked)) is not None:
            import threading  # noqa: PLC0415 (only here)

            threading.Timer(0.01, self.tell, [answer]).start()


@pytest.fixture
def told() -> Told:
    """A bridge that runs, with numbers that balance."""
    made = Told()
    measures = Measures(bytes_taken=900, errors={'DecodeError': 2}, queue_limit=500)
    orders = snapshot(
        'orders', taken=20, confirmed=12, dead_lettered=2, skipped=1, in_flight=5, lag=7,
        measures=measures,
    )  # fmt: skip
    returned = snapshot('returned', State.WAITING, reason='Kafka is away', taken=4, spooled=4)
    made.tell(report(orders, returned))
    return made
