"""What is said of a Kafka that has ended."""

from pathlib import Path

import pytest

from ros2_kafka_bridge.testing.kafka_node import KafkaNode

FATAL = '2026-11-25 16:41:02.117 [main] ERROR kafka.Kafka$ - Exiting Kafka due to fatal exception'
CAUSE = 'org.apache.kafka.common.KafkaException: the disk is full'


@pytest.mark.parametrize(
    ('log', 'reason'),
    [
        ([FATAL, CAUSE, '\tat kafka.Kafka.main(Kafka.scala)'], f': {CAUSE}'),
        ([FATAL, 'shut down completed'], f': {FATAL}'),
        (['a file: error: No such file'], ': a file: error: No such file'),
        (['all is well'], ''),
    ],
)
def test_a_failure_says_what_led_to_it(tmp_path: Path, log: list[str], reason: str) -> None:
    node = KafkaNode(tmp_path)
    node.log_file.write_text('\n'.join(log))
    assert node.failure('Kafka ended') == f'Kafka ended, see {node.log_file}{reason}'
