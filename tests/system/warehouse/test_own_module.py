"""A module of one's own in the place of ours."""

import sys
import time
from pathlib import Path

from support.processes.harness import Bench, Process, eventually
from support.warehouse.warehouses import Warehouse

from ros2_kafka_warehouse.messages.monitor import OperatorCommand
from ros2_kafka_warehouse.messages.orders import Line, OrderRequest, OrderStatus

EXAMPLES = Path(__file__).parents[3] / 'examples'


def test_an_allocator_of_ones_own_serves_in_the_place_of_ours(
    own_bench: Bench, tmp_path: Path
) -> None:
    own_command = [sys.executable, str(EXAMPLES / 'greedy_allocator.py')]
    with (
        Warehouse(own_bench, '--without=task_allocator') as warehouse,
        Process(own_command, tmp_path / 'own.log', own_bench.environ) as own,
    ):
        warehouse.wait_until_up()
        assert warehouse.pids('task_allocator') == []
        requests = warehouse.requests(3)
        warehouse.send(requests)
        _all_are_delivered(warehouse, requests, own)


def test_the_driver_of_a_robot_serves_in_the_place_of_the_simulated_fleet(
    own_bench: Bench, tmp_path: Path
) -> None:
    with Warehouse(own_bench, '--without=robots', robots=1) as warehouse:
        own_command = _driver(warehouse)
        with Process(own_command, tmp_path / 'own.log', own_bench.environ) as own:
            warehouse.wait_until_up()
            # The second shows that the first has come, and that none waits for simulated robots.
            warehouse.command(OperatorCommand('old', 'pause', time_s=time.time() - 100))
            warehouse.command(OperatorCommand('new', 'acknowledge', time_s=time.time()))
            log = warehouse.logs / 'monitor.log'
            eventually(lambda: 'acknowledge' in log.read_text(), 60, warehouse.story)
            assert 'too late, is not done: pause' in log.read_text()
            requests = [_light_order(warehouse, number) for number in range(2)]
            warehouse.send(requests)
            _all_are_delivered(warehouse, requests, own)


def test_the_driver_of_a_robot_that_is_killed_on_the_move_goes_on_where_it_was(
    own_bench: Bench, tmp_path: Path
) -> None:
    with Warehouse(own_bench, '--without=robots', robots=1) as warehouse:
        command = _driver(warehouse)
        requests = [_light_order(warehouse, number) for number in range(3)]
        with Process(command, tmp_path / 'own.log', own_bench.environ) as own:
            warehouse.wait_until_up()
            warehouse.send(requests)
            eventually(lambda: OrderStatus.CARRYING in _statuses(warehouse), 120, warehouse.story)
            # So far on that ten reports ago it was where nobody can have come from.
            after = own_bench.end_offset('warehouse.robots') + 10
            eventually(lambda: own_bench.end_offset('warehouse.robots') >= after, 60)
            own.kill()
        with Process(command, tmp_path / 'own.log', own_bench.environ) as own:
            _all_are_delivered(warehouse, requests, own)


def _all_are_delivered(warehouse: Warehouse, requests: list[OrderRequest], own: Process) -> None:
    warehouse.wait_for_ends(requests)
    assert set(warehouse.ends().values()) == {OrderStatus.DELIVERED}
    warehouse.assert_each_line_was_delivered_once(requests)
    assert own.running, own.output()


def _driver(warehouse: Warehouse) -> list[str]:
    [robot] = warehouse.site.robots.values()
    return [
        sys.executable, str(EXAMPLES / 'robot_driver.py'),
        f'--serial-number={robot.serial_number}', f'--type={robot.robot_type}',
        f'--home={robot.home[0]},{robot.home[1]}', '--step-s=0.1',
    ]  # fmt: skip


def _light_order(warehouse: Warehouse, number: int) -> OrderRequest:
    light = [name for name, product in warehouse.site.products.items() if product.size == 'small']
    station = next(iter(warehouse.site.stations))
    return OrderRequest(f'O-{number}', 0, station, (Line('1', light[number]),))


def _statuses(warehouse: Warehouse) -> set[OrderStatus]:
    return {event.status for event in warehouse.events()}
