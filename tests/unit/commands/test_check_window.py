"""What `check` says of how much may be in flight; the tests of both directions hold it true."""

from typing import Any

import pytest
from support.said import fits

from ros2_kafka_bridge.commands.check.report import window_to_kafka, window_to_ros
from ros2_kafka_bridge.config.settings import KafkaToRosRoute, RosToKafkaRoute
from ros2_kafka_bridge.config.validation import validated

TO_ROS = {'from': {'kafka': 'a'}, 'to': {'ros': '/a', 'type': 'std_msgs/msg/String'}}
TO_KAFKA = {'from': {'ros': '/a'}, 'to': {'kafka': 'a'}}
SPOOL = {'spool': {'path': '/spools'}}
DROPS = {'when_full': 'drop_oldest'}

# The bounds, the setting of each, and what comes then.
ALL = '16,777,216 bytes ... a batch of 500 ...'
PIECE = '16,777,216 bytes ... a batch of 50 ...'
SAID = {
    'to ROS': f'ok: {PIECE} 500 messages not acknowledged (max_in_flight) ... waits',
    'to ROS, drops': """
        note: 500 messages (max_in_flight) ... 16,777,216 bytes (max_in_flight_bytes) ...
        not acknowledged ... as many more ... a batch of 50 waiting ... oldest ... dropped
        (when_full)""",
    'to Kafka': f"""
        ok: 2,000 messages ... (max_in_flight) ... {ALL} (max_in_flight_bytes) ... waits""",
    'to Kafka, drops': """
        note: 2,000 messages (max_in_flight) ... 16,777,216 bytes (max_in_flight_bytes) ...
        with the producer ... as many more ... a batch of 500 waiting ... oldest ... dropped
        (when_full)""",
    'to Kafka, spool': f'ok: 2,000 messages ... (max_in_flight) ... {ALL} on disk (spool)',
    'to Kafka, spool, drops': f"""
        note: 2,000 messages ... (max_in_flight) ... {ALL} on disk (spool)
        ... oldest ... dropped ... (when_full)""",
}


@pytest.mark.parametrize('route', SAID)
def test_check_says_what_bounds_that_which_is_in_flight(route: str) -> None:
    given: dict[str, Any] = {'name': 'a', 'format': 'text'}
    given |= DROPS if 'drops' in route else {}
    if route.startswith('to ROS'):
        finding = window_to_ros(validated(KafkaToRosRoute, given | TO_ROS))
    else:
        given |= TO_KAFKA | (SPOOL if 'spool' in route else {})
        finding = window_to_kafka(validated(RosToKafkaRoute, given))
    level, _, words = ' '.join(SAID[route].split()).partition(': ')
    assert finding.level == level
    assert fits(finding.text, f'...{words}')
