"""The benchmark in its smallest form: it runs end to end, and the bridge loses nothing."""

import json
import sys
from pathlib import Path
from typing import Any

from support.processes.harness import Bench, Process

from rig.processes import direct

ROOT = Path(__file__).parents[2]
COUNT = 2_000


def test_a_small_drain_reports_every_contestant_and_the_bridge_loses_none_watched_or_not(
    bench: Bench, ros_domain: int, tmp_path: Path
) -> None:
    rounds, said = _drain(bench, ros_domain, tmp_path, 'bridge,paper,native,monitored')
    for name in ('bridge', 'monitored'):
        assert (rounds[name]['delivered'], rounds[name]['lost']) == (COUNT, 0)
        assert (rounds[name]['duplicated'], rounds[name]['out_of_order']) == (0, 0)
    assert (rounds['native']['delivered'], rounds['native']['out_of_order']) == (COUNT, 0)
    assert rounds['paper']['delivered'] + rounds['paper']['lost'] == COUNT
    for measured in rounds.values():
        assert measured['orders_per_s'] > 0
        assert measured['kafka_to_ros']['anon_mib'] > 0
        assert measured['ros_to_kafka']['anon_mib'] > 0
    for other in ('paper', 'native', 'monitored'):
        assert f'bridge / {other}' in said
        assert f'CPU time for an order, bridge / {other}' in said


def _drain(
    bench: Bench, ros_domain: int, place: Path, contestants: str
) -> tuple[dict[str, dict[str, Any]], str]:
    """What each has done, and what was printed."""
    options = {
        '--orders': str(COUNT),
        '--contestants': contestants,
        '--ros-domains': str(ros_domain),
        '--bootstrap-servers': bench.bootstrap_servers,
        '--json': str(place / 'drain.json'),
    }
    words = [word for option in options.items() for word in option]
    command = [sys.executable, '-m', 'benchmarks.drain', *words]
    environ = {'PYTHONPATH': str(ROOT), 'COLUMNS': '200'}
    # What it measures outlives it where it is killed: it ends by itself, or is asked to.
    with Process(command, place / 'drain.log', environ, begin=direct, grace_s=20) as program:
        status, said = program.wait(300), program.output()
    assert status == 0, said
    rounds = json.loads((place / 'drain.json').read_text())['rounds']
    return {one['contestant']: one for one in rounds}, said
