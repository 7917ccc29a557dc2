"""The image in a real Docker engine: both ways, as any user, with files that cannot be written."""

import json
import re
import shlex
import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from support.bridges.routes import lines, to_kafka, to_ros, values
from support.install.checkout import ROOT, fenced
from support.install.containers import IMAGE, Engine
from support.processes.harness import Bench, eventually

from rig.hosts import Host
from ros2_kafka_bridge.testing.local_kafka import LocalKafka

SPOOL = {'path': '/var/lib/ros2-kafka-bridge/spool'}
ANYBODY = '--user=12345'  # as OpenShift does: nobody knows the number, and its group is 0
FILE = '/etc/ros2-kafka-bridge/bridge.yaml'
WORKSPACE = '/opt/workspace/install/local_setup.bash'
_, RUN, _, _ = fenced('docs/container.md', 'sh')
PAGE = (ROOT / 'docs/container.md').read_text()
[CHECK] = re.findall('`(docker run --rm .*)`', PAGE)
[RELOAD] = re.findall('`(docker exec bridge bash .*?)`', PAGE)

pytestmark = pytest.mark.timeout(600)  # whose fixtures build images


@pytest.fixture
def kafka(tmp_path: Path, host: Host) -> Iterator[LocalKafka]:
    with host.entered(), LocalKafka(tmp_path / 'kafka') as node:
        yield node


@pytest.fixture
def bench(tmp_path: Path, kafka: LocalKafka, host: Host) -> Iterator[Bench]:
    """On that machine, beside the containers."""
    made = Bench(tmp_path, kafka.bootstrap_servers, domain=0).on(host)
    yield made
    made.close()


class Container:
    """A container that runs a configuration, started as docs/container.md does it.

    Args:
        docker: The engine.
        place: Where the folder `bridge` is.
        options: Of `docker run`, behind those of the page.
        image: Its name.
    """

    def __init__(self, docker: Engine, place: Path, *options: str, image: str = IMAGE) -> None:
        self._docker = docker
        self.name = f'bridge-{uuid.uuid4().hex[:8]}'
        command = f'ROS_DOMAIN_ID=0 {RUN.strip().removesuffix(IMAGE)}'
        docker.shell(f'{command} --name {self.name} {shlex.join(options)} {image}', place)

    def log(self) -> str:
        told = self._docker.asked('logs', self.name)
        return told.stdout + told.stderr

    def does(self, *words: str) -> str:
        """What a command of the bridge prints in it."""
        return self._docker.docker('exec', self.name, IMAGE, *words)

    def state(self) -> dict[str, Any]:
        found: dict[str, Any] = json.loads(self._docker.docker('inspect', self.name))[0]['State']
        return found

    def says(self, text: str) -> None:
        eventually(lambda: text in self.log(), 60, self.log)

    def is_found(self, health: str) -> None:
        eventually(lambda: self.state()['Health']['Status'] == health, 60, self.log)

    def stop(self) -> int:
        """`docker stop`; the exit status."""
        self._docker.docker('stop', self.name, timeout_s=100)
        status: int = self.state()['ExitCode']
        return status

    def remove(self) -> None:
        """What was written into it is gone, as with `docker run --rm`; named volumes stay."""
        self._docker.docker('rm', '--force', '--volumes', self.name)


def configured(bench: Bench, *routes: dict[str, Any]) -> Path:
    """Where a folder `bridge` has a bridge.yaml that anybody may read."""
    place = bench.place / uuid.uuid4().hex
    (place / 'bridge').mkdir(parents=True)
    written = bench.config(list(routes), kafka=bench.patient_kafka, monitoring={})
    written.rename(place / 'bridge' / 'bridge.yaml')
    return place


def numbered(count: int) -> list[bytes]:
    return [b'order %d' % number for number in range(count)]


def test_a_stranger_carries_both_ways_beside_nodes_of_the_machine_and_drains(
    bench: Bench, docker: Engine, tmp_path: Path
) -> None:
    bench.create_topic('orders')
    orders = numbered(20_000)
    both_readers: dict[str, Any] = {'min_subscribers': 2}
    files = configured(
        bench,
        to_ros('orders', '/orders', **both_readers),
        to_kafka('/orders', 'back', spool=SPOOL),
    )
    docker.shell(CHECK, files)
    container = Container(docker, files, ANYBODY, '--health-interval=1s')
    with bench.subscriber('/orders', tmp_path / 'seen') as robot:
        robot.wait_for('ready')
        container.is_found('healthy')
        bench.produce('orders', orders)
        bench.records('back', 1000)
        assert container.stop() == 0, container.log()
        assert re.findall(r'stopped: .* (\d+) given up', container.log()) == ['0', '0']
        docker.docker('start', container.name)
        assert values(bench.records('back', len(orders))) == orders
        eventually(lambda: len(lines(tmp_path / 'seen')) == len(orders), 60)
        assert container.stop() == 0
    assert 'Traceback' not in container.log()


def test_what_waits_on_disk_outlives_the_container(
    bench: Bench, docker: Engine, kafka: LocalKafka
) -> None:
    bench.create_topic('orders')
    files = configured(bench, to_kafka('/orders', 'orders', spool=SPOOL))
    container = Container(docker, files)
    container.says('subscribes to /orders')
    kafka.stop()
    with bench.publisher('/orders', '--count', '100') as robot:
        robot.wait_for('published 100')
        spool = ('spool', FILE, '--json')
        eventually(lambda: '"messages": 100' in container.does(*spool), 60, container.log)
        docker.docker('kill', container.name)
    container.remove()
    kafka.start()
    Container(docker, files)
    assert values(bench.records('orders', 100)) == [b'%d' % number for number in range(100)]


def test_it_is_unhealthy_until_it_is_ready(
    bench: Bench, docker: Engine, kafka: LocalKafka
) -> None:
    bench.create_topic('orders')
    kafka.stop()
    options = ('--health-interval=1s', '--health-retries=1', '--health-start-period=1s')
    files = configured(bench, to_ros('orders', '/orders'))
    container = Container(docker, files, *options)
    container.is_found('unhealthy')
    assert container.state()['Running']
    kafka.start()
    container.is_found('healthy')


def test_it_is_stopped_also_while_it_starts(bench: Bench, docker: Engine) -> None:
    container = Container(docker, configured(bench, to_kafka('/orders', 'orders')))
    assert container.stop() in {0, 143}


def test_it_is_started_again_when_it_fails_after_a_reload(bench: Bench, docker: Engine) -> None:
    container = Container(docker, configured(bench, to_kafka('/orders', 'orders')))
    container.says('subscribes to /orders')
    docker.shell(RELOAD.replace(' bridge ', f' {container.name} '), bench.place)
    container.says('reloaded: ')
    docker.asked('exec', container.name, 'bash', '-c', 'kill -9 -1')
    count = ('inspect', '--format={{.RestartCount}}', container.name)
    eventually(lambda: docker.docker(*count) == '1', 60, container.log)


def test_without_a_file_it_says_where_one_belongs(docker: Engine, tmp_path: Path) -> None:
    container = Container(docker, tmp_path, '--restart=no')
    eventually(lambda: not container.state()['Running'], 60)
    assert container.log() == f'{FILE}: no such file\n'
    assert container.state()['ExitCode'] == 2


def test_on_a_base_with_a_ros_2_that_one_is_used_and_a_workspace_on_top(
    on_ros: str, bench: Bench, docker: Engine
) -> None:
    bench.create_topic('orders', 'back')
    setup = bench.place / 'local_setup.bash'
    setup.write_text('export TOPIC=back\n')
    files = configured(bench, to_ros('orders', '/orders'), to_kafka('/orders', '${TOPIC}'))
    container = Container(docker, files, ANYBODY, f'--volume={setup}:{WORKSPACE}:ro', image=on_ros)
    container.says('subscribes to /orders')
    bench.produce('orders', numbered(1000))
    assert values(bench.records('back', 1000)) == numbered(1000)
    assert 'rclpy' not in docker.docker(
        'exec', container.name, 'ls', '/opt/ros2-kafka-bridge/lib/python3.13/site-packages'
    )
    assert container.stop() == 0, container.log()
