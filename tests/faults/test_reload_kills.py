"""A reload in the middle of which processes are killed.

The guarantees are those of docs: 1 and 2 at least once, 7 stop is a drain, 8 what SIGKILL costs.
"""

import os
import signal
from functools import partial
from pathlib import Path
from typing import Any

from support.bridges.numbers_to_ros import numbered
from support.bridges.reloads import REFUSED, Reloaded, reloadable
from support.bridges.routes import lines, to_kafka, to_ros, values
from support.bridges.workers import last_of, pids, wait_until_gone
from support.processes.harness import Bench, eventually

COUNT = 6000
RATE = 300.0
LATCHED = ('--durability', 'transient_local', '--count', str(COUNT))
OFF = {'listen': 'off', 'node': False}


def test_guarantees_1_2_8_workers_that_are_killed_in_a_reload_lose_nothing(
    bench: Bench, topic_name: str, tmp_path: Path
) -> None:
    """The new worker while it loads, the old one while it drains, the new one when it runs."""
    arrived, written = tmp_path / 'arrived', f'{topic_name}.written'
    forth = to_ros(topic_name, '/there', max_rate=RATE)
    back = to_kafka('/latched', written)
    bench.create_topic(topic_name, written)
    bench.produce(topic_name, numbered(COUNT))
    config = bench.config([forth, back], workers=2)
    with (
        bench.subscriber('/there', arrived),
        bench.publisher('/latched', *LATCHED, '--rate', str(RATE)),
        bench.drained(config) as process,
    ):
        eventually(lambda: len(lines(arrived)) > 300, 90, process.output)
        eventually(partial(bench.reaches, written, 300), 90, process.output)
        untouched = last_of(process, 2)
        it = Reloaded(bench, process, config, workers=2)
        it.write([{**forth, 'max_rate': RATE + 1}, back])
        it.ask()
        process.wait_for('worker 3 (to_ros) is process', 60)
        os.kill(last_of(process, 3), signal.SIGKILL)  # it loads
        process.wait_for('worker 3 (to_ros) is process', 60, count=2)
        process.wait_for('reloaded: restarted to_ros', 120)
        os.kill(last_of(process, 3), signal.SIGKILL)  # it has just begun
        process.wait_for('worker 3 (to_ros) is process', 60, count=3)
        assert last_of(process, 2) == untouched

        it.times = 1
        it.write([{**forth, 'max_rate': RATE + 2}, {**back, 'max_in_flight': 700}])
        it.ask()
        process.wait_for('worker 4 (to_kafka) is process', 60)
        os.kill(untouched, signal.SIGKILL)  # it is to drain soon
        process.wait_for('reloaded: restarted to_ros, to_kafka', 120)
        records = bench.records(written, COUNT, timeout_s=180)
        eventually(lambda: str(COUNT - 1) in lines(arrived)[-1:], 180, process.output)
    assert values(records) == numbered(COUNT), 'nothing is lost, repeated or out of order'
    assert {int(line) for line in lines(arrived)} == set(range(COUNT))
    assert bench.committed(bench.group, topic_name) == COUNT
    assert process.output().count(f'bridge {bench.name}, worker 2, runs') <= 2


def test_a_killed_check_refuses_the_reload_and_all_goes_on(bench: Bench, topic: str) -> None:
    routes = [to_ros(topic, '/a', min_subscribers=0)]
    with reloadable(bench, routes, monitoring=OFF) as (it, process):
        it.write([*routes, to_ros(topic, '/b', name='b', min_subscribers=0)])
        it.ask()
        eventually(lambda: _kill_check(process.pid), 60)
        process.wait_for(REFUSED, 60)
        assert 'worker 2' not in process.output()
        it.ask()
        process.wait_for('reloaded: started b', 60)


def _kill_check(supervisor: int) -> bool:
    for child in Path(f'/proc/{supervisor}/task/{supervisor}/children').read_text().split():
        if b'ros2_kafka_bridge.process.config_diff' in Path(f'/proc/{child}/cmdline').read_bytes():
            os.kill(int(child), signal.SIGKILL)
            return True
    return False


def test_guarantee_7_a_supervisor_that_is_killed_in_a_reload_leaves_a_drained_bridge(
    bench: Bench, topic_name: str
) -> None:
    forth, back = (
        to_ros(topic_name, '/orders', max_rate=300),
        to_kafka('/orders', f'{topic_name}.r'),
    )
    sent = numbered(20_000)
    bench.create_topic(topic_name, f'{topic_name}.r')
    bench.produce(topic_name, list(sent))
    more: dict[str, Any] = {'monitoring': OFF, 'kafka': bench.patient_kafka}
    config = bench.config([forth, back], **more)
    with bench.bridge(config) as process:
        eventually(partial(bench.reaches, f'{topic_name}.r', 300), 90, process.output)
        it = Reloaded(bench, process, config, **more)
        it.write([{**forth, 'max_rate': 301}, back])
        it.ask()
        process.wait_for('worker 2 (to_ros) is process', 60)
        process.kill()
        wait_until_gone(*pids(process, 1), *pids(process, 2))
    committed = bench.committed(bench.group, topic_name)
    assert 0 < committed < len(sent)
    assert values(bench.records(f'{topic_name}.r', committed)) == sent[:committed]
