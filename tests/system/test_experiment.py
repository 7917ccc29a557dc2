"""The experiment in its smallest form, on a real Kafka and real DDS."""

import contextlib
import os
import signal
import sys
import uuid
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest
from support.bridges.routes import values
from support.processes.harness import Bench, Process, eventually

from benchmarks.experiment import cell
from benchmarks.experiment.__main__ import _parse, _setting
from benchmarks.experiment.parts import Place
from benchmarks.experiment.results import Cell, Counts, Experiment, Load, Setting, read
from benchmarks.experiment.traffic import PROBE
from benchmarks.topics import topics
from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.testing.orders import decode

ROOT = Path(__file__).parents[2]
ORDERS = 160


def test_the_smallest_cells_are_measured_and_reported_and_are_not_measured_again(
    bench: Bench, ros_domain: int, tmp_path: Path
) -> None:
    options = _options(bench, ros_domain, tmp_path)
    said = _run([*options, '--contestants', 'paper,bridge,keep_last,bare,recording'], tmp_path)
    experiment = read(tmp_path / 'experiment.json')
    assert {result.cell.key for result in experiment.results} == {
        '160-paper-10', '160-bridge', '160-keep_last-10', '160-bare', '160-recording'
    }  # fmt: skip
    _assert_right(experiment)
    (prediction,) = experiment.predictions
    assert (prediction.depth, prediction.low <= prediction.loss <= prediction.high) == (10, True)
    for name in ('report.html', 'report.md', 'cells.csv'):
        assert (tmp_path / name).stat().st_size, name
    assert 'report.html' in said
    cells = _written(tmp_path)
    again = _run([*options, '--contestants', 'paper,bridge'], tmp_path)
    assert '2 of 2 cells are kept' in again
    assert _written(tmp_path) == cells


@pytest.mark.parametrize(('contestant', 'depth'), [('paper', 10), ('bridge', None)])
def test_what_is_told_of_the_paper_and_of_the_bridge_is_what_their_topics_hold(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, contestant: str, depth: int | None
) -> None:
    """Read from the topics by another, at a load at which the paper's nodes begin to lose."""
    held: list[list[int]] = []

    @contextlib.contextmanager
    def read_before_they_go(servers: str, names: Sequence[str]) -> Iterator[None]:
        with topics(servers, names):
            yield
            held.extend(_order_ids(bench, name) for name in names)

    monkeypatch.setattr(cell, 'topics', read_before_they_go)
    monkeypatch.setenv('PYTHONPATH', os.pathsep.join(map(str, [ROOT, ROOT / 'src'])))
    load = Load('1000', '1,000 orders/s', 1000.0)
    place = Place(bench.bootstrap_servers, None, bench.domain, bench.place, bench.place)
    counts = cell.measure(Cell(contestant, depth, load, 2.0), place, seed=1, most=2000).counts
    produced, returned = held
    assert sorted(produced) == list(range(counts.producer)) == list(range(2000))
    assert len(set(returned)) == counts.consumer
    assert len(set(produced) - set(returned)) == counts.lost
    assert contestant == 'paper' or counts == Counts(2000, 2000, 2000, 2000, 0, 0)


def test_ctrl_c_keeps_the_cells_that_were_measured(
    bench: Bench, ros_domain: int, tmp_path: Path
) -> None:
    words = [*_options(bench, ros_domain, tmp_path), '--contestants', 'bridge,paper']
    with _program([*words, '--depths', '10,100,200'], tmp_path) as program:
        eventually(lambda: bool(_written(tmp_path)), 120, program.output)
        os.killpg(program.pid, signal.SIGINT)  # as a terminal does
        status, said = program.wait(60), program.output()
    assert status == 130, said
    assert 'Traceback' not in said
    assert 'kept' in said
    kept = read(tmp_path / 'experiment.json').results
    assert 0 < len(kept) < 4
    assert (tmp_path / 'report.html').exists()
    eventually(
        lambda: not _names(tmp_path), timeout_s=20
    )  # the bridges have sessions of their own


def test_results_of_another_seed_are_not_mixed_with_these(tmp_path: Path) -> None:
    def setting(*more: str) -> Setting:
        words = ['--out', str(tmp_path), '--bootstrap-servers', 'a:1', *more]
        return _setting(_parse(words), words)

    before = setting('--seed', '1')
    assert setting('--seed', '1') == before
    with pytest.raises(ConfigError, match='another seed: give another --out, or --again'):
        setting('--seed', '2')
    assert setting('--seed', '2', '--again').seed == 2


def _assert_right(experiment: Experiment) -> None:
    by_key = {result.cell.key: result for result in experiment.results}
    for key in ('160-bridge', '160-bare'):
        assert by_key[key].counts == Counts(ORDERS, ORDERS, ORDERS, ORDERS, 0, 0), key
    for result in experiment.results:
        counts = result.counts
        assert counts.producer == ORDERS
        assert counts.producer >= counts.kafka_ros >= counts.ros_kafka >= counts.consumer > 0
        assert not result.problems
        assert result.latency is not None
        latency = result.latency
        assert 0 < latency.fastest <= latency.median <= latency.p99 <= latency.slowest
        assert result.kafka_ros.peak_mib >= result.kafka_ros.before_mib > 0


def _order_ids(bench: Bench, topic: str) -> list[int]:
    """The orders that a topic holds, without the one that does not count."""
    found = values(bench.records(topic, bench.end_offset(topic, 0)))
    return [order_id for value in found if (order_id := decode(value).order_id) != PROBE]


def _options(bench: Bench, ros_domain: int, out: Path) -> list[str]:
    options = {
        '--loads': '160',
        '--depths': '10',
        '--seconds': '1',
        '--most-orders': str(ORDERS),
        '--ros-domains': str(ros_domain),
        '--bootstrap-servers': bench.bootstrap_servers,
        '--out': str(out),
    }
    return [word for option in options.items() for word in option]


def _names(out: Path) -> list[str]:
    """The command lines of processes that run with files of this place: the bridges do."""
    found = []
    for file in Path('/proc').glob('[0-9]*/cmdline'):
        with contextlib.suppress(OSError):
            line = file.read_bytes().replace(b'\0', b' ').decode(errors='replace')
            if str(out) in line:
                found.append(line)
    return found


def _written(out: Path) -> dict[str, int]:
    return {file.name: file.stat().st_mtime_ns for file in out.glob('cells/*.json')}


def _run(words: Sequence[str], place: Path) -> str:
    """Run it to its end; returns what it printed."""
    with _program(words, place) as program:
        status = program.wait(300)
        assert status == 0, program.output()
        return program.output()


def _program(words: Sequence[str], place: Path) -> Process:
    log = place / f'{uuid.uuid4().hex}.log'
    environ = {'COLUMNS': '200', 'PYTHONPATH': str(ROOT)}
    return Process([sys.executable, '-m', 'benchmarks.experiment', *words], log, environ)
