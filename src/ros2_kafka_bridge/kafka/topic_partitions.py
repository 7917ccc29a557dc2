"""Partitions of a topic as the client wants them, and as people read them."""

from collections.abc import Iterable, Mapping

from confluent_kafka import OFFSET_INVALID, TopicPartition


def at(topic: str, offsets: Mapping[int, int]) -> list[TopicPartition]:
    """Partitions at these offsets."""
    return [TopicPartition(topic, number, offset) for number, offset in offsets.items()]


def at_stored(topic: str, numbers: Iterable[int]) -> list[TopicPartition]:
    """Partitions at the offsets that their group has."""
    return at(topic, dict.fromkeys(numbers, OFFSET_INVALID))


def numbers_of(partitions: Iterable[TopicPartition]) -> frozenset[int]:
    """The numbers of partitions of one topic."""
    return frozenset(partition.partition for partition in partitions)


def in_words(topic: str, numbers: Iterable[int]) -> str:
    """Partitions for people: `orders[0, 2]`."""
    return f'{topic}[{", ".join(map(str, sorted(numbers)))}]'
