"""What is said about what can never be delivered."""

import logging

import pytest

from ros2_kafka_bridge.errors import About, DecodeError
from ros2_kafka_bridge.logs.summed import Summed
from ros2_kafka_bridge.route.rejections import Rejection


def test_a_name_in_a_schema_of_others_makes_no_endless_line(
    caplog: pytest.LogCaptureFixture,
) -> None:
    error = DecodeError(f'schema 1 does not fit: the schema has record {"n" * 500_000}')
    refused = Rejection(error, 'orders[0]@7', About())
    refused.tell('dead_letter', Summed(logging.LoggerAdapter(logging.getLogger('test'), {})))
    [said] = caplog.messages
    assert said.startswith('dead_letter: orders[0]@7: schema 1 does not fit')
    assert len(said) < 1100
    assert len(str(refused.failure())) < 1100
