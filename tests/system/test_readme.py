"""The README's commands as they are written, from an environment that holds nothing of ours."""

import os
import re
import shutil
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from support.install.checkout import ROOT, fenced
from support.processes.harness import Process
from support.processes.terminal import finished

from rig.hosts import Host, Network
from ros2_kafka_bridge.errors import ConfigError
from ros2_kafka_bridge.testing.local_kafka import install_kafka

# Where packages come from, and whom to trust about that, is the machine's own.
KEPT = ('PIP_', 'SSL_CERT_', 'HTTP_PROXY', 'HTTPS_PROXY', 'NO_PROXY', 'JAVA_HOME')
PIP_S = 400


class Newcomer:
    """A user with a checkout, an empty home, and nothing else.

    Args:
        place: Where both are made.
        host: A network of its own: there `localhost:9092` is free.
    """

    def __init__(self, place: Path, host: Host) -> None:
        self.place = place
        self.checkout = place / 'checkout'
        self._host = host
        (place / 'home').mkdir()
        shutil.copytree(
            ROOT, self.checkout,
            ignore=shutil.ignore_patterns('.*', '__pycache__', 'build', 'dist', 'tests'),
        )  # fmt: skip
        python = Path(sys.executable).resolve().parent
        self._environ = {
            **{name: value for name, value in os.environ.items() if name.startswith(KEPT)},
            'HOME': str(place / 'home'),
            'PATH': f'{python}:{os.environ["PATH"]}',
            'ROS2_KAFKA_BRIDGE_KAFKA_JARS': str(install_kafka().parent),  # no net there to fetch
        }

    def does(self, line: str) -> None:
        """Run a command to its end, in the network of the machine."""
        done = finished(['sh', '-c', line], cwd=self.checkout, env=self._environ, timeout_s=PIP_S)
        assert done.returncode == 0, done.stdout + done.stderr

    def starts(self, line: str, name: str) -> Process:
        """A terminal in which a command runs, in the network of its own."""
        variables = [f'{key}={value}' for key, value in self._environ.items()]
        words = ['env', '-i', *variables, 'sh', '-c', f'cd {self.checkout} && exec {line}']
        return Process(self._host.command(*words), self.place / f'{name}.log')


@pytest.fixture
def newcomer(tmp_path: Path) -> Iterator[Newcomer]:
    try:
        with Network('shop') as (shop,):
            yield Newcomer(tmp_path, shop)
    except ConfigError as reason:
        pytest.skip(str(reason))


@pytest.mark.timeout(600)
def test_a_message_is_through_in_five_commands(newcomer: Newcomer) -> None:
    make, install, kafka, run, send = (
        line for block in fenced('README.md', 'sh') for line in block.splitlines()
    )
    show = '~/bridge/bin/python examples/print_orders.py'
    assert f'`{show}`' in (ROOT / 'README.md').read_text()
    newcomer.does(make)
    newcomer.does(install)
    with (
        newcomer.starts(kafka, 'kafka') as broker,
        newcomer.starts(run, 'bridge') as bridge,
        newcomer.starts(show, 'robot') as robot,
    ):
        broker.wait_for('It has the topics orders, orders.returned.')
        robot.wait_for('listening to /orders')
        bridge.wait_for('reads orders')
        with newcomer.starts(send, 'sender') as sender:
            assert sender.wait(120) == 0, sender.output() + bridge.output()
        assert re.search(
            r'10000 orders sent, 10000 came back in [\d.]+ s: 0 lost, 0 repeated, in order\n',
            sender.output(),
        )
        # It may match after the last of them: a late reader gets what comes from then on.
        while '"order_id"' not in robot.output():
            with newcomer.starts(send, 'sender') as sender:
                assert sender.wait(120) == 0, sender.output()
        check = '~/bridge/bin/ros2-kafka-bridge check examples/bridge.yaml --connect'
        with newcomer.starts(check, 'check') as checked:
            assert checked.wait(60) == 0, checked.output()
        for each in (robot, bridge, broker):
            each.send(signal.SIGINT)  # Ctrl-C
            assert each.wait() == 0, each.output()
            assert 'Traceback' not in each.output()


def test_the_mistake_that_the_readme_shows_is_told_so(tmp_path: Path) -> None:
    [configuration] = fenced('README.md', 'yaml')
    (tmp_path / 'bridge.yaml').write_text(configuration.replace('msg/String', 'msg/Strin'))
    program = Path(sys.executable).parent / 'ros2-kafka-bridge'
    told = finished([program, 'check', 'bridge.yaml'], cwd=tmp_path)
    assert (told.returncode, told.stderr) == (2, fenced('README.md', '')[0])
