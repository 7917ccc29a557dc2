"""Both directions at once, as a user starts them."""

from harness import Bench, to_kafka, to_ros, values

from ros2_kafka_bridge.testing.orders import encode, orders

COUNT = 50_000


def test_50000_orders_through_both_directions_arrive_once_and_in_order(
    bench: Bench, topic_name: str
) -> None:
    source = orders(seed=1)
    sent = [encode(next(source)) for _ in range(COUNT)]
    returned = f'{topic_name}.returned'
    config = bench.config(
        [
            to_ros(topic_name, '/orders', name='orders'),
            to_kafka('/orders', returned, name='orders_returned'),
        ]
    )
    bench.create_topic(topic_name)
    with bench.bridge(config) as bridge:
        bench.produce(topic_name, list(sent))
        received = values(bench.records(returned, COUNT, timeout_s=90))
        assert bridge.end() == 0
    assert len(received) == COUNT
    assert received == sent
