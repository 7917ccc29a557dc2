"""The experiment in its smallest form, on a real Kafka and real DDS."""

import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from harness import Bench, eventually

from benchmarks.experiment.results import Counts, Experiment, read

ROOT = Path(__file__).parents[2]
ORDERS = 160


def test_the_smallest_cells_are_measured_and_reported_and_are_not_measured_again(
    bench: Bench, ros_domain: int, tmp_path: Path
) -> None:
    options = _options(bench, ros_domain, tmp_path)
    done = _run([*options, '--contestants', 'paper,bridge,keep_last,bare,recording'])
    experiment = read(tmp_path / 'experiment.json')
    assert {result.cell.key for result in experiment.results} == {
        '160-paper-10', '160-bridge', '160-keep_last-10', '160-bare', '160-recording'
    }  # fmt: skip
    _assert_right(experiment)
    (prediction,) = experiment.predictions
    assert (prediction.depth, prediction.low <= prediction.loss <= prediction.high) == (10, True)
    for name in ('report.html', 'report.md', 'cells.csv'):
        assert (tmp_path / name).stat().st_size, name
    assert 'report.html' in done.stdout
    cells = _written(tmp_path)
    again = _run([*options, '--contestants', 'paper,bridge'])
    assert '2 of 2 cells are kept' in again.stdout
    assert _written(tmp_path) == cells


def test_ctrl_c_keeps_the_cells_that_were_measured(
    bench: Bench, ros_domain: int, tmp_path: Path
) -> None:
    words = [*_options(bench, ros_domain, tmp_path), '--contestants', 'bridge,paper']
    process = _start([*words, '--depths', '10,100,200'])
    eventually(lambda: bool(_written(tmp_path)), timeout_s=120)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does
    stdout, stderr = process.communicate(timeout=60)
    assert process.returncode == 130, stdout + stderr
    assert 'Traceback' not in stdout + stderr
    assert 'kept' in stdout
    kept = read(tmp_path / 'experiment.json').results
    assert 0 < len(kept) < 4
    assert (tmp_path / 'report.html').exists()
    eventually(
        lambda: not _names(tmp_path), timeout_s=20
    )  # the bridges have sessions of their own


def test_results_of_another_seed_are_not_mixed_with_these(
    bench: Bench, ros_domain: int, tmp_path: Path
) -> None:
    words = [*_options(bench, ros_domain, tmp_path), '--contestants', 'bare']
    _run(words)
    process = _start([*words, '--seed', '2'])
    stdout, stderr = process.communicate(timeout=60)
    assert process.returncode == 1, stdout
    assert 'made with another seed: give another --out, or --again' in stderr


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


def _run(words: Sequence[str]) -> subprocess.CompletedProcess[str]:
    process = _start(words)
    stdout, stderr = process.communicate(timeout=300)
    assert process.returncode == 0, stdout + stderr
    return subprocess.CompletedProcess(words, 0, stdout, stderr)


def _start(words: Sequence[str]) -> 'subprocess.Popen[str]':
    return subprocess.Popen(
        [sys.executable, '-m', 'benchmarks.experiment', *words],
        cwd=ROOT,
        env={**os.environ, 'COLUMNS': '200'},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
