"""Both directions at once, as a user starts them."""

from collections.abc import Iterator
from functools import partial
from itertools import islice

from support.bridges.routes import to_kafka, to_ros, values
from support.kafka.paced import Stream
from support.processes.harness import Bench, eventually

from ros2_kafka_bridge.testing.orders import encode, orders

RATE = 2000.0
BACKLOG = 40_000


def test_guarantees_1_2_3_7_orders_both_ways_arrive_once_and_in_order_over_stops_in_mid_stream(
    bench: Bench, topic: str
) -> None:
    """Three bridges are stopped while orders go on to come; the fourth has a backlog."""
    sent: list[bytes] = []

    def to_send() -> Iterator[bytes]:
        for order in map(encode, orders(seed=1)):
            sent.append(order)
            yield order

    source, returned = to_send(), f'{topic}.returned'
    routes = [to_ros(topic, '/orders'), to_kafka('/orders', returned)]
    config = bench.config(routes, kafka=bench.patient_kafka)
    bench.create_topic(returned)
    with Stream(bench, topic, source, RATE) as stream:
        for _ in range(3):
            goal = bench.end_offset(returned) + 1000
            with bench.run(config) as bridge:
                eventually(partial(bench.reaches, returned, goal), 60, bridge.output)
                assert bridge.end() == 0, bridge.output()
            committed = bench.committed(bench.group, topic)
            assert bench.end_offset(returned) == committed
            stream.wait_beyond(committed)
        stream.end()
    bench.produce(topic, islice(source, BACKLOG))
    with bench.drained(config) as bridge:
        received = values(bench.records(returned, len(sent), timeout_s=90))
    assert received == sent
