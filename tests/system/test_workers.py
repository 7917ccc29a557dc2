"""Several workers, and the process that a worker is, as their users meet them."""

import os
import re
import signal
import sys
import time
from functools import partial
from itertools import product
from pathlib import Path

import pytest
from confluent_kafka.admin import (  # type: ignore[attr-defined]  # public, but not in __all__
    ConsumerGroupDescription,
)
from support.bridges.routes import lines, to_kafka, to_ros, values
from support.bridges.workers import (
    Watched,
    bridge,
    gone,
    good_and_bad,
    pids,
    sized,
    stream,
    there_and_back,
    wait_until_gone,
)
from support.processes.harness import Bench, Process, eventually
from support.processes.lifetimes import Leave

from ros2_kafka_bridge.ros.fastdds_profile import Histories
from ros2_kafka_bridge.ros.node import open_node

# Two workers


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM], ids=['Ctrl-C', 'systemd'])
def test_guarantee_7_a_signal_that_reaches_every_process_in_mid_stream_is_one_drain(
    bench: Bench, topic: str, returned: str, number: signal.Signals
) -> None:
    config = bench.config(there_and_back(topic), workers=2, kafka=bench.patient_kafka)
    command = [sys.executable, '-m', 'ros2_kafka_bridge', 'run', str(config)]
    log = bench.place / 'terminal.log'
    with stream(bench, topic) as records, Process(command, log) as process:
        eventually(partial(bench.reaches, returned, 1500), 60, process.output)
        for worker in (1, 2):
            assert os.getpgid(pids(process, worker)[0]) == process.pid
        os.killpg(process.pid, number)
        assert process.wait(40) == 0, process.output()
        committed = bench.committed(bench.group, topic)
        records.wait_beyond(committed)
        records.end()
    assert 'Traceback' not in process.output()
    assert values(bench.records(returned, committed)) == sized(committed)


ALL_HAS_COME = re.compile(
    r'to_ros: waiting \(the history is full.*\n.* to_kafka: running: .* 0 in flight'
)


def test_a_second_signal_ends_all_workers_at_once(
    bench: Bench, leave: Leave, topic: str, tmp_path: Path
) -> None:
    routes = there_and_back(topic, drain_s=300, min_subscribers=2)
    config = bench.config(routes, workers=2)
    bench.create_topic(f'{topic}.returned')
    bench.produce(topic, sized(3000))
    leave.up_to(100)
    with (
        bench.subscriber('/orders', tmp_path / 'arrived', *leave.options, samples=50),
        bridge(bench, config) as process,
    ):
        # What Kafka has not confirmed, a second signal would give up.
        eventually(lambda: bool(ALL_HAS_COME.search(process.output())), 60, process.output)
        process.send(signal.SIGTERM)
        process.wait_for('stopping: draining')
        assert not gone(pids(process, 2)[0]), 'those from ROS drain last'
        process.send(signal.SIGTERM)
        assert process.wait(30) == 0, 'nothing is given up: Kafka keeps what ROS did not get'
    assert 'failed: ' not in process.output()
    wait_until_gone(*pids(process, 1), *pids(process, 2))


def test_workers_are_told_apart_in_the_graph_and_at_the_broker(
    bench: Bench, topic_name: str, ros_domain: int
) -> None:
    routes = [to_ros(topic_name, '/a', name='a'), to_ros(topic_name, '/b', name='b')]
    bench.create_topic(topic_name)
    with (
        bench.bridge(bench.config(routes, workers=2)) as process,
        open_node('watcher', ros_domain, Histories({}, {}, None)) as watcher,
    ):
        process.wait_for('reads ', 60, count=2)
        for topic, node in (
            ('/a', f'{bench.node[1:]}_worker_1'),
            ('/b', f'{bench.node[1:]}_worker_2'),
        ):
            eventually(
                lambda topic=topic, node=node: (  # type: ignore[misc]  # bound on purpose
                    [peer.node for peer in watcher.publishers(topic)] == [f'/{node}']
                ),
                20,
            )
        admin = bench.admin()  # kept: its futures fail when it goes
        groups = admin.describe_consumer_groups([f'{bench.name}.a', f'{bench.name}.b'])
        clients = {name: client_ids(future.result(60)) for name, future in groups.items()}
        assert clients == {
            f'{bench.name}.{route}': [f'{bench.name}-worker-{n}']
            for n, route in enumerate('ab', 1)
        }
        assert process.end(40) == 0


def client_ids(group: ConsumerGroupDescription) -> list[str]:
    return [member.client_id for member in group.members]


def test_workers_share_the_routes_that_are_asked_for(bench: Bench, topic: str) -> None:
    routes = [*there_and_back(topic), to_ros(topic, '/other', name='other')]
    config = bench.config(routes, workers=2)
    bench.produce(topic, sized(10))
    with bench.run(config, '--routes', 'to_ros,to_kafka') as process:
        assert len(bench.records(f'{topic}.returned', 10)) == 10
        assert process.end(40) == 0
    assert len(pids(process, 1)) == len(pids(process, 2)) == 1
    assert ' other' not in process.output()


def test_a_status_line_of_each_route_comes_once_for_all_workers(bench: Bench, topic: str) -> None:
    config = bench.config(there_and_back(topic), workers=2)
    bench.produce(topic, sized(10))
    with bench.drained(config) as process:
        process.wait_for('to_ros: running: 10 confirmed, ', timeout_s=60)
        process.wait_for('to_kafka: running: 10 confirmed, ', timeout_s=60)
    for route in ('to_ros', 'to_kafka'):
        status = [line for line in lines(process.log) if re.search(rf' {route}: .*/s, ', line)]
        assert status
        assert len(status) == len({line[:19] for line in status}), 'one at a time'


def test_a_file_that_cannot_run_is_said_and_ends_with_2(bench: Bench) -> None:
    config = bench.config(there_and_back('orders'), workers=2)
    with bench.bridge(config, ROS_SECURITY_ENABLE='true', ROS_SECURITY_STRATEGY='Enforce') as it:
        assert it.wait(60) == 2
    assert 'ROS: ' in it.output()
    assert 'started again' not in it.output()


def test_a_route_that_failed_for_good_is_not_started_again_and_the_others_go_on(
    bench: Bench, topic_name: str
) -> None:
    bad, good, routes = good_and_bad(bench, topic_name)
    bench.produce(bad, [b'fine', b'\xff'])
    with bench.bridge(bench.config(routes, workers=2)) as process:
        process.wait_for('worker 1 (bad) has ended: its routes have failed for good', 60)
        bench.produce(good, [b'fine'])
        process.wait_for('good: running: 0 confirmed, 1 only published', 60)
        assert process.output().count('worker 1 (bad) is process') == 1
        process.wait_for('bad: failed (')
        assert process.end(40) == 1
    assert len(pids(process, 2)) == 1


def test_when_all_routes_have_failed_for_good_the_bridge_ends_with_1(
    bench: Bench, topic: str
) -> None:
    routes = [
        to_ros(topic, f'/{name}', name=name, on_error='stop', min_subscribers=0)
        for name in ('a', 'b')
    ]
    bench.produce(topic, [b'\xff'])
    with bench.bridge(bench.config(routes, workers=2)) as process:
        assert process.wait(60) == 1
    assert process.output().count('failed for good') == 2


# One process


def test_what_runs_for_long_has_only_the_libraries_that_move_messages_and_keeps_its_process_id(
    bench: Bench, topic_name: str
) -> None:
    config = bench.config([to_kafka('/orders', topic_name)])
    with bench.run(config, PYTHONPROFILEIMPORTTIME='1') as process:
        process.wait_for('subscribes to', 60)
        command = Path(f'/proc/{process.pid}/cmdline').read_bytes().split(b'\0')
        assert process.end() == 0
    assert b'ros2_kafka_bridge.process.worker' in command
    *_, worker = process.output().split('imported package\n')
    imported = {line.rpartition('|')[2].strip() for line in worker.splitlines()}
    assert {'rclpy', 'confluent_kafka'} <= imported
    assert not {'typer', 'rich', 'pydantic', 'ruamel.yaml', 'fastavro'} & imported


def test_a_bridge_runs_in_any_directory_whatever_modules_lie_there(
    bench: Bench, topic: str, tmp_path: Path
) -> None:
    config = bench.config(there_and_back(topic), workers=2)
    for name in ('json', 'selectors', 'rclpy', 'ros2_kafka_bridge'):
        (tmp_path / f'{name}.py').write_text('raise RuntimeError("not this one")')
    program = str(Path(sys.executable).with_name('ros2-kafka-bridge'))
    command = ['env', f'--chdir={tmp_path}', program, 'run', config.name]
    with Process(command, bench.place / 'there.log') as process:
        process.wait_for('subscribes to', 60)
        process.wait_for('reads ', 60)
        assert process.end(40) == 0, process.output()


def test_a_signal_in_the_start_ends_the_bridge_without_a_traceback(
    bench: Bench, topic: str
) -> None:
    bench.create_topic(f'{topic}.returned')
    for workers, number in product((1, 2), (signal.SIGINT, signal.SIGTERM)):
        config = bench.config(there_and_back(topic), workers=workers)
        with bench.run(config) as process:
            eventually(partial(runs, process, workers), 60)
            process.send(number)
            assert process.wait(60) == 0, process.output()
        assert 'Traceback' not in process.output()


@pytest.mark.parametrize('workers', [1, 2])
def test_a_reload_that_is_asked_for_in_the_start_is_done_after_it(
    bench: Bench, topic: str, workers: int
) -> None:
    config = bench.config(there_and_back(topic), workers=workers)
    with bench.run(config) as process:
        eventually(partial(runs, process, workers), 60)
        process.send(signal.SIGHUP)
        process.wait_for('reloaded: nothing has changed', 60)
        process.wait_for('subscribes to', 60)
        assert process.end(40) == 0, process.output()


def runs(process: Process, workers: int) -> bool:
    module = f'ros2_kafka_bridge.process.{"worker" if workers == 1 else "supervisor"}'
    return module.encode() in Path(f'/proc/{process.pid}/cmdline').read_bytes().split(b'\0')


# Snapshots


def test_a_reader_of_snapshots_that_is_gone_or_never_reads_holds_no_worker_up(
    bench: Bench, topic: str
) -> None:
    bench.create_topic(f'{topic}.returned')
    routes = there_and_back(topic)
    with Watched(bench, bench.config(routes)) as gone_reader:
        gone_reader.stop_reading()
        bench.produce(topic, sized(1000))
        eventually(lambda: bench.reaches(f'{topic}.returned', 1000), 60)
        time.sleep(2.5)  # it finds out when it sends
        bench.produce(topic, sized(1000))
        eventually(lambda: bench.reaches(f'{topic}.returned', 2000), 60)
        assert gone_reader.end() == 0, gone_reader.log.read_text()

    with Watched(bench, bench.config(routes)) as never_reads:
        fill(never_reads.process.pid)
        bench.produce(topic, sized(1000))
        eventually(lambda: bench.reaches(f'{topic}.returned', 3000), 60)
        assert never_reads.end() == 0, never_reads.log.read_text()


def fill(pid: int) -> None:
    """Fill the pipe of a worker, by its own end."""
    eventually(lambda: b'--snapshots' in Path(f'/proc/{pid}/cmdline').read_bytes(), 10)
    argument = re.search(rb'--snapshots=(\d+)', Path(f'/proc/{pid}/cmdline').read_bytes())
    assert argument is not None
    end = os.open(f'/proc/{pid}/fd/{argument[1].decode()}', os.O_WRONLY | os.O_NONBLOCK)
    try:
        while True:
            os.write(end, b'\n' * 4096)
    except BlockingIOError:
        os.close(end)
