"""Metrics and health of a real bridge under load, and in each kind of trouble."""

import json
import os
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

import httpx
import pytest
from harness import Bench, Process, eventually, to_kafka, to_ros
from prometheus_client.openmetrics.parser import text_string_to_metric_families as openmetrics
from prometheus_client.parser import text_string_to_metric_families as prometheus
from workers import pids

from ros2_kafka_bridge.errors import TransportError
from ros2_kafka_bridge.kafka.cluster import Cluster
from ros2_kafka_bridge.kafka.overview import Overview
from ros2_kafka_bridge.testing.local_kafka import LocalKafka, free_port

Unique = Callable[[str], str]
TOKEN: Final = 'a-token-for-the-tests'  # noqa: S105 (of tests)
PREFIX: Final = 'ros2_kafka_bridge_'
OPENMETRICS: Final = 'application/openmetrics-text; version=1.0.0'


class Watched:
    """A bridge that is watched, and what asks it."""

    def __init__(self, process: Process, port: int, config: Path) -> None:
        self.process = process
        self.config = config
        self.url = f'http://127.0.0.1:{port}/'

    def get(self, path: str, **headers: str) -> httpx.Response:
        return httpx.get(self.url + path, headers=headers, timeout=30)

    def post(self, path: str, content: Any = None) -> httpx.Response:
        headers = {'authorization': f'Bearer {TOKEN}', 'content-type': 'application/json'}
        body = json.dumps({} if content is None else content)
        return httpx.post(self.url + path, headers=headers, content=body, timeout=90)

    def status(self, path: str) -> int:
        """The status of an answer, 0 where nobody answers."""
        try:
            return self.get(path).status_code
        except httpx.TransportError:
            return 0

    def becomes(self, path: str, status: int, words: str = '', timeout_s: float = 180.0) -> str:
        """Wait for a status and words; returns all that is said with it."""
        found = ''

        def is_so() -> bool:
            nonlocal found
            try:
                answer = self.get(path)
            except httpx.TransportError:
                return False
            found = f'{answer.status_code}\n{answer.text}'
            return answer.status_code == status and words in answer.text

        eventually(is_so, timeout_s, lambda: f'{path}: {found}\n{self.process.output()}')
        return found

    def route(self, name: str) -> dict[str, Any]:
        """A route as the page shows it."""
        [found] = [it for it in self.get('api/state').json()['routes'] if it['name'] == name]
        return dict(found)

    @property
    def broker_problem(self) -> str:
        """Why Kafka is away, as the page shows it."""
        return str(self.get('api/state').json()['broker']['problem'])

    def scrape(self) -> 'Scrape':
        return Scrape(self.get('metrics').text)


class Scrape:
    """The samples of one scrape."""

    def __init__(self, text: str) -> None:
        self.samples = {
            (sample.name.removeprefix(PREFIX), *sorted(sample.labels.items())): sample.value
            for family in prometheus(text)
            for sample in family.samples
        }
        self.counters = {
            key for key in self.samples if str(key[0]).endswith(('_total', '_count', '_bucket'))
        }

    def of(self, name: str, **labels: str) -> float:
        """The sum of all samples of that name with these labels."""
        wanted = set(labels.items())
        return sum(v for k, v in self.samples.items() if k[0] == name and wanted <= {*k[1:]})


def settings(port: int, **more: Any) -> dict[str, Any]:
    """The monitoring of a bridge, without a ROS node of its own."""
    return {'listen': f'127.0.0.1:{port}', 'token': TOKEN, 'node': False, **more}


def watched(bench: Bench, routes: list[dict[str, Any]], **more: Any) -> Watched:
    """Start a bridge that is watched."""
    port = free_port()
    config = bench.config(routes, monitoring=settings(port), **more)
    return Watched(bench.bridge(config), port, config)


@pytest.fixture
def loaded(bench: Bench, unique: Unique) -> Iterator[Watched]:
    """A bridge there and back, in two workers, with readers, while records keep coming."""
    orders, returned = unique('orders'), unique('returned')
    bench.create_topic(orders, partitions=2)
    bench.create_topic(returned)
    routes = [to_ros(orders, '/orders', max_rate=RATE), to_kafka('/orders', returned)]
    bridge = watched(bench, routes, workers=2)
    with bridge.process:
        bridge.becomes('readyz', 200)
        bench.produce(orders, (b'%d' % i for i in range(20_000)))
        yield bridge
        assert bridge.process.end(60) == 0, bridge.process.output()


def test_the_counters_of_each_scrape_balance_and_never_fall_under_load(loaded: Watched) -> None:
    before: Scrape | None = None
    scrapes = 0
    deadline_s = time.monotonic() + 120

    def all_came() -> bool:
        nonlocal before, scrapes
        now = loaded.scrape()
        scrapes += 1
        for route in ('to_ros', 'to_kafka'):
            taken = now.of('messages_taken_total', route=route)
            ended = now.of('messages_ended_total', route=route)
            held = now.of('messages_in_flight', route=route)
            held += now.of('messages_spooled', route=route)
            assert taken == ended + held, (route, taken, ended, held)
        for key in before.counters if before else ():
            assert now.samples[key] >= before.samples[key], key  # type: ignore[union-attr]
        before = now
        done = [now.of('messages_ended_total', route=r, outcome='confirmed') for r in ROUTES]
        return min(done) >= 20_000

    eventually(all_came, deadline_s - time.monotonic(), loaded.process.output)
    assert before is not None
    assert scrapes > 5
    # A message that the history's room confirms is measured, too.
    for name in ('bridge_seconds', 'end_to_end_seconds'):
        for route in ROUTES:
            assert before.of(f'{name}_count', route=route) >= 20_000, (name, route)
    assert before.of('produce_seconds_count', route='to_kafka') >= 20_000
    assert before.of('produce_seconds_count', route='to_ros') == 0
    assert before.of('worker_up') == 2
    assert before.of('worker_resident_memory_bytes') > 1e7
    assert before.of('bytes_confirmed_total', route='to_ros') >= 20_000
    assert before.of('route_state', route='to_ros', state='running') == 1


ROUTES: Final = ('to_ros', 'to_kafka')
RATE: Final = 2000.0  # so that the load lasts for some scrapes


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


def test_the_command_line_says_whether_it_is_ready(loaded: Watched, bench: Bench) -> None:
    config = str(loaded.config)
    status, out, err = bench.command('status', config)
    assert (status, err) == (0, '')
    assert 'test: ready, active' in out
    assert 'to_kafka' in out
    status, out, _ = bench.command('status', config, '--json')
    assert status == 0
    assert {it['name'] for it in json.loads(out)['routes']} == set(ROUTES)
    status, out, _ = bench.command('run', config, '--status')
    assert (status, 'test: ready, active' in out) == (0, True)


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
        eventually(lambda: bridge.route('to_kafka')['rate'] > 0, 180, bridge.process.output)
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
    for topic in (orders, lost):
        bench.create_topic(topic)
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
    kafka: LocalKafka, bench: Bench, unique: Unique
) -> None:
    there, missing = unique('there'), unique('missing')
    bench.create_topic(there, partitions=3)
    properties = {'bootstrap.servers': kafka.bootstrap_servers}
    cluster = Cluster(properties)
    for _ in range(3):
        seen = cluster.look([there, missing, there])
    assert list(seen.brokers.values()) == [kafka.bootstrap_servers]
    assert seen.controller in seen.brokers
    assert seen.cluster_id
    found = {topic.name: topic for topic in seen.topics}
    assert list(found) == sorted([there, missing])
    assert found[there] == (there, 3, '', 0, 0)
    assert 'it is not there' in found[missing].problem
    assert cluster.look([]).topics == []
    known = {topic.name for topic in Overview(properties).topics()}
    assert there in known
    assert missing not in known


def test_a_look_at_a_cluster_that_is_away_says_why() -> None:
    nobody = f'127.0.0.1:{free_port()}'
    with pytest.raises(TransportError, match='refused'):
        Cluster({'bootstrap.servers': nobody}).look(['orders'])


def test_a_bridge_that_does_not_answer_is_said_to_be_away(bench: Bench, unique: Unique) -> None:
    routes = [to_ros(unique('orders'), '/orders')]
    config = bench.config(routes, monitoring=settings(free_port()))
    status, _, err = bench.command('status', str(config))
    assert status == 2
    assert 'does not answer' in err
    status, _, err = bench.command('status', str(bench.config(routes)))
    assert status == 2
    assert 'monitoring: {listen: 127.0.0.1:9464}' in err
