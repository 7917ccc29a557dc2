"""The experiment's own arithmetic: what is sent, what is counted, what is kept."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.experiment.cell import out_of_order
from benchmarks.experiment.grid import CONTESTANTS, DEPTHS, LOADS, cells, expected_s, orders_of
from benchmarks.experiment.results import (
    Cell,
    Counts,
    Load,
    Result,
    StartUp,
    Usage,
    forget,
    keep,
    keep_start,
    kept,
    kept_start,
)
from benchmarks.experiment.traffic import Sending, due_s, halves
from ros2_kafka_bridge.testing.orders import Order, decode

BURSTS = Load('bursts', '', 1000.0, 10_000)


def test_the_grid_has_every_depth_for_those_with_a_depth_and_one_cell_for_the_others() -> None:
    grid = cells(LOADS, CONTESTANTS, DEPTHS, 20.0)
    assert len({cell.key for cell in grid}) == len(grid) == 8 * (3 + 3 + 1 + 1 + 1)
    assert {cell.depth for cell in grid if cell.contestant == 'paper'} == {10, 100, 200}
    assert {cell.depth for cell in grid if cell.contestant == 'bridge'} == {None}


def test_the_whole_grid_is_expected_to_take_less_than_half_an_hour() -> None:
    grid = cells(LOADS, CONTESTANTS, DEPTHS, 20.0)
    assert sum(expected_s(cell, 100_000) for cell in grid) < 1800


@pytest.mark.parametrize(
    ('load', 'seconds', 'orders'),
    [
        (Load('9.6', '', 9.645), 600.0, 5787),  # the paper's first case
        (Load('160', '', 160.0), 20.0, 3200),
        (Load('0.1', '', 0.1), 1.0, 1),
        (Load('20000', '', 20_000.0), 20.0, 100_000),
        (Load('max', '', 0.0), 20.0, 100_000),
        (BURSTS, 20.0, 20_000),
        (BURSTS, 29.0, 20_000),
        (BURSTS, 5.0, 10_000),
    ],
)
def test_as_many_orders_are_sent_as_fit_into_the_time(
    load: Load, seconds: float, orders: int
) -> None:
    assert orders_of(load, seconds, 100_000) == orders


def test_bursts_are_sent_at_once_and_even_loads_one_by_one() -> None:
    bursts = Sending(1000.0, 10_000, 20_000, 1)
    assert [due_s(bursts, number) for number in (0, 9_999, 10_000, 19_999)] == [0, 0, 10, 10]
    even = Sending(100.0, 1, 1000, 1)
    assert [due_s(even, number) for number in (0, 1, 50)] == [0, 0.01, 0.5]
    assert due_s(Sending(0.0, 1, 1000, 1), 999) == 0


def test_an_order_can_be_stamped_when_it_is_sent() -> None:
    head, tail = halves(Order(7, 0, ()))
    assert decode(b'%s%d%s' % (head, 123, tail)) == Order(7, 123, ())


@pytest.mark.parametrize(
    ('ids', 'count'),
    [([], 0), ([5], 0), ([0, 1, 2], 0), ([0, 2, 1, 3], 1), ([3, 0, 1, 2], 3), ([0, 1, 1], 0)],
)
def test_orders_behind_a_higher_number_are_out_of_order(ids: list[int], count: int) -> None:
    assert out_of_order(np.array(ids, np.int64)) == count


def test_a_result_is_kept_for_its_own_cell_and_length_alone(tmp_path: Path) -> None:
    cell = Cell('bridge', None, LOADS[2], 20.0)
    counts = Counts(10, 10, 9, 9, 0, 0)
    usage = Usage(1.0, 2.0, 3.0, (0.0, 0.1), (1.0, 2.0))
    result = Result(cell, 'then', counts, 160.0, 160.0, None, usage, usage, usage)
    keep(tmp_path, result)
    found = kept(tmp_path, cell)
    assert found is not None
    assert (found.counts, found.counts.lost) == (counts, 1)
    assert list(found.kafka_ros.memory_mib) == [1.0, 2.0]
    assert kept(tmp_path, Cell('bridge', None, LOADS[2], 600.0)) is None
    assert kept(tmp_path, Cell('paper', 10, LOADS[2], 20.0)) is None


def test_how_long_a_start_takes_is_kept_for_its_own_contestant_and_depth(tmp_path: Path) -> None:
    start = StartUp('paper', 10, (2.0, 2.5))
    keep_start(tmp_path, start)
    found = kept_start(tmp_path, 'paper', 10)
    assert found is not None
    assert list(found.seconds) == [2.0, 2.5]
    assert kept_start(tmp_path, 'paper', 200) is None
    assert kept_start(tmp_path, 'bridge', None) is None
    forget(tmp_path)
    assert kept_start(tmp_path, 'paper', 10) is None


def test_a_cell_whose_file_was_cut_off_counts_as_not_measured(tmp_path: Path) -> None:
    cell = Cell('bridge', None, LOADS[2], 20.0)
    (tmp_path / 'cells').mkdir()
    (tmp_path / 'cells' / f'{cell.key}.json').write_text('{"cell": {"contes')
    assert kept(tmp_path, cell) is None
