"""What `check` says of how much may be in flight; the tests of both directions hold it true."""

from typing import Any

import pytest

from ros2_kafka_bridge.commands.check.report import window_finding
from ros2_kafka_bridge.config.settings import KafkaToRosRoute, RosToKafkaRoute
from ros2_kafka_bridge.config.validation import validated

TO_ROS = {'from': {'kafka': 'a'}, 'to': {'ros': '/a', 'type': 'std_msgs/msg/String'}}
TO_KAFKA = {'from': {'ros': '/a'}, 'to': {'kafka': 'a'}}
SPOOL = {'spool': {'path': '/spools'}}
DROPS = {'when_full': 'drop_oldest'}

SAID = {
    'to ROS': """
        ok: at most 16,777,216 bytes in flight and a batch of 500 (max_in_flight_bytes), of it 500
        messages not acknowledged (max_in_flight), then the route waits""",
    'to ROS, drops': """
        note: at most 16,777,216 bytes in flight and a batch of 500 (max_in_flight_bytes), of it
        500 messages not acknowledged and 500 waiting (max_in_flight), then the oldest that wait
        are dropped (when_full)""",
    'to Kafka': """
        ok: at most 2,000 messages in flight (max_in_flight), or 16,777,216 bytes and a batch of
        500 (max_in_flight_bytes), then the route waits""",
    'to Kafka, drops': """
        note: at most 4,000 messages in flight, 2,000 with the producer and 2,000 waiting
        (max_in_flight), or 16,777,216 bytes and a batch of 500 (max_in_flight_bytes), then the
        oldest that wait are dropped (when_full)""",
    'to Kafka, spool': """
        ok: at most 2,000 messages in flight (max_in_flight), or 16,777,216 bytes
        (max_in_flight_bytes), and a batch of 500, then the rest waits on disk (spool)""",
    'to Kafka, spool, drops': """
        note: at most 2,000 messages in flight (max_in_flight), or 16,777,216 bytes
        (max_in_flight_bytes), and a batch of 500, then the rest waits on disk (spool), and the
        oldest there are dropped where it is full (when_full)""",
}


@pytest.mark.parametrize('route', SAID)
def test_check_says_what_bounds_that_which_is_in_flight(route: str) -> None:
    given: dict[str, Any] = {'name': 'a', 'format': 'text'}
    given |= DROPS if 'drops' in route else {}
    finding = window_finding(
        validated(KafkaToRosRoute, given | TO_ROS)
        if route.startswith('to ROS')
        else validated(RosToKafkaRoute, given | TO_KAFKA | (SPOOL if 'spool' in route else {}))
    )
    assert f'{finding.level}: {finding.text}' == ' '.join(SAID[route].split())
