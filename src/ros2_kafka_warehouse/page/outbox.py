"""Kafka out: orders and commands, each confirmed before the browser hears that it was sent."""

import asyncio
import contextlib
import time
from typing import Any, Final

from confluent_kafka import KafkaError, Message, Producer

from ros2_kafka_warehouse.codec import encode
from ros2_kafka_warehouse.messages.monitor import OperatorCommand
from ros2_kafka_warehouse.messages.orders import OrderRequest

ORDERS: Final = 'warehouse.orders'
COMMANDS: Final = 'warehouse.commands'

_PATIENCE_MS = 5000


class NotSent(Exception):  # noqa: N818 (what happened, not a fault of the program)
    """Kafka did not confirm the record in time."""


class Outbox:
    """Produces to `warehouse.orders` and `warehouse.commands`.

    Args:
        bootstrap_servers: Of Kafka.

    Attributes:
        worked_s: When it last served delivery reports, by the monotonic clock.
    """

    def __init__(self, bootstrap_servers: str) -> None:
        self.worked_s = time.monotonic()
        self._producer = Producer(
            {
                'bootstrap.servers': bootstrap_servers,
                'enable.idempotence': True,
                'message.timeout.ms': _PATIENCE_MS,
                'reconnect.backoff.max.ms': 1000,
                'log_level': 0,
            }
        )

    async def send_order(self, request: OrderRequest) -> None:
        """Send an order.

        Raises:
            NotSent: Kafka did not confirm it.
        """
        await self._send(ORDERS, request.order_id, encode(request))

    async def send_command(self, command: OperatorCommand) -> None:
        """Send a command.

        Raises:
            NotSent: Kafka did not confirm it.
        """
        # One key: commands keep their order among themselves.
        await self._send(COMMANDS, 'page', encode(command))

    async def serve(self) -> None:
        """Serve delivery reports; runs as long as the page does."""
        while True:
            self.worked_s = time.monotonic()
            await asyncio.to_thread(self._producer.poll, 0.2)

    async def _send(self, topic: str, key: str, value: str) -> None:
        loop = asyncio.get_running_loop()
        sent: asyncio.Future[None] = loop.create_future()

        def settle(error: KafkaError | None) -> None:
            if sent.done():
                return
            if error is None:
                sent.set_result(None)
            else:
                sent.set_exception(NotSent(error.str()))

        def on_delivery(error: KafkaError | None, _record: Message) -> None:
            with contextlib.suppress(RuntimeError):  # the loop has ended: nobody waits
                loop.call_soon_threadsafe(settle, error)

        delivery: Any = on_delivery
        try:
            self._producer.produce(topic, value, key, on_delivery=delivery)
        except BufferError as error:
            raise NotSent('too much waits to be sent') from error
        await sent
