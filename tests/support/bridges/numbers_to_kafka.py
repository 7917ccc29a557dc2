"""Numbers from a publisher to Kafka: which of them a topic holds."""

import contextlib
import re
import time
from collections.abc import Sequence

from confluent_kafka import Consumer, KafkaException, Message, TopicPartition
from support.patience import patient
from support.processes.harness import Bench, Process, eventually, headers
from support.processes.lifetimes import Leave

LATCHED = ('--durability', 'transient_local', '--readers', '0')


def seqs(records: Sequence[Message]) -> list[int]:
    """The number of each record at its publisher, which is one and the same."""
    found = [headers(record) for record in records]
    assert len({header['ros.gid'] for header in found}) == 1
    return [int(header['ros.seq']) for header in found]


def published(publisher: Process) -> bool:
    """Whether a publisher is through."""
    return 'published' in publisher.output()


def how_many(publisher: Process) -> int:
    """How many messages a publisher that is through has published."""
    publisher.wait_for('published')
    return int(told(publisher, 'published'))


def told(peer: Process, what: str) -> str:
    """What a peer has printed behind a word; DDS may have printed lines of its own before."""
    found = re.search(rf'^{what} (\S+)$', peer.output(), re.MULTILINE)
    assert found, peer.output()
    return found[1]


def knock(bench: Bench, topic: str, leave: Leave) -> None:
    """Have a publisher that stands still publish one after the other, until one arrives.

    A publisher knows of a reader before that knows of it, and what it publishes meanwhile is
    lost; from the first one that arrives on nothing is.
    """
    before = bench.end_offset(topic)

    def answered() -> bool:
        leave.set_off(leave.out + 1)
        for _ in range(20):
            if bench.reaches(topic, before + 1):
                return True
            time.sleep(0.02)
        return False

    eventually(answered, 60)


def last(bench: Bench, topic: str) -> int:
    """The number of the last record just now, 0 where there is none; no group is joined for it."""
    config = {'bootstrap.servers': bench.bootstrap_servers, 'group.id': 'nobody'}
    with contextlib.closing(Consumer(config)) as consumer:
        try:
            _, end = consumer.get_watermark_offsets(TopicPartition(topic, 0), timeout=patient(10))
        except KafkaException:  # a node that is up again leads the topic a moment later
            return 0
        if end == 0:
            return 0
        consumer.assign([TopicPartition(topic, 0, end - 1)])
        record = consumer.poll(patient(10))
        assert record is not None
        return seqs([record])[0]
