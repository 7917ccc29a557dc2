"""The warehouse as `make warehouse` starts it: broker, bridge, modules, robots, all at once."""

import re
import signal
import sys
import time
from contextlib import closing

from confluent_kafka import Consumer, Producer
from support.patience import patient
from support.processes.harness import Bench, Process
from support.processes.terminal import finished

from ros2_kafka_warehouse.codec import decode
from ros2_kafka_warehouse.messages.orders import OrderEvent, OrderStatus


def test_the_warehouse_delivers_whatever_comes_and_ctrl_c_ends_all_of_it(bench: Bench) -> None:
    command = [
        sys.executable, '-m', 'ros2_kafka_warehouse', 'run', '--robots=2', '--step-s=0.1',
        '--port=0', f'--logs={bench.place / "logs"}',
    ]  # fmt: skip
    with Process(command, bench.place / 'run.log', bench.environ) as run:
        run.wait_for('the warehouse is up', 120)
        [servers] = re.findall(r'broker answers at (\S+)', run.output())
        send_orders(servers)
        assert read_until_delivered(servers, 'good'), run.output()
        run.send(signal.SIGINT)
        assert run.wait(40) == 0, run.output()
        assert 'was killed' not in run.output()
        pids = [line.split()[-1] for line in run.output().splitlines() if ' is process ' in line]
        left = finished(['ps', '-o', 'pid=', '-p', ','.join(pids)])
        assert left.stdout == ''


def send_orders(servers: str) -> None:
    """One that robots can do, behind what is no text, no order, or too much for anybody."""
    tea, station = '"product": "product-001"', '"station": "packing-1"'
    too_many = f'[{{"lineId": "1", {tea}, "quantity": 1{"0" * 309}}}]'
    long_ago = '"dueTime": "0001-01-01T00:00:00"'
    values = (
        None,
        b'a\0b',
        b'{"orderId": "unreadable", "lines": 7}',
        f'{{"orderId": "too-many", {station}, "lines": {too_many}}}'.encode(),
        f'{{"orderId": "late", {station}, {long_ago}, "lines": []}}'.encode(),
        f'{{"orderId": "good", {station}, "lines": [{{"lineId": "1", {tea}}}]}}'.encode(),
    )
    producer = Producer({'bootstrap.servers': servers})
    for value in values:
        producer.produce('warehouse.orders', value, partition=0)
    assert producer.flush(patient(30)) == 0


def read_until_delivered(servers: str, order_id: str) -> bool:
    """Whether an order has been delivered, by the events in Kafka."""
    config = {
        'bootstrap.servers': servers,
        'group.id': 'test',
        'auto.offset.reset': 'earliest',
        'fetch.wait.max.ms': 50,
    }
    deadline_s = time.monotonic() + patient(90)
    with closing(Consumer(config)) as consumer:
        consumer.subscribe(['warehouse.order-events'])
        while time.monotonic() < deadline_s:
            for record in consumer.consume(100, 0.2):
                event = decode(record.value() or b'', OrderEvent)
                if (event.order_id, event.status) == (order_id, OrderStatus.DELIVERED):
                    return True
    return False
