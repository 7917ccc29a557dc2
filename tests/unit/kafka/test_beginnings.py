"""Where a group begins without offsets: what is passed over is said, and no error is a none."""

import logging
from collections.abc import Sequence
from typing import Any
from unittest.mock import MagicMock

import pytest
from confluent_kafka import OFFSET_INVALID, KafkaError, KafkaException

from ros2_kafka_bridge.kafka.beginnings import Beginnings
from ros2_kafka_bridge.kafka.partition import Partition

LOG = logging.LoggerAdapter(logging.getLogger('beginnings'), {})


class Answer:
    """What a client is told of a partition."""

    def __init__(self, partition: int, offset: int, error: KafkaError | None = None) -> None:
        self.partition, self.offset, self.error = partition, offset, error
        self.metadata = None


def client(
    bounds: Sequence[tuple[int, int]], committed: Sequence[int], *errors: KafkaError | None
) -> Any:
    """A client of a topic whose partitions have these bounds and committed offsets."""
    made = MagicMock()
    topic = MagicMock(error=None, partitions=dict.fromkeys(range(len(bounds))))
    made.list_topics.return_value.topics = {'t': topic}
    made.get_watermark_offsets.side_effect = lambda place, **_: bounds[place.partition]
    told = [*errors, *[None] * (len(committed) - len(errors))]
    made.committed.return_value = [
        Answer(number, offset, error)
        for number, (offset, error) in enumerate(zip(committed, told, strict=True))
    ]
    return made


def test_what_a_start_at_the_latest_passes_over_is_counted_and_said_with_the_cure(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """The offsets may have expired while the bridge was away: nothing else tells."""
    caplog.set_level(logging.INFO)
    offsets = MagicMock(topic='t')
    found = Beginnings('latest', offsets, LOG).find(
        client([(0, 5), (2, 5)], [OFFSET_INVALID] * 2), Partition(0), None
    )
    assert found.offset == 5
    offsets.commit_within.assert_called_once_with(10.0, {0: 5, 1: 5})
    [text] = caplog.messages
    assert text.startswith(
        'first start of this group: begins at the latest record, and does not read the 8 records '
        'that t holds: if it was here before, its offsets have expired'
    )
    assert '--reset-offsets' in text
    assert caplog.records[-1].levelno == logging.WARNING


@pytest.mark.parametrize(
    ('start', 'bounds'), [('earliest', (0, 8)), ('latest', (8, 8)), ('latest', (0, 0))]
)
def test_a_start_that_passes_over_nothing_warns_of_nothing(
    start: str, bounds: tuple[int, int], caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.WARNING)
    Beginnings(start, MagicMock(topic='t'), LOG).find(
        client([bounds], [OFFSET_INVALID]), Partition(0), None
    )
    assert caplog.messages == []


def test_a_partition_whose_offset_alone_is_gone_says_so_and_loses_nothing(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """As in a group by KIP-848, where that of a quiet partition expires by itself."""
    partition = Partition(0)
    found = Beginnings('latest', MagicMock(topic='t'), LOG).find(
        client([(0, 5), (0, 9)], [OFFSET_INVALID, 8]), partition, None
    )
    assert found.offset == 0
    [text] = caplog.messages
    assert text.startswith('t[0]: the group has no offset here, though it has of other partitions')
    assert 'begins with the first of 5 records' in text


def test_an_offset_that_could_not_be_told_is_none_that_is_missing() -> None:
    """It would be taken for a first start, and all before the latest record be passed over."""
    offsets = MagicMock(topic='t')
    unknown = KafkaError(KafkaError.UNSTABLE_OFFSET_COMMIT)
    with pytest.raises(KafkaException):
        Beginnings('latest', offsets, LOG).find(
            client([(0, 5)], [OFFSET_INVALID], unknown), Partition(0), None
        )
    offsets.commit_within.assert_not_called()


def test_a_topic_of_which_the_broker_tells_an_error_has_no_beginning() -> None:
    asked = client([(0, 5)], [OFFSET_INVALID])
    asked.list_topics.return_value.topics['t'].error = KafkaError(KafkaError.LEADER_NOT_AVAILABLE)
    with pytest.raises(KafkaException):
        Beginnings('latest', MagicMock(topic='t'), LOG).find(asked, Partition(0), None)
