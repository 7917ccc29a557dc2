"""The benchmark in its smallest form: it runs end to end, and the bridge loses nothing."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from harness import Bench

ROOT = Path(__file__).parents[2]
COUNT = 2_000


def test_a_small_drain_reports_every_contestant_and_the_bridge_loses_none(
    bench: Bench, ros_domain: int, tmp_path: Path
) -> None:
    rounds = _drain(bench, ros_domain, tmp_path / 'drain.json', 'paper')
    bridge, paper = rounds['bridge'], rounds['paper']
    assert (bridge['delivered'], bridge['lost']) == (COUNT, 0)
    assert (bridge['duplicated'], bridge['out_of_order']) == (0, 0)
    assert paper['delivered'] + paper['lost'] == COUNT
    for measured in (bridge, paper):
        assert measured['orders_per_s'] > 0
        assert measured['kafka_to_ros']['anon_mib'] > 0
        assert measured['ros_to_kafka']['anon_mib'] > 0


def test_a_small_drain_compares_a_bridge_that_is_watched(
    bench: Bench, ros_domain: int, tmp_path: Path
) -> None:
    rounds = _drain(bench, ros_domain, tmp_path / 'drain.json', 'monitored')
    for name in ('bridge', 'monitored'):
        assert (rounds[name]['delivered'], rounds[name]['lost']) == (COUNT, 0)
        assert (rounds[name]['duplicated'], rounds[name]['out_of_order']) == (0, 0)


def _drain(bench: Bench, ros_domain: int, file: Path, other: str) -> dict[str, dict[str, Any]]:
    options = {
        '--orders': str(COUNT),
        '--contestants': f'bridge,{other}',
        '--ros-domains': str(ros_domain),
        '--bootstrap-servers': bench.bootstrap_servers,
        '--json': str(file),
    }
    words = [word for option in options.items() for word in option]
    done = subprocess.run(
        [sys.executable, '-m', 'benchmarks.drain', *words],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert f'bridge / {other}' in done.stdout
    assert f'CPU time for an order, {other} / bridge' in done.stdout
    return {one['contestant']: one for one in json.loads(file.read_text())['rounds']}
