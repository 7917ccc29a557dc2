"""A client of Kafka that sends numbers until a file is there; prints `ready` and `published N`."""

import argparse
import itertools
from pathlib import Path
from typing import Final

from confluent_kafka import Producer

from rig.peers.pace import paced

FLUSH_S: Final = 60.0


def main() -> None:
    """Send; what counts is confirmed."""
    parser = argparse.ArgumentParser()
    add = parser.add_argument
    add('bootstrap_servers')
    add('topic')
    add('--rate', type=float, default=0.0, help='messages/s, 0 is no limit')
    add('--size', type=int, default=0, help='pad each number to so many characters')
    add('--until', type=Path, required=True, help='send until this file is there')
    args = parser.parse_args()
    config = {'bootstrap.servers': args.bootstrap_servers, 'linger.ms': 5, 'log_level': 3}
    producer = Producer({**config, 'enable.idempotence': True})
    sent = 0
    print('ready', flush=True)
    for number in paced(itertools.count(), args.rate, until=args.until):
        _produce(producer, args.topic, f'{number}'.ljust(args.size))
        sent += 1
    print(f'published {sent - producer.flush(FLUSH_S)}', flush=True)


def _produce(producer: Producer, topic: str, value: str) -> None:
    while True:
        try:
            producer.produce(topic, value)
            break
        except BufferError:
            producer.poll(0.01)
    producer.poll(0)


if __name__ == '__main__':
    main()
