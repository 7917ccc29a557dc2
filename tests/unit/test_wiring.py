"""What a route is made of, by what the middleware does."""

import contextlib
import logging
from unittest.mock import MagicMock

import pytest

from ros2_kafka_bridge.config.settings import Config
from ros2_kafka_bridge.config.validation import validated
from ros2_kafka_bridge.ros.fastdds_profile import Histories
from ros2_kafka_bridge.ros.probe import Abilities
from ros2_kafka_bridge.threads.stop import Stop
from ros2_kafka_bridge.wiring import Wiring

LOG = logging.LoggerAdapter(logging.getLogger('test'), {})


@pytest.mark.parametrize(('gid', 'seq'), [(True, False), (False, True), (True, True)])
def test_a_message_without_a_number_has_no_publisher_to_compare_it_with(
    *, gid: bool, seq: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Cyclone DDS tells the one and not the other."""
    made = MagicMock()
    monkeypatch.setattr('ros2_kafka_bridge.wiring.TopicReader', made)
    monkeypatch.setattr('ros2_kafka_bridge.wiring.RosSource', MagicMock())
    monkeypatch.setattr('ros2_kafka_bridge.wiring.KafkaSink', MagicMock())
    source = {'ros': '/t', 'type': 'std_msgs/msg/String'}
    routes = [{'name': 'r', 'from': source, 'to': {'kafka': 't'}, 'format': 'cdr'}]
    kafka = {'bootstrap.servers': 'localhost:9092'}
    config = validated(Config, {'name': 'b', 'kafka': kafka, 'routes': routes})
    abilities = Abilities(bounded=True, gid=gid, seq=seq, denies=True, own=b'', by_rcl=seq)
    wiring = Wiring(config, MagicMock(), abilities, Histories({}, {'/t': 2000}), {}, MagicMock())
    with contextlib.ExitStack() as stack:
        wiring.make(config.routes[0], LOG, Stop(), stack)
    assert made.call_args.kwargs['has_gid'] is (gid and seq)
    assert made.call_args.kwargs['by_rcl'] is seq
