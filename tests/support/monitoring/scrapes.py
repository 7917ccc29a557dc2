"""A bridge that is watched, and what asks it."""

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import httpx
from prometheus_client.parser import text_string_to_metric_families as prometheus
from support.bridges.routes import to_kafka, to_ros
from support.processes.harness import Bench, Process, eventually

from ros2_kafka_bridge.testing.local_kafka import free_port

TOKEN: Final = 'a-token-for-the-tests'  # noqa: S105 (of tests)


PREFIX: Final = 'ros2_kafka_bridge_'


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

    def becomes(self, path: str, status: int, words: str = '', timeout_s: float = 90.0) -> str:
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


def watched(
    bench: Bench,
    routes: list[dict[str, Any]],
    *,
    pythonpath: str | None = None,
    node: bool = False,
    **more: Any,
) -> Watched:
    """Start a bridge that is watched."""
    port = free_port()
    config = bench.config(routes, monitoring=settings(port, node=node), **more)
    if pythonpath is None:
        return Watched(bench.bridge(config), port, config)
    return Watched(bench.bridge(config, PYTHONPATH=pythonpath), port, config)


ROUTES: Final = ('to_ros', 'to_kafka')


RATE: Final = 2000.0  # so that the load lasts for some scrapes


@contextmanager
def under_load(bench: Bench, unique: Callable[[str], str]) -> Iterator[Watched]:
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
