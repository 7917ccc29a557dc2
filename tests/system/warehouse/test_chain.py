"""The whole warehouse: from an order in Kafka to the robots, and back to Kafka."""

from support.processes.harness import Bench, eventually
from support.warehouse.warehouses import Warehouse, drawn_graph, running_graph

from ros2_kafka_warehouse.messages.orders import Line, OrderRequest, OrderStatus

MANY = 600


def test_orders_reach_the_robots_and_what_became_of_them_comes_back(bench: Bench) -> None:
    with Warehouse(bench) as warehouse:
        warehouse.wait_until_up()
        assert running_graph(bench, warehouse.site) == drawn_graph(warehouse.site)
        with bench.script('warehouse_looker.py', *warehouse.site.robots) as looker:
            looker.wait_for('looks')
            requests = warehouse.requests(4)
            unknown = OrderRequest('no-such-product', 0, 'packing-1', (Line('L1', 'unicorn'),))
            warehouse.send([*requests[:2], unknown, *requests])  # two of them twice
            bench.produce('warehouse.orders', [b'{"orderId": "unreadable", "lines": 7}', b'what'])
            warehouse.wait_for_ends([*requests, unknown])
            looker.wait_for('has seen all')
        warehouse.assert_each_line_was_delivered_once(requests)
        ends = warehouse.ends()
        assert {ends[request.order_id] for request in requests} == {OrderStatus.DELIVERED}
        assert ends['no-such-product'] is OrderStatus.REJECTED
        assert ends['unreadable'] is OrderStatus.REJECTED
        _assert_that_a_full_desk_leaves_orders_in_kafka(bench, warehouse)


def _assert_that_a_full_desk_leaves_orders_in_kafka(bench: Bench, warehouse: Warehouse) -> None:
    before = bench.end_offset('warehouse.orders')
    bench.produce(
        'warehouse.orders',
        [
            b'{"orderId": "many-%d", "station": "packing-1", '
            b'"lines": [{"lineId": "L1", "product": "product-001"}]}' % number
            for number in range(MANY)
        ],
    )
    log = warehouse.logs / 'orders.log'
    eventually(lambda: 'the desk is full' in log.read_text(), 60, warehouse.story)
    assert bench.committed('warehouse.orders', 'warehouse.orders') < before + MANY
