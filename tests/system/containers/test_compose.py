"""What a new user has from compose.yaml: orders there and back, metrics, a reload, a stop.

Docker Compose and its engine are real, and so are the programs in the containers. Where no
registry answers they are in images made here (`stand_ins`). Grafana, which has no package, is out.
"""

import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import httpx
import pytest
from ruamel.yaml import YAML
from support.install.checkout import ROOT
from support.install.containers import Engine, engine
from support.patience import patient
from support.processes.harness import Bench, Process, eventually
from support.processes.terminal import finished

from rig.hosts import Host
from ros2_kafka_bridge.testing.local_kafka import LocalKafka, install_kafka

UP = ('up', '--detach', '--no-build', 'kafka', 'topics', 'bridge', 'prometheus')
PORTS = (9092, 9093, 9090, 9464)
STAND_INS = Path(__file__).with_name('stand_ins')
TOOLS = 'org.apache.maven.plugins:maven-dependency-plugin:3.9.0:copy'

pytestmark = [
    pytest.mark.skipif(
        shutil.which('docker-compose') is None, reason='docker-compose is not here'
    ),
    pytest.mark.usefixtures('provided'),
    pytest.mark.timeout(400),  # so long may it take, too, until all images are made
]


class Composed(NamedTuple):
    """A checkout's compose.yaml, run by Docker Compose.

    Args:
        docker: The engine.
        checkout: Where it and its files are.
    """

    docker: Engine
    checkout: Path

    def asked(self, *words: str) -> subprocess.CompletedProcess[str]:
        """Run `docker-compose` to its end, whichever that is."""
        return subprocess.run(
            ['docker-compose', *words], cwd=self.checkout, env=self.docker.environ, text=True,
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
            check=False, timeout=patient(120),
        )  # fmt: skip

    def does(self, *words: str) -> str:
        """Run it to a good end; returns all it says."""
        done = self.asked(*words)
        assert done.returncode == 0, f'{words}: {done.stdout}'
        return done.stdout

    def log(self) -> str:
        return self.does('logs', '--no-color', 'bridge')

    def container(self) -> str:
        """That of the bridge, while it runs."""
        return self.does('ps', '--quiet', 'bridge').strip()


@pytest.fixture(scope='module')
def provided(images: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where an engine finds the other images, too: the real ones, or those made here."""
    services = YAML(typ='safe').load(ROOT / 'compose.yaml')['services']
    place = tmp_path_factory.mktemp('stand_ins') / 'context'
    shutil.copytree(STAND_INS, place)
    with engine(images) as builder:
        for name in ('kafka', 'prometheus'):
            image = services[name]['image']
            if builder.asked('pull', image).returncode:
                add_jars(place / 'jars', services['kafka']['image'].rpartition(':')[2])
                words = ('--network=host', f'--target={name}', f'--tag={image}')
                builder.docker('build', *words, place)
    return images


def add_jars(folder: Path, version: str) -> None:
    """Kafka's, and those of the tools that its image has beside it."""
    if folder.exists():
        return
    shutil.copytree(install_kafka(), folder)
    tools = f'-Dartifact=org.apache.kafka:kafka-tools:{version}'
    command = ['mvn', '--batch-mode', '--quiet', TOOLS, tools, f'-DoutputDirectory={folder}']
    subprocess.run(command, check=True, timeout=patient(60), stdin=subprocess.DEVNULL)


@pytest.fixture
def composed(
    tmp_path: Path, docker: Engine, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Composed]:
    """With files that may be edited."""
    monkeypatch.setenv('ROS_DOMAIN_ID', '42')
    checkout = tmp_path / 'checkout'
    shutil.copytree(ROOT / 'packaging', checkout / 'packaging')
    shutil.copy(ROOT / 'compose.yaml', checkout)
    made = Composed(docker, checkout)
    yield made
    made.does('down', '--volumes')


@pytest.fixture
def bench(tmp_path: Path, host: Host) -> Bench:
    return Bench(tmp_path, 'localhost:9092', domain=0, host=host)


def goes_round(host: Host) -> str:
    """What examples/round_trip.py says of a thousand orders."""
    script = str(ROOT / 'examples' / 'round_trip.py')
    done = finished(
        host.command(sys.executable, script, '--count=1000', f'--patience={patient(60)}'),
    )
    return done.stdout + done.stderr


def metrics() -> str:
    """Of the bridge; nothing before it listens."""
    try:
        return httpx.get('http://127.0.0.1:9464/metrics', trust_env=False).text
    except httpx.ConnectError:
        return ''


def asked_of_prometheus(what: str) -> Any:
    return httpx.get(f'http://127.0.0.1:9090/api/v1/{what}', trust_env=False).json()['data']


def test_orders_come_back_past_a_node_of_the_machine_and_are_watched(
    composed: Composed, host: Host, tmp_path: Path
) -> None:
    composed.does(*UP)
    script = str(ROOT / 'examples' / 'print_orders.py')
    seen = tmp_path / 'seen'
    with Process(host.command(sys.executable, script), seen) as node:
        node.wait_for('listening')
        matched = 'dds_matched_endpoints{bridge="warehouse-1",route="orders"} 2'
        eventually(lambda: matched in metrics(), 60, composed.log)
        said = goes_round(host)
        assert said.startswith('1000 orders sent, 1000 came back'), said + composed.log()
        eventually(lambda: len(seen.read_text().splitlines()) == 1 + 1000, 60)

    up = 'query?query=up{job="ros2-kafka-bridge"}==1'
    eventually(lambda: bool(asked_of_prometheus(up)['result']), 60)
    groups = asked_of_prometheus('rules')['groups']
    assert sum(rule['type'] == 'alerting' for group in groups for rule in group['rules']) > 20
    for port in PORTS:
        with pytest.raises(httpx.ConnectError):
            httpx.get(f'http://{host.address}:{port}', trust_env=False)


def test_it_reloads_stops_and_has_its_records_when_it_is_made_anew(
    composed: Composed, host: Host, bench: Bench
) -> None:
    composed.does(*UP)
    assert ': 0 lost' in goes_round(host)
    edited = composed.checkout / 'packaging' / 'compose' / 'bridge.yaml'
    new = edited.with_suffix('.new')  # as an editor does
    new.write_text(f'{edited.read_text()}    drain_s: 9\n')
    new.replace(edited)
    composed.does('exec', '-T', 'bridge', 'bash', '-c', 'kill -HUP 1')
    eventually(lambda: 'reloaded: ' in composed.log(), 60, composed.log)
    assert 'routes.orders_returned.drain_s: 8' in composed.log()

    container = composed.container()
    composed.does('stop')
    log = composed.log()
    assert composed.docker.docker('inspect', '--format={{.State.ExitCode}}', container) == '0', log
    assert set(re.findall(r'stopped: .* (\d+) given up', log)) == {'0'}

    composed.does('down')
    composed.does(*UP)
    assert len(bench.records('orders.returned', 1000)) == 1000
    assert ': 0 lost, 0 repeated' in goes_round(host)
    assert len(bench.records('orders.returned', 2000)) == 2000


def test_it_leaves_another_kafka_of_the_machine_alone(
    composed: Composed, bench: Bench, tmp_path: Path
) -> None:
    with LocalKafka(tmp_path / 'kafka', port=9092):
        assert composed.asked(*UP).returncode
        said = composed.does('logs', 'kafka', 'topics')
        assert 'Another Kafka listens' in said or 'Address already in use' in said
        assert not composed.container()
        assert 'orders' not in bench.admin().list_topics(timeout=30).topics
