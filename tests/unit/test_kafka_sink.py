"""The sink on a broker inside the process."""

import logging
import time
from typing import Any

import pytest

from ros2_kafka_bridge.endpoints import Outgoing
from ros2_kafka_bridge.kafka import producer, properties
from ros2_kafka_bridge.kafka.producer import KafkaSink
from ros2_kafka_bridge.testing.embedded_broker import EmbeddedBroker

LOG = logging.LoggerAdapter(logging.getLogger('test'), {})


@pytest.mark.parametrize(('given', 'confirmed'), [({}, 1), ({'linger.ms': 60_000}, 0)])
def test_a_hurried_record_lingers_only_where_the_user_says_so(
    given: dict[str, Any], confirmed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    # So long that without being hurried no record would be delivered within this test.
    for module in (properties, producer):
        monkeypatch.setattr(module, 'LINGER_MS', 50_000)
    with EmbeddedBroker() as broker:
        config = {'bootstrap.servers': broker.bootstrap_servers, **given}
        sink: KafkaSink[str] = KafkaSink(
            properties.producer_properties(config, client_id='test'), 'topic orders', LOG
        )
        sink.open()
        assert sink.produce(Outgoing('orders', None, b'one', []), 'one')
        reports: list[str] = []
        deadline_s = time.monotonic() + (0.5 if given else 10)
        while not reports and time.monotonic() < deadline_s:
            sink.hurry()
            reports += sink.poll(0.01).confirmed
        assert len(reports) == confirmed
        sink.close()
