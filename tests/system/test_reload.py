"""A configuration that is changed while the bridge runs, as its users meet it."""

import os
import resource
import signal
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from support.bridges.numbers_to_kafka import how_many
from support.bridges.numbers_to_ros import numbered
from support.bridges.reloads import (
    RATE,
    REFUSED,
    Reloaded,
    keeps_the_routes_that_stay,
    refuses_a_bad_file,
    reloadable,
)
from support.bridges.routes import to_kafka, to_ros, values
from support.bridges.workers import gone, last_of, pids, there_and_back, wait_until_gone
from support.processes.harness import Bench, eventually

COUNT = 3000
OFF = {'listen': 'off', 'node': False}


def kinds() -> list[Any]:
    return [
        pytest.param({}, id='one process'),
        pytest.param({'workers': 2}, id='workers'),
        pytest.param({'monitoring': OFF}, id='watched'),
    ]


@pytest.mark.parametrize('more', kinds()[2:])
def test_a_reload_under_load_loses_and_repeats_nothing_on_the_routes_that_stay(
    bench: Bench, topic: str, more: dict[str, Any]
) -> None:
    keeps_the_routes_that_stay(bench, topic, **more)


@pytest.mark.parametrize('more', kinds()[2:])
def test_a_bad_file_is_refused_with_every_mistake_and_all_goes_on(
    bench: Bench, topic: str, returned: str, more: dict[str, Any]
) -> None:
    refuses_a_bad_file(bench, topic, returned, **more)


@pytest.mark.parametrize('more', kinds()[:2])
def test_a_changed_route_takes_its_new_settings_and_keeps_its_place(
    bench: Bench, topic: str, returned: str, more: dict[str, Any]
) -> None:
    """Orders go there and back, while each way changes in turn, and then both at once."""
    bench.produce(topic, numbered(COUNT))
    forth, back = there_and_back(topic, max_rate=200)
    with reloadable(bench, [forth, back], kafka=bench.patient_kafka, **more) as (it, process):
        eventually(partial(bench.reaches, returned, 100), 90, process.output)
        assert it.to([{**forth, 'max_rate': 210}, back]) == 'restarted to_ros'
        goal = min(COUNT, bench.end_offset(returned) + 100)
        eventually(partial(bench.reaches, returned, goal), 60, process.output)
        both = [{**forth, 'max_rate': 500}, {**back, 'max_in_flight': 900}]
        assert it.to(both) == 'restarted to_ros, to_kafka'
        assert 'routes.to_ros.max_rate: 210.0 -> 500.0' in process.output()
        found = values(bench.records(returned, COUNT, timeout_s=120))
    assert found == numbered(COUNT), 'where both ways end in order, nothing is lost or repeated'
    wait_until_gone(*pids(process, 1), *pids(process, 2))


def test_another_name_restarts_every_route(bench: Bench, topic: str) -> None:
    routes = [to_ros(topic, '/a', min_subscribers=0), to_kafka('/b', f'{topic}.b')]
    bench.create_topic(f'{topic}.b')
    bench.produce(topic, numbered(10))
    with reloadable(bench, routes) as (it, process):
        other = f'{bench.name}-other'
        assert it.to(routes, name=other) == 'restarted to_ros, to_kafka'
        assert f'reload: name: {bench.name} -> {other}' in process.output()
        group = f'{other}.to_ros'
        eventually(lambda: bench.committed(group, topic) == 10, 60, process.output)
        assert it.to(routes) == 'restarted to_ros, to_kafka', 'and back, without the first process'


@pytest.mark.parametrize('more', kinds()[::2])
def test_a_link_that_leads_to_another_file_is_a_changed_file(
    bench: Bench, topic: str, tmp_path: Path, more: dict[str, Any]
) -> None:
    """As a ConfigMap of Kubernetes is changed, and a release."""
    link = tmp_path / 'bridge.yaml'
    first = bench.config([to_ros(topic, '/a', max_rate=10)], **more)
    link.symlink_to(first)
    with bench.drained(link) as process:
        process.wait_for('to_ros: reads', 60)
        second = bench.config([to_ros(topic, '/a', max_rate=20)], **more)
        link.unlink()
        link.symlink_to(second)
        first.unlink()
        process.send(signal.SIGHUP)
        process.wait_for('reloaded: restarted to_ros', 60)


def test_secrets_are_masked_in_what_a_reload_says(bench: Bench, topic: str) -> None:
    routes = [to_ros(topic, '/a', min_subscribers=0)]
    kafka = {'bootstrap.servers': bench.bootstrap_servers}
    with reloadable(bench, routes) as (it, process):
        secret = {**kafka, 'sasl.password': 'first-secret'}
        assert it.to(routes, kafka=secret) == 'restarted to_ros'
        secret['sasl.password'] = 'second-secret'
        assert it.to(routes, kafka=secret) == 'restarted to_ros'
    assert 'kafka.sasl.password: has changed' in process.output()
    assert 'secret' not in process.output().replace('client secret', '')


def test_what_counts_from_the_next_start_on_is_said(bench: Bench, topic: str) -> None:
    routes = [to_ros(topic, '/a', min_subscribers=0)]
    with reloadable(bench, routes, monitoring=OFF) as (it, process):
        said = it.to(routes, workers=3, monitoring={**OFF, 'listen': '127.0.0.1:1'})
        assert 'only when the bridge is started again' in said
        assert 'workers: 1 -> 3 (from the next start on)' in process.output()
        assert 'monitoring.listen: off -> 127.0.0.1:1 (from the next' in process.output()
    assert process.output().count('reads ') == 1


def test_two_hang_ups_at_once_and_one_in_a_drain_do_no_harm(bench: Bench, topic: str) -> None:
    routes = [to_ros(topic, '/a', min_subscribers=0)]
    config = bench.config(routes)
    with bench.bridge(config) as process:
        process.wait_for('reads ', 60)
        it = Reloaded(bench, process, config)
        it.write([*routes, to_ros(topic, '/b', name='b', min_subscribers=0)])
        it.ask()
        it.ask()
        process.wait_for('b: reads', 60)
        process.send(signal.SIGTERM)
        it.ask()
        assert process.wait(40) == 0, process.output()
    assert process.output().count('started b') == 1


def test_a_stop_in_the_middle_of_a_reload_is_a_drain(
    bench: Bench, topic: str, returned: str
) -> None:
    # So slow that there is much left, however long it takes to come to the stop.
    forth, back = there_and_back(topic, max_rate=60)
    bench.produce(topic, numbered(COUNT))
    with reloadable(bench, [forth, back], kafka=bench.patient_kafka) as (it, process):
        eventually(partial(bench.reaches, returned, 100), 90, process.output)
        it.write([{**forth, 'max_rate': 61}, back])
        it.ask()
        process.wait_for('is process', 60)
    committed = bench.committed(bench.group, topic)
    assert 0 < committed < COUNT
    assert values(bench.records(returned, committed)) == numbered(COUNT)[:committed]
    wait_until_gone(*pids(process, 1))


def test_a_reload_that_the_system_has_no_room_for_is_refused_and_the_next_one_is_done(
    bench: Bench, topic: str
) -> None:
    routes = [to_ros(topic, '/a', min_subscribers=0)]
    config = bench.config(routes)
    with bench.drained(config) as process:
        process.wait_for('to_ros: running', 60)
        used = {int(entry.name) for entry in Path(f'/proc/{process.pid}/fd').iterdir()}
        free = next(number for number in range(len(used) + 1) if number not in used)
        before = resource.prlimit(process.pid, resource.RLIMIT_NOFILE)
        it = Reloaded(bench, process, config)
        added = to_ros(topic, '/b', name='b', min_subscribers=0)
        it.write([*routes, added])
        resource.prlimit(process.pid, resource.RLIMIT_NOFILE, (free, before[1]))
        it.ask()
        process.wait_for(f'reload: Too many open files: {REFUSED}', 60)
        resource.prlimit(process.pid, resource.RLIMIT_NOFILE, before)
        assert it.to([*routes, added]) == 'started b'
    assert 'Traceback' not in process.output()


def test_a_killed_first_process_leaves_none_of_the_workers_behind(
    bench: Bench, topic: str
) -> None:
    routes = [to_ros(topic, '/a', min_subscribers=0)]
    config = bench.config(routes)
    with bench.bridge(config) as process:
        process.wait_for('reads ', 60)
        it = Reloaded(bench, process, config)
        it.to([*routes, to_ros(topic, '/b', name='b', min_subscribers=0)])
        process.wait_for('b: reads', 60)
        (worker,) = pids(process, 1)
        assert not gone(worker)
        process.kill()
        wait_until_gone(worker)
    assert 'the supervisor has gone: draining' in process.output()


def test_an_exclusive_route_and_its_spool_go_from_the_old_process_to_the_new(
    bench: Bench, topic: str, tmp_path: Path
) -> None:
    route = to_kafka('/numbers', topic, exclusive=True, spool={'path': str(tmp_path / 's')})
    latched = ('--durability', 'transient_local', '--readers', '0', '--count', str(COUNT))
    config = bench.config([route])
    with (
        bench.publisher('/numbers', *latched, '--rate', RATE),
        bench.drained(config) as process,
    ):
        eventually(partial(bench.reaches, topic, 100), 90, process.output)
        it = Reloaded(bench, process, config)
        for number in (900, 901):
            assert it.to([{**route, 'max_in_flight': number}]) == 'restarted to_kafka'
            goal = min(COUNT, bench.end_offset(topic) + 100)
            eventually(partial(bench.reaches, topic, goal), 90, process.output)
        records = bench.records(topic, COUNT, timeout_s=120)
    assert values(records) == numbered(COUNT)
    assert 'ERROR' not in process.output()


def test_what_a_volatile_publisher_sends_in_a_hand_over_may_be_missing_but_nothing_comes_twice(
    bench: Bench, topic: str, tmp_path: Path
) -> None:
    """The limit that docs/reload.md states."""
    until = tmp_path / 'until'
    route = to_kafka('/numbers', topic)
    config = bench.config([route])
    with (
        bench.drained(config) as process,
        bench.publisher('/numbers', '--until', str(until), '--rate', RATE) as publisher,
    ):
        eventually(partial(bench.reaches, topic, 300), 90, process.output)
        it = Reloaded(bench, process, config)
        for number in (900, 901):
            assert it.to([{**route, 'max_in_flight': number}]) == 'restarted to_kafka'
            goal = bench.end_offset(topic) + 300
            eventually(partial(bench.reaches, topic, goal), 60, process.output)
        until.touch()
        publisher.wait_for('published ', 60)
        count = how_many(publisher)
        eventually(lambda: last(bench, topic) == count - 1, 60, process.output)
        records = bench.records(topic, bench.end_offset(topic))
        found = [int(value) for value in values(records)]
    missing = count - len(found)
    print(f'at {RATE} messages/s {missing} are missing')  # noqa: T201 (for the docs)
    assert found == sorted(set(found)), 'in order, nothing twice'
    assert len(found) > count / 2


def last(bench: Bench, topic: str) -> int:
    return int(values(bench.records(topic, bench.end_offset(topic)))[-1])


def test_the_worker_of_a_removed_route_ends(bench: Bench, topic: str) -> None:
    routes = [to_ros(topic, f'/{n}', name=n, min_subscribers=0) for n in ('a', 'b')]
    with reloadable(bench, routes, workers=2) as (it, process):
        process.wait_for('reads ', 60, count=2)
        assert it.to(routes[:1]) == 'ended b'
        wait_until_gone(last_of(process, 2))
        os.kill(last_of(process, 1), 0)
