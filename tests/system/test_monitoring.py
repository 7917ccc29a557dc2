"""Metrics and health of a real bridge under load, and in each kind of trouble."""

import json
import os
import signal
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Final

import httpx
import pytest
from prometheus_client.openmetrics.parser import text_string_to_metric_families as openmetrics
from prometheus_client.parser import text_string_to_metric_families as prometheus
from support.bridges.routes import to_kafka, to_ros
from support.bridges.workers import pids
from support.kafka.shared import SharedKafka
from support.monitoring.monitors import TOKEN, Stage
from support.monitoring.scrapes import PREFIX, ROUTES, Watched, settings, under_load, watched
from support.processes.harness import Bench, eventually

from ros2_kafka_bridge.errors import TransportError
from ros2_kafka_bridge.kafka.overview import Overview
from ros2_kafka_bridge.testing.local_kafka import LocalKafka, free_port

Unique = Callable[[str], str]
OPENMETRICS: Final = 'application/openmetrics-text; version=1.0.0'


@pytest.fixture
def loaded(bench: Bench, unique: Unique) -> Iterator[Watched]:
    with under_load(bench, unique) as bridge:
        yield bridge


def test_metrics_are_told_in_both_formats_and_compressed(loaded: Watched) -> None:
    answer = loaded.get('metrics', accept=OPENMETRICS)
    assert answer.headers['content-type'].startswith('application/openmetrics-text')
    assert answer.text.endswith('# EOF\n')
    names = {family.name for family in openmetrics(answer.text)}  # type: ignore[no-untyped-call]
    assert f'{PREFIX}messages_taken' in names
    packed = loaded.get('metrics', **{'accept-encoding': 'gzip'})
    assert packed.headers['content-encoding'] == 'gzip'
    assert list(prometheus(packed.text))


def test_a_killed_worker_makes_it_not_ready_until_it_is_back(loaded: Watched) -> None:
    number = loaded.get('api/state').json()['workers'][0]['number']
    for starts in (1, 2, 3):  # each time it is away for longer, at last for 4 s
        loaded.process.wait_for(f'worker {number} (to_ros) is process', count=starts)
        os.kill(pids(loaded.process, number)[-1], signal.SIGKILL)
    told = loaded.becomes('readyz', 503, f'worker {number} is away')
    assert '[-]route/to_ros failed' in told
    assert loaded.status('livez') == 200
    loaded.becomes('readyz', 200)
    assert loaded.scrape().of('worker_starts_total', worker=str(number)) == 4


def test_a_paused_route_is_ready_and_says_that_it_is_paused(loaded: Watched) -> None:
    refused = httpx.post(f'{loaded.url}api/routes/to_ros/pause', json={})
    assert refused.status_code == 401
    answer = loaded.post('api/routes/to_ros/pause')
    assert answer.status_code == 200, answer.text
    told = loaded.becomes('readyz?verbose', 200, 'route/to_ros ok: paused')
    assert '[+]route/to_kafka ok: running' in told
    eventually(lambda: loaded.route('to_ros')['state'] == 'paused', 30)
    assert loaded.post('api/routes/to_ros/resume').status_code == 200
    loaded.becomes('readyz?verbose', 200, 'route/to_ros ok: running')
    assert loaded.post('api/routes/nobody/pause').status_code == 404


def test_a_bridge_that_waits_for_its_manager_says_so_of_each_route(
    bench: Bench, unique: Unique
) -> None:
    topic, port = unique('orders'), free_port()
    bench.create_topic(topic)
    monitoring = settings(port, start='unconfigured')
    config = bench.config([to_ros(topic, '/orders')], monitoring=monitoring)
    with bench.drained(config) as process:
        bridge = Watched(process, port, config)
        told = bridge.becomes('readyz', 503, 'it is unconfigured')
        assert '[-]route/to_ros failed: stopped: the bridge is unconfigured\n' in told
        assert 'worker' not in told
        scrape = bridge.scrape()
        assert scrape.of('lifecycle_state', state='unconfigured') == 1
        assert scrape.of('lifecycle_state') == 1


def test_the_command_line_says_whether_it_is_ready(loaded: Watched, bench: Bench) -> None:
    config = str(loaded.config)
    status, out, err = bench.command('status', config)
    assert (status, err) == (0, '')
    assert f'{bench.name}: ready, active' in out
    assert 'to_kafka' in out
    status, out, _ = bench.command('status', config, '--json')
    assert status == 0
    assert {it['name'] for it in json.loads(out)['routes']} == set(ROUTES)
    loaded.config.write_text(f'{loaded.config.read_text()}nonsense: [')
    for words in (
        ['status', config],
        ['run', config, '--status'],
        ['status', '--address', f'localhost:{httpx.URL(loaded.url).port}'],
    ):
        status, out, _ = bench.command(*words)
        assert (status, f'{bench.name}: ready, active' in out) == (0, True)


@pytest.mark.kills_kafka
def test_a_broker_that_is_away_is_told_and_is_no_reason_to_restart(
    own_bench: Bench, own_kafka: LocalKafka, unique: Unique
) -> None:
    topic = unique('orders')
    own_bench.create_topic(topic)
    bridge = watched(own_bench, [to_kafka('/status', topic)])
    with (
        own_bench.publisher('/status', '--rate', '50'),
        bridge.process,
    ):
        eventually(lambda: bool(bridge.status('readyz')), 180, bridge.process.output)
        eventually(lambda: (bridge.route('to_kafka')['rate'] or 0) > 0, 180, bridge.process.output)
        own_kafka.kill()
        bridge.becomes('readyz?verbose', 200, 'waiting: Kafka is away')
        assert bridge.status('livez') == 200
        eventually(lambda: bool(bridge.broker_problem), 180)
        assert bridge.route('to_kafka')['advice']
        own_kafka.start()
        bridge.becomes('readyz?verbose', 200, 'ok: running')
        eventually(lambda: not bridge.broker_problem, 180)
        assert bridge.process.end(60) == 0


def test_a_route_that_has_failed_makes_it_not_ready_with_the_reason(
    bench: Bench, unique: Unique
) -> None:
    orders, lost = unique('orders'), unique('lost')
    bench.create_topic(orders, lost)
    stopping = to_ros(lost, '/lost', name='stopping', on_error='stop', min_subscribers=0)
    bridge = watched(bench, [to_ros(orders, '/orders', min_subscribers=0), stopping])
    with bridge.process:
        bridge.becomes('readyz', 200)
        bench.produce(lost, [b'\xff\xfe'])
        told = bridge.becomes('readyz', 503, '[-]route/stopping failed: failed: ')
        assert '[+]route/to_ros ok: running' in told
        assert bridge.status('livez') == 200
        problems = bridge.get('readyz', accept='application/json').json()
        assert problems['ok'] is False
        status, out, _ = bench.command('status', str(bridge.config))
        assert (status, 'not ready' in out) == (1, True)
        [trouble, *_] = bridge.get('api/state').json()['troubles']
        assert trouble['route'] == 'stopping'
        assert bridge.scrape().of('route_state', route='stopping', state='failed') == 1
        bridge.process.end(60)


def test_a_look_at_a_cluster_tells_the_topics_asked_for_and_creates_none(
    kafka: SharedKafka, bench: Bench, unique: Unique
) -> None:
    there, missing = unique('there'), unique('missing')
    bench.create_topic(there, partitions=3)
    properties = {'bootstrap.servers': kafka.bootstrap_servers}
    overview = Overview(properties)
    for _ in range(3):
        seen = overview.look([there, missing, there])
    assert list(seen.brokers.values()) == [kafka.bootstrap_servers]
    assert seen.controller in seen.brokers
    assert seen.cluster_id
    found = {topic.name: topic for topic in seen.topics}
    assert list(found) == sorted([there, missing])
    assert found[there] == (there, 3, '', 0, 0, True)
    assert 'it is not there' in found[missing].problem
    assert found[missing].is_there is False
    assert overview.look([]).topics == []
    known = {topic.name for topic in overview.topics()}
    assert there in known
    assert missing not in known


def test_a_look_at_a_cluster_that_is_away_says_why() -> None:
    nobody = f'127.0.0.1:{free_port()}'
    with pytest.raises(TransportError, match='refused'):
        Overview({'bootstrap.servers': nobody}).look(['orders'])


def test_a_bridge_that_does_not_answer_is_said_to_be_away(bench: Bench, unique: Unique) -> None:
    routes = [to_ros(unique('orders'), '/orders')]
    config = bench.config(routes, monitoring=settings(free_port()))
    status, _, err = bench.command('status', str(config))
    assert status == 2
    assert 'does not answer' in err
    status, _, err = bench.command('status', str(bench.config(routes)))
    assert status == 2
    assert 'monitoring: {listen: 127.0.0.1:9464}' in err


def test_a_probe_is_answered_however_many_ask_for_nothing(tmp_path: Path, ros_domain: int) -> None:
    assert ros_domain
    with Stage(tmp_path, 1) as stage, ExitStack() as idle:
        for _ in range(12):
            for _ in range(50):
                place = ('127.0.0.1', stage.monitor.port)
                idle.enter_context(socket.create_connection(place, timeout=30))
            assert stage.monitor.get('livez').status_code == 200
        log = stage.monitor.log.read_text()
    said = log.count('500 connections at once: one of the client that has most is let go')
    assert 0 < said < 10, log


def _asked(path: str, *more: str) -> bytes:
    method = 'POST' if more else 'GET'
    lines = [f'{method} /{path} HTTP/1.1', 'host: localhost', *more, '', '']
    return '\r\n'.join(lines).encode()


WRONG: Final = _asked(
    'api/token', 'authorization: Bearer no', 'content-type: application/json', 'content-length: 2'
)


@pytest.mark.parametrize(
    'said',
    [b'', WRONG + b'{}', _asked('api/events'), _asked('metrics'), _asked('metrics?name[]=x')],
    ids=['idle', 'wrong tokens', 'streams', 'slow readers', 'names'],
)
def test_the_operator_and_probes_get_in_whoever_else_asks(
    tmp_path: Path, ros_domain: int, said: bytes
) -> None:
    assert ros_domain
    with Stage(tmp_path, 30) as stage, ExitStack() as others:
        monitor, place = stage.monitor, ('127.0.0.1', stage.monitor.port)
        said = said.replace(b'localhost', f'localhost:{monitor.port}'.encode())
        shown = {'authorization': f'Bearer {TOKEN}'}
        looking = others.enter_context(
            httpx.stream('GET', f'{monitor.url}api/events', headers=shown, timeout=30)
        )
        told = looking.iter_lines()
        assert next(told) == 'retry: 1000'
        for _ in range(550):  # none of them takes what it is answered
            stranger = others.enter_context(socket.create_connection(place, timeout=30))
            stranger.sendall(said)
        since_s = time.time()
        for _ in range(3):
            assert monitor.get('livez').status_code == 200
            assert monitor.get('api/state').status_code == 200
            assert monitor.post('api/token').status_code == 200
            with httpx.stream('GET', f'{monitor.url}api/events', timeout=30) as newest:
                assert next(newest.iter_lines()) == 'retry: 1000'
        views = (json.loads(it.removeprefix('data: ')) for it in told if it.startswith('data: '))
        assert any(it.get('bridge', {}).get('now_s', 0) > since_s + 1 for it in views)
        resident = Path(f'/proc/{monitor.process.pid}/statm').read_text().split()[1]
        assert int(resident) * os.sysconf('SC_PAGE_SIZE') < 250 * 2**20
        log = monitor.log.read_text()
    assert len(log.splitlines()) < 10, log
