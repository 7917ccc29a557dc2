"""Several workers while one of them, or the process above them, is killed.

The guarantees are those of docs: 1 and 2 at least once, 7 stop is a drain, 8 what SIGKILL costs.
"""

import os
import signal
from functools import partial
from pathlib import Path

from support.bridges.numbers_to_ros import SAMPLES, numbered, numbers, wait_for_all, wait_for_lines
from support.bridges.routes import to_kafka, to_ros, values
from support.bridges.workers import (
    good_and_bad,
    kill,
    pids,
    sized,
    stream,
    there_and_back,
    wait_until_gone,
)
from support.processes.harness import Bench, eventually
from support.processes.lifetimes import Leave

COUNT = 6000
LATCHED = ('--durability', 'transient_local', '--count', str(COUNT))


def test_guarantees_1_2_8_a_killed_worker_is_started_again_and_nothing_is_lost(
    bench: Bench, topic: str, tmp_path: Path
) -> None:
    """Each worker in turn, while the other goes on as the same process."""
    arrived, written = tmp_path / 'arrived', f'{topic}.written'
    to_take, to_publish = (Leave(tmp_path / peer) for peer in ('subscriber', 'publisher'))
    routes = [to_ros(topic, '/there'), to_kafka('/latched', written)]
    bench.create_topic(written)
    bench.produce(topic, numbered(COUNT))
    with (
        bench.subscriber('/there', arrived, *to_take.options, samples=SAMPLES),
        bench.publisher('/latched', *LATCHED, *to_publish.options),
        bench.drained(bench.config(routes, workers=2)) as process,
    ):
        to_take.up_to(1000)
        wait_for_lines(arrived, 500, process, timeout_s=90)
        other = kill(process, 1)
        process.wait_for('worker 1 (to_ros) was ended by SIGKILL: started again in 1 s')
        to_publish.up_to(500)
        eventually(partial(bench.reaches, written, 500), 60, process.output)
        assert pids(process, 2) == [other]

        to_publish.up_to(1000)
        eventually(partial(bench.reaches, written, 501), 60, process.output)
        other = kill(process, 2)
        process.wait_for('worker 2 (to_kafka) was ended by SIGKILL: started again in 1 s')
        to_take.up_to(2000)
        wait_for_lines(arrived, 2000, process)
        assert pids(process, 1)[-1] == other

        to_publish.up_to(COUNT)
        to_take.up_to(2 * COUNT)
        records = bench.records(written, COUNT, timeout_s=120)
        wait_for_all(arrived, COUNT, process, timeout_s=120)
    assert values(records) == numbered(COUNT), 'nothing is lost, repeated or out of order'
    assert set(numbers(arrived)) == set(range(COUNT))
    assert bench.committed(bench.group, topic) == COUNT


def test_a_route_that_failed_for_good_stays_so_when_its_worker_is_killed_right_after(
    bench: Bench, topic_name: str
) -> None:
    """The supervisor knows it before the log does, not a second later."""
    bad, _, routes = good_and_bad(bench, topic_name)
    routes.append(to_kafka('/other', f'{topic_name}.other'))
    with bench.bridge(bench.config(routes, workers=2)) as process:
        process.wait_for('good: reads', 90)
        process.wait_for('bad: reads', 90)
        bench.produce(bad, [b'\xff'])
        process.wait_for('bad: failed: ')
        os.kill(pids(process, 1)[0], signal.SIGKILL)
        process.wait_for('worker 1, runs ', 60, count=2)
        process.wait_for('good: reads', 60, count=2)
        assert process.end(40) == 1
    assert process.output().count('bad: failed: ') == 1
    assert process.output().count('bad: reads') == 1


def test_guarantee_7_when_the_supervisor_is_killed_its_workers_drain_in_order_and_end(
    bench: Bench, topic: str, returned: str
) -> None:
    config = bench.config(there_and_back(topic), workers=2, kafka=bench.patient_kafka)
    with stream(bench, topic) as records, bench.bridge(config) as process:
        eventually(partial(bench.reaches, returned, 1500), 90, process.output)
        workers = [*pids(process, 1), *pids(process, 2)]
        process.kill()
        wait_until_gone(*workers)
        committed = bench.committed(bench.group, topic)
        records.wait_beyond(committed)
        records.end()
    assert process.output().count('the supervisor has gone: draining') == 2
    assert 'ERROR   to_' not in process.output()
    assert values(bench.records(returned, committed)) == sized(committed)


def test_a_worker_that_does_not_end_is_killed_and_the_other_has_its_drain(
    bench: Bench, topic: str
) -> None:
    config = bench.config(there_and_back(topic, drain_s=1), workers=2, defaults={'drain_s': 1})
    bench.create_topic(f'{topic}.returned')
    bench.produce(topic, numbered(100))
    with bench.bridge(config) as process:
        eventually(partial(bench.reaches, f'{topic}.returned', 100), 90, process.output)
        os.kill(pids(process, 1)[0], signal.SIGSTOP)
        assert process.end(60) == 1
    assert 'worker 1 (to_ros) did not end in time and was killed' in process.output()
    assert 'to_kafka: stopped: 100 taken, 100 confirmed' in process.output()
    wait_until_gone(*pids(process, 1), *pids(process, 2))


def test_a_worker_that_is_away_when_a_stop_comes_is_not_started_again(
    bench: Bench, topic: str
) -> None:
    config = bench.config(there_and_back(topic), workers=2)
    with bench.bridge(config) as process:
        process.wait_for('subscribes to', 90)
        for times, away_s in enumerate((1, 2, 4, 8), 1):
            process.wait_for('worker 2 (to_kafka) is process', count=times)
            os.kill(pids(process, 2)[-1], signal.SIGKILL)
            process.wait_for(f'was ended by SIGKILL: started again in {away_s} s')
        process.send(signal.SIGTERM)
        assert process.wait(40) == 1
    assert len(pids(process, 2)) == 4
