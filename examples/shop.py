"""A shop: sends orders to Kafka, and waits until a robot has done each of them.

It opens once a first order has come back: what was sent before the bridge reads for the first time
would go to nobody (`start: latest`).

python examples/shop.py --count 1000 --rate 100
"""

import argparse
import json
import sys
import time
import uuid
from collections.abc import Iterator
from itertools import islice

import msgspec
from confluent_kafka import Consumer, KafkaException, Producer

from ros2_kafka_bridge.testing.orders import encode, orders


def statuses(consumer: Consumer, timeout_s: float) -> Iterator[int]:
    """What robots have said: the ids of the orders that are done."""
    for record in consumer.consume(500, timeout_s):
        value = record.value()
        if record.error() is None and value is not None:
            yield json.loads(value)['order_id']


def is_answered(producer: Producer, consumer: Consumer, order_id: int, patience_s: float) -> bool:
    """Whether a first order is done, which is sent again each second until it is."""
    order = next(orders(seed=order_id))
    value = encode(msgspec.structs.replace(order, order_id=order_id))
    deadline_s = time.monotonic() + patience_s
    while time.monotonic() < deadline_s:
        producer.produce('orders', value)
        producer.flush()
        if order_id in statuses(consumer, 1.0):
            return True
    return False


def main() -> None:
    """Sell, wait, and say what came of it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--count', type=int, default=1000)
    parser.add_argument('--rate', type=float, default=100.0, help='orders per second')
    parser.add_argument('--bootstrap-servers', default='localhost:9092')
    parser.add_argument('--patience', type=float, default=30.0, help='seconds without news')
    args = parser.parse_args()

    first_id = time.time_ns()  # no order of an earlier run has it, nor of another shop
    mine = range(first_id, first_id + args.count)
    servers = {'bootstrap.servers': args.bootstrap_servers, 'log_level': 2}
    producer = Producer({**servers, 'enable.idempotence': True})
    reading = {'group.id': f'shop-{uuid.uuid4()}', 'auto.offset.reset': 'earliest'}
    consumer = Consumer({**servers, **reading})
    there = consumer.list_topics(timeout=5.0).topics  # raises where no Kafka answers
    if absent := {'orders', 'status'} - there.keys():
        sys.exit(f'Kafka has no topic {" and ".join(sorted(absent))}: make it first')
    consumer.subscribe(['status'])
    if not is_answered(producer, consumer, first_id - 1, args.patience):
        sys.exit(f'no robot has done an order in {args.patience:g} s: do bridge and robot run?')

    done: list[int] = []
    sent = 0
    started_s = last_s = time.monotonic()
    goods = orders(seed=first_id)
    while len(set(done)) < args.count and time.monotonic() - last_s < args.patience:
        due = min(args.count, int((time.monotonic() - started_s) * args.rate) + 1)
        for order in islice(goods, due - sent):
            sold = msgspec.structs.replace(order, order_id=first_id + order.order_id)
            producer.produce('orders', encode(sold))
            sent += 1
        producer.poll(0)
        if news := [i for i in statuses(consumer, 0.02) if i in mine]:
            done += news
            last_s = time.monotonic()
    producer.flush()
    consumer.close()

    missing = sent - len(set(done))
    repeated = len(done) - len(set(done))
    print(f'{sent} orders sent, {len(set(done))} done, {missing} missing, {repeated} told twice')
    sys.exit(1 if missing else 0)


if __name__ == '__main__':
    try:
        main()
    except KeyboardInterrupt:
        sys.exit('stopped before the end')
    except KafkaException as error:
        sys.exit(f'Kafka: {error.args[0].str()}; does it run, and there?')
