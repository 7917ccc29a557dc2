"""A page of the warehouse in a browser, and what is put before it."""

import time
from typing import Any, Final

from confluent_kafka import Producer
from playwright.sync_api import Page
from support.processes.harness import Bench, Process

from ros2_kafka_bridge.testing.local_kafka import LocalKafka
from ros2_kafka_warehouse.codec import encode
from ros2_kafka_warehouse.messages.message import Message
from ros2_kafka_warehouse.messages.monitor import FleetReport, RobotReport
from ros2_kafka_warehouse.messages.onlookers import Plan, Plans
from ros2_kafka_warehouse.messages.robots import FleetState, Position, PowerSupply, RobotState

PATIENCE_MS: Final = 60_000
ROBOT: Final = 'carrier-01'


class Stage:
    """A Kafka, the page's server, and a browser that looks at it."""

    def __init__(self, kafka: LocalKafka, bench: Bench, server: Process, page: Page) -> None:
        self.kafka = kafka
        self.bench = bench
        self.server = server
        self.page = page
        self.said: list[str] = []  # errors in the browser's console
        self.step = 0
        self._producer = Producer({'bootstrap.servers': kafka.bootstrap_servers})
        page.on('pageerror', lambda error: self.said.append(str(error)))
        page.on('console', lambda it: self.said.append(it.text) if it.type == 'error' else None)

    @property
    def url(self) -> str:
        """Where the page is."""
        return self.server.output().split('shown at ')[1].split()[0]

    def put(self, topic: str, message: Message) -> None:
        """What the bridge would bring to Kafka."""
        self._producer.produce(topic, encode(message), topic)
        assert self._producer.flush(30) == 0

    def drive(self) -> None:
        """One more step: the robot drives along the first column."""
        self.step += 1
        row = self.step % 20
        position = Position(0.5, row + 0.5, 1.57)
        state = RobotState(
            self.step, ROBOT, 'carrier', f'0,{row}', position, PowerSupply(61), order_id='o/L1#0'
        )
        self.put('warehouse.robots', FleetState(self.step, (state,)))
        report = RobotReport(ROBOT, state, time.time())
        self.put('warehouse.fleet', FleetReport(self.step, (report,)))
        self.put('warehouse.plans', Plans(self.step, (Plan(ROBOT, ((0, row), (5, row))),), 1.25))

    def is_live(self) -> bool:
        """Whether the page says so, of a robot that has driven just now."""
        self.drive()
        return self.page.locator('#live').text_content() == 'Live'

    def look(self, expression: str) -> Any:
        """What the page's own objects say."""
        return self.page.evaluate(expression)

    def values(self, topic: str, count: int) -> list[bytes]:
        """The records of a topic."""
        return [record.value() or b'' for record in self.bench.records(topic, count, 20)]
