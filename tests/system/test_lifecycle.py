"""A bridge that is watched: who runs, how it is paused, and the steps of its lifecycle."""

import json
import os
import re
import signal
import socket
import urllib.request
from functools import partial
from pathlib import Path
from typing import Any

from support.bridges.numbers_to_ros import numbered
from support.bridges.reloads import Reloaded, request
from support.bridges.routes import to_kafka, to_ros, values
from support.bridges.workers import gone, pids, there_and_back, wait_until_gone
from support.processes.harness import Bench, Process, eventually

from ros2_kafka_bridge.protocol.monitor import Do

OFF = {'listen': 'off', 'node': False}


def monitors(process: Process) -> list[int]:
    return [int(pid) for pid in re.findall(r'the monitor is process (\d+)', process.output())]


def free_port() -> int:
    with socket.socket() as one:
        one.bind(('127.0.0.1', 0))
        return int(one.getsockname()[1])


def test_a_watched_bridge_has_one_worker_for_both_ways_which_drains_in_order(
    bench: Bench, topic: str, returned: str
) -> None:
    sent = numbered(5000)
    routes = there_and_back(topic, max_rate=500)
    config = bench.config(routes, monitoring=OFF, kafka=bench.patient_kafka)
    bench.produce(topic, list(sent))
    with bench.drained(config) as process:
        eventually(partial(bench.reaches, returned, 500), 90, process.output)
        (worker,) = pids(process, 1)
        (monitor,) = monitors(process)
    committed = bench.committed(bench.group, topic)
    assert 0 < committed < len(sent)
    assert values(bench.records(returned, committed)) == sent[:committed]
    wait_until_gone(worker, monitor)


def test_a_killed_monitor_is_started_again_and_the_routes_never_notice(
    bench: Bench, topic: str, returned: str
) -> None:
    config = bench.config(there_and_back(topic), monitoring=OFF)
    with bench.bridge(config) as process:
        process.wait_for('reads ', 60)
        process.wait_for('subscribes to', 60)
        for times in range(1, 4):
            os.kill(monitors(process)[-1], signal.SIGKILL)
            bench.produce(topic, numbered(100 * times)[100 * (times - 1) :])
            eventually(partial(bench.reaches, returned, 100 * times), 60, process.output)
            process.wait_for('the monitor is process', 60, count=times + 1)
        assert process.end(40) == 0, process.output()
        wait_until_gone(*monitors(process))
    assert len(pids(process, 1)) == 1
    assert values(bench.records(returned, 300)) == numbered(300)


def test_a_killed_supervisor_leaves_neither_workers_nor_monitor_behind(
    bench: Bench, topic: str
) -> None:
    config = bench.config(there_and_back(topic), monitoring=OFF)
    with bench.bridge(config) as process:
        process.wait_for('subscribes to', 60)
        process.kill()
        wait_until_gone(*pids(process, 1), *monitors(process))
    assert 'the supervisor has gone: draining' in process.output()


def test_a_port_in_use_or_an_address_of_nobody_ends_with_2_before_anything_starts(
    bench: Bench, topic_name: str
) -> None:
    with socket.create_server(('127.0.0.1', 0)) as other:
        port = other.getsockname()[1]
        for listen, said in (
            (f'127.0.0.1:{port}', f'port {port} is in use'),
            ('192.0.2.1:9464', 'this machine has no such address'),
            ('no.such.host.invalid:9464', 'no such host'),
        ):
            config = bench.config(there_and_back(topic_name), monitoring={'listen': listen})
            status, _, error = bench.command('run', str(config), timeout_s=60)
            assert status == 2
            assert f'monitoring.listen: {listen}: ' in error
            assert said in error
            assert 'is process' not in error


def test_a_paused_route_stays_paused_when_its_worker_is_killed_and_over_a_reload(
    bench: Bench, topic: str
) -> None:
    routes = [to_ros(topic, '/a', min_subscribers=0), to_kafka('/b', f'{topic}.b')]
    config = bench.config(routes, monitoring=OFF)
    bench.create_topic(f'{topic}.b')
    bench.produce(topic, numbered(10))
    with bench.drained(config) as process:
        eventually(lambda: bench.committed(bench.group, topic) == 10, 90, process.output)
        request(process, Do.PAUSE, 'to_ros')
        process.wait_for('to_ros: paused by an operator', 20)
        os.kill(pids(process, 1)[0], signal.SIGKILL)
        process.wait_for('worker 1 (to_ros, to_kafka) is process', 60, count=2)
        process.wait_for('to_ros: paused (paused by an operator): ', 60)
        it = Reloaded(bench, process, config, monitoring=OFF)
        changed = {**routes[0], 'max_rate': 100}
        assert it.to([changed, routes[1]]) == 'restarted to_ros'
        bench.produce(topic, numbered(20)[10:])
        said = process.output().count('to_ros: paused (paused by an operator): ')
        process.wait_for('to_ros: paused (paused by an operator): ', 60, count=said + 2)
        assert bench.committed(bench.group, topic) == 10
        request(process, Do.RESUME, 'to_ros')
        eventually(lambda: bench.committed(bench.group, topic) == 20, 60, process.output)


def test_deactivate_drains_all_routes_and_activate_goes_on_without_a_loss(
    bench: Bench, topic: str, returned: str
) -> None:
    sent = numbered(6000)
    routes = there_and_back(topic, max_rate=300)
    bench.produce(topic, list(sent))
    config = bench.config(routes, monitoring=OFF, workers=2, kafka=bench.patient_kafka)
    with bench.drained(config) as process:
        for times in (1, 2):
            goal = bench.end_offset(returned) + 300
            eventually(partial(bench.reaches, returned, goal), 90, process.output)
            request(process, Do.ACTIVATE)
            process.wait_for('activate is possible where the bridge is inactive', 20, count=times)
            request(process, Do.DEACTIVATE)
            process.wait_for('deactivate: inactive: the routes were drained', 60, count=times)
            assert gone(pids(process, 1)[-1])
            assert gone(pids(process, 2)[-1])
            committed = bench.committed(bench.group, topic)
            assert committed == bench.end_offset(returned) < len(sent)
            request(process, Do.ACTIVATE)
        records = bench.records(returned, len(sent), timeout_s=120)
    assert values(records) == sent


def test_an_unconfigured_bridge_waits_and_reads_its_file_when_it_is_configured(
    bench: Bench, topic: str
) -> None:
    more: dict[str, Any] = {'monitoring': {**OFF, 'start': 'unconfigured'}}
    config = bench.config([to_ros(topic, '/a', min_subscribers=0)], **more)
    with bench.bridge(config) as process:
        process.wait_for('the monitor is process', 60)
        right = config.read_bytes()
        config.write_text('name: [')
        request(process, Do.CONFIGURE)
        process.wait_for('configure: ', 60)
        process.wait_for('refused: all goes on as it was', 60)
        config.write_bytes(right.replace(b'name: to_ros', b'name: new'))
        request(process, Do.CONFIGURE)
        process.wait_for('configure: configured', 60)
        assert pids(process, 1) == []
        request(process, Do.ACTIVATE)
        process.wait_for('new: reads ', 60)
        request(process, Do.DEACTIVATE)
        request(process, Do.CLEANUP)
        process.wait_for('cleanup: unconfigured', 60)
        request(process, Do.SHUTDOWN)
        assert process.wait(40) == 0, process.output()
    wait_until_gone(*pids(process, 1), *monitors(process))


def test_the_address_answers_while_the_bridge_runs_and_is_free_after_it(
    bench: Bench, topic: str
) -> None:
    port = free_port()
    routes = [to_ros(topic, '/a', min_subscribers=0)]
    config = bench.config(routes, monitoring={'listen': f'127.0.0.1:{port}', 'node': False})

    def state() -> dict[str, Any]:
        with urllib.request.urlopen(f'http://127.0.0.1:{port}/api/state', timeout=60) as answer:
            found: dict[str, Any] = json.load(answer)
            return found

    with bench.drained(config) as process:
        process.wait_for('reads ', 60)
        assert json.dumps(state())
        os.kill(monitors(process)[0], signal.SIGKILL)
        assert state(), 'whoever asks meanwhile waits at the socket'
    with socket.create_server(('127.0.0.1', port)):
        pass
    assert Path(f'/proc/{process.pid}').exists() is False
