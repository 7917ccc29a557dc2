"""A downstream system that reads topics of Kafka and writes down which orders have come.

It only shows how things go: what counts is read from the topics at the end.
"""

import argparse
import contextlib
from pathlib import Path
from typing import Final

from confluent_kafka import OFFSET_BEGINNING, Consumer, TopicPartition

from benchmarks.faults import orders
from benchmarks.faults.journal import ARRIVED, STRANGE, Journal

_QUIET: Final = 3


def main() -> None:
    """Read until it is ended."""
    parser = argparse.ArgumentParser()
    parser.add_argument('bootstrap_servers')
    parser.add_argument('place', type=Path, help='directory of the journals')
    parser.add_argument('topics', nargs='+')
    args = parser.parse_args()
    config: dict[str, str | int | bool] = {
        'bootstrap.servers': args.bootstrap_servers,
        'group.id': 'faults.recorder',
        'enable.auto.commit': False,
        'reconnect.backoff.max.ms': 500,
        'log_level': _QUIET,
    }
    journals = {topic: Journal(args.place / topic) for topic in args.topics}
    with contextlib.closing(Consumer(config)) as consumer:
        consumer.assign([TopicPartition(topic, 0, OFFSET_BEGINNING) for topic in args.topics])
        while True:
            for record in consumer.consume(500, 0.05):
                value = record.value()
                if record.error() is None:
                    number = orders.number_of(value or b'')
                    journal = journals[str(record.topic())]
                    journal.write(STRANGE if number is None else ARRIVED, number or 0)


main()
