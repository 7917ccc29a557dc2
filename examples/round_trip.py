"""Sends orders to Kafka and waits for them to come back through ROS, as bridge.yaml routes them.

python examples/round_trip.py --count 10000
"""

import argparse
import sys
import time
import uuid
from itertools import islice

from confluent_kafka import Consumer, KafkaException, Producer

from ros2_kafka_bridge.testing.orders import encode, orders


def send(servers: str, values: list[bytes]) -> None:
    """Produce the orders to the topic `orders`."""
    producer = Producer({'bootstrap.servers': servers, 'enable.idempotence': True, 'log_level': 2})
    for value in values:
        while True:
            try:
                producer.produce('orders', value)
                break
            except BufferError:  # the queue of the client is full
                producer.poll(0.1)
    producer.flush()


def receive(consumer: Consumer, sent: list[bytes], patience_s: float) -> list[bytes]:
    """Read `orders.returned` until all orders came, or none for `patience_s`; only our own."""
    own, missing = set(sent), set(sent)
    received: list[bytes] = []
    last_s = time.monotonic()
    while missing and time.monotonic() - last_s < patience_s:
        for record in consumer.consume(500, 0.1):
            value = record.value()
            if record.error() is None and value in own:
                received.append(value)
                missing.discard(value)  # a repeated one stands for no other
                last_s = time.monotonic()
    return received


def main() -> None:
    """Send, wait, and say what came back."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--count', type=int, default=1000)
    parser.add_argument('--bootstrap-servers', default='localhost:9092')
    parser.add_argument('--patience', type=float, default=20.0, help='seconds')
    args = parser.parse_args()

    sent = [encode(order) for order in islice(orders(seed=time.time_ns()), args.count)]
    consumer = Consumer(
        {
            'bootstrap.servers': args.bootstrap_servers,
            'group.id': f'round-trip-{uuid.uuid4()}',
            'auto.offset.reset': 'earliest',
            'log_level': 2,
        }
    )
    there = consumer.list_topics(timeout=5.0).topics  # raises where no Kafka answers
    if missing := {'orders', 'orders.returned'} - there.keys():
        sys.exit(f'Kafka has no topic {" and ".join(sorted(missing))}: make it first')
    consumer.subscribe(['orders.returned'])
    started_s = time.monotonic()
    send(args.bootstrap_servers, sent)
    received = receive(consumer, sent, args.patience)
    took_s = time.monotonic() - started_s
    consumer.close()

    came = dict.fromkeys(received)  # in the order in which each came first
    lost = len(sent) - len(came)
    repeated = len(received) - len(came)
    order = 'in order' if list(came) == [x for x in sent if x in came] else 'out of order'
    print(
        f'{len(sent)} orders sent, {len(received)} came back in {took_s:.1f} s: '
        f'{lost} lost, {repeated} repeated, {order}'
    )
    if not came:
        print('If no bridge runs, they wait in Kafka: start it (examples/bridge.yaml)')
    sys.exit(1 if lost else 0)


if __name__ == '__main__':
    try:
        main()
    except KeyboardInterrupt:
        sys.exit('stopped before the end')
    except KafkaException as error:
        sys.exit(f'Kafka: {error.args[0].str()}; does it run, and there?')
