"""Both directions at once, as a user starts them."""

from functools import partial

from harness import Bench, eventually, to_kafka, to_ros, values

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
        ],
        kafka=bench.patient_kafka,
    )
    bench.create_topic(topic_name)
    with bench.bridge(config) as bridge:
        bench.produce(topic_name, list(sent))
        received = values(bench.records(returned, COUNT, timeout_s=90))
        assert bridge.end() == 0
    assert len(received) == COUNT
    assert received == sent


def test_guarantee_7_a_stop_in_mid_stream_loses_nothing_between_two_routes_of_one_bridge(
    bench: Bench, topic_name: str
) -> None:
    sent = [f'{number}'.encode().ljust(500) for number in range(COUNT)]
    returned = f'{topic_name}.returned'
    # The rate leaves time to stop in mid-stream; what is in flight is in flight all the same.
    routes = [to_ros(topic_name, '/orders', max_rate=4000), to_kafka('/orders', returned)]
    config = bench.config(routes, kafka=bench.patient_kafka)
    bench.create_topic(topic_name)
    bench.create_topic(returned)
    bench.produce(topic_name, list(sent))
    for _ in range(3):
        goal = bench.end_offset(returned) + 2000
        with bench.run(config) as bridge:
            eventually(partial(bench.reaches, returned, goal), 60, bridge.output)
            assert bridge.end() == 0, bridge.output()
    committed = bench.committed(bench.group, topic_name)
    assert 0 < committed < COUNT, 'the stops came in mid-stream'
    received = values(bench.records(returned, committed))
    assert received == sent[:committed]
