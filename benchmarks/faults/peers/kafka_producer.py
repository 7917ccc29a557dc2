"""A shop that sends numbered orders to a topic of Kafka, order n to partition n % partitions.

It is told by a file: `hostile N` makes the next N orders hostile ones, `clock SECONDS`
puts its clock forward or back for the times of records, `enough` ends the sending.
"""

import argparse
import os
import time
from pathlib import Path
from typing import Final

from confluent_kafka import Producer

from benchmarks.faults import orders
from benchmarks.faults.journal import ACKNOWLEDGED, BEGUN, HOSTILE, SENT, Journal
from benchmarks.faults.peers.commands import Commands, Pace

_QUIET: Final = 3
_FULL_S: Final = 0.05


class Sender:
    """Sends orders and writes down which, before they are handed over."""

    def __init__(
        self, producer: Producer, topic: str, partitions: int, journal: Journal, seed: int
    ) -> None:
        self._producer = producer
        self._topic = topic
        self._partitions = partitions
        self._journal = journal
        self._make = orders.numbered(seed)
        self._kinds = orders.in_turn(orders.HOSTILE)
        self.number = 0
        self._is_told = False

    def send(self, clock_s: int, *, hostile: bool) -> None:
        """Send the next order."""
        kind = next(self._kinds) if hostile else orders.Hostile('', self._make)
        self._journal.write(HOSTILE if hostile else SENT, self.number)
        headers: list[tuple[str, str | bytes | None]] = [
            (f'h{place}', b'x') for place in range(kind.headers)
        ]
        headers.append((orders.NUMBER_HEADER, b'%d' % self.number))
        while True:
            try:
                self._producer.produce(
                    self._topic,
                    kind.make(self.number),
                    kind.key,
                    self.number % self._partitions,
                    timestamp=max(1, time.time_ns() // 1_000_000 + clock_s * 1000),
                    headers=headers,
                )
                break
            except BufferError:
                self._producer.poll(_FULL_S)
        self.number += 1

    def note_all_taken(self) -> None:
        """Write down that Kafka has confirmed all of them."""
        if not self._is_told:
            self._journal.write(ACKNOWLEDGED, self.number - 1)
            self._is_told = True


def main() -> None:
    """Send until it is ended."""
    parser = argparse.ArgumentParser()
    parser.add_argument('bootstrap_servers')
    parser.add_argument('topic')
    parser.add_argument('journal', type=Path)
    parser.add_argument('commands', type=Path)
    parser.add_argument('--partitions', type=int, required=True)
    parser.add_argument('--rate', type=float, required=True)
    parser.add_argument('--seed', type=int, default=1)
    args = parser.parse_args()
    journal = Journal(args.journal)
    journal.write(BEGUN, os.getpid())
    producer = Producer(
        {
            'bootstrap.servers': args.bootstrap_servers,
            'enable.idempotence': True,
            'message.timeout.ms': 0,
            'reconnect.backoff.max.ms': 500,
            'log_level': _QUIET,
        }
    )
    sender = Sender(producer, args.topic, args.partitions, journal, args.seed)
    _send(sender, producer, Commands(args.commands), Pace(args.rate))


def _send(sender: Sender, producer: Producer, commands: Commands, pace: Pace) -> None:
    hostile, clock_s, enough = 0, 0, False
    while True:
        pace.wait()
        for words in commands():
            hostile += int(words[1]) if words[0] == 'hostile' else 0
            clock_s = int(words[1]) if words[0] == 'clock' else clock_s
            enough = enough or words[0] == 'enough'
        producer.poll(0)
        if not enough:
            sender.send(clock_s, hostile=hostile > 0)
            hostile = max(0, hostile - 1)
        elif not len(producer):
            sender.note_all_taken()


main()
