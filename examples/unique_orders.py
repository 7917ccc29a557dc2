"""Prints the orders that came from ROS, each once, also where a bridge took over from another.

python examples/unique_orders.py --state orders.seen

What was seen is kept in a file, so that a restart of this program forgets nothing. First the
orders are worked on, then the file is written, then the offsets are committed: a crash in between
repeats a few of them, and loses none.
"""

import argparse
import sys
from pathlib import Path

from confluent_kafka import Consumer

from ros2_kafka_bridge import Deduplicator

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument('--kafka', default='localhost:9092', help='bootstrap servers')
parser.add_argument('--topic', default='orders.returned')
parser.add_argument('--state', type=Path, default=Path('orders.seen'), help='what was seen')
parser.add_argument('--idle', type=float, help='end when so many seconds bring nothing')
args = parser.parse_args()

seen = Deduplicator.from_json(args.state.read_text()) if args.state.exists() else Deduplicator()
consumer = Consumer(
    {
        'bootstrap.servers': args.kafka,
        'group.id': 'unique-orders',
        'auto.offset.reset': 'earliest',
        'enable.auto.commit': False,
    }
)
joined: list[object] = []
consumer.subscribe([args.topic], on_assign=lambda *partitions: joined.append(partitions))
try:
    while True:
        is_member = bool(joined)
        first = consumer.poll(args.idle or 1.0)
        if first is None and args.idle and is_member:
            break
        records = [] if first is None else [first, *consumer.consume(499, 0.0)]
        orders = [record for record in records if record.error() is None]
        for order in seen.without_repeats(orders):
            print((order.value() or b'').decode(), flush=True)
        if orders:
            new = args.state.with_suffix('.new')
            new.write_text(seen.to_json())
            new.replace(args.state)
            consumer.commit(asynchronous=False)
except KeyboardInterrupt:
    pass
finally:
    consumer.close()
for gid, missing in seen.gaps().items():
    print(f'missing from {gid.hex()}: {missing}', file=sys.stderr)
