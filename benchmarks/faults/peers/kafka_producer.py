"""A shop that sends numbered orders to a topic of Kafka, order n to partition n % partitions."""

import time
from typing import Final

from confluent_kafka import Producer

from benchmarks.faults import orders
from benchmarks.faults.peers.sending import Commands, parser_of_sender, send

_QUIET: Final = 3
_FULL_S: Final = 0.05


class Shop:
    """Where the orders of a topic of Kafka go."""

    hostile = orders.HOSTILE

    def __init__(self, bootstrap_servers: str, topic: str, partitions: int) -> None:
        self._producer = Producer(
            {
                'bootstrap.servers': bootstrap_servers,
                'enable.idempotence': True,
                'message.timeout.ms': 0,
                'reconnect.backoff.max.ms': 500,
                'log_level': _QUIET,
            }
        )
        self._topic = topic
        self._partitions = partitions

    def send(self, number: int, kind: orders.Hostile, clock_s: int) -> None:
        """Produce an order; waits while the queue is full."""
        headers: list[tuple[str, str | bytes | None]] = [
            (f'h{place}', b'x') for place in range(kind.headers)
        ]
        headers.append((orders.NUMBER_HEADER, b'%d' % number))
        while True:
            try:
                self._producer.produce(
                    self._topic,
                    kind.make(number),
                    kind.key,
                    number % self._partitions,
                    timestamp=max(1, time.time_ns() // 1_000_000 + clock_s * 1000),
                    headers=headers,
                )
                break
            except BufferError:
                self._producer.poll(_FULL_S)

    def has_all(self) -> bool:
        """Whether Kafka has confirmed all of them."""
        self._producer.poll(0)
        return not len(self._producer)


def main() -> None:
    """Send until it is ended."""
    parser = parser_of_sender()
    parser.add_argument('--bootstrap-servers', required=True)
    parser.add_argument('--partitions', type=int, required=True)
    args = parser.parse_args()
    shop = Shop(args.bootstrap_servers, args.topic, args.partitions)
    send(shop, Commands(args.commands), args)


main()
