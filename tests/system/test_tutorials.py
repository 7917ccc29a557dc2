"""The tutorials, command by command, in the order in which a person types them."""

import re
import shlex
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from support.install.checkout import ROOT, fenced
from support.processes.harness import Bench, Process, eventually
from support.processes.terminal import Terminal, finished, terminal

BIN = Path(sys.executable).parent
LOCAL_KAFKA = '~/bridge/bin/python -m ros2_kafka_bridge.testing.local_kafka'
CTRL_C, CTRL_Z = '\x03', '\x1a'


class Tutorial:
    """A page whose commands are done here: with the broker of the test, in a folder of its own.

    Args:
        page: Its name.
        bench: Whose broker and ROS domain are used.
        place: The folder.
        topics: That its Kafka has; the broker itself is run by test_readme.
    """

    def __init__(self, page: str, bench: Bench, place: Path, topics: list[str]) -> None:
        blocks = fenced(f'docs/{page}.md', 'sh')
        self.commands = [line for block in blocks for line in block.splitlines()]
        self.commands.remove(f'{LOCAL_KAFKA} --topics {" ".join(topics)}')
        self._bench, self._place = bench, place
        self._brokers = ('--bootstrap-servers', bench.bootstrap_servers)
        bench.create_topic(*topics)

    def line(self, command: str, *more: str) -> str:
        """A command of the page as it is typed here."""
        here = command.replace('localhost:9092', self._bench.bootstrap_servers)
        here = here.replace('~/bridge/bin/', f'{BIN}/').replace('examples/', f'{ROOT}/examples/')
        here = re.sub(r'(?<= )(\w+\.yaml)', rf'{self._place}/\1', here)
        if re.search(r'examples/(shop|records)\.py| topics$', here):
            more = (*more, *self._brokers)
        return ' '.join([here, *more])

    def does(self, command: str, *more: str) -> str:
        """Run a command to its end; returns what it shows."""
        result = finished(
            shlex.split(self.line(command, *more)), cwd=self._place, env=self._bench.environ
        )
        assert result.returncode == 0, result.stdout + result.stderr
        return result.stdout

    def starts(self, command: str, name: str) -> Process:
        """Run a command in a terminal of its own."""
        return Process(
            shlex.split(self.line(command)), self._place / f'{name}.log', self._bench.environ
        )

    def is_written(self, file: str) -> str:
        """A configuration that a command has written gets the broker of the test."""
        path = self._place / file
        text = path.read_text().replace('localhost:9092', self._bench.bootstrap_servers)
        path.write_text(text)
        return text

    @contextmanager
    def shell(self) -> Iterator[Terminal]:
        """A person's own shell, which knows jobs."""
        bash = ('bash', '--norc', '--noprofile', '-i')
        with terminal(*bash, environ=self._bench.environ) as shell:
            shell.types(f'cd {self._place}\n')
            yield shell


def test_getting_started_goes_as_it_is_written(own_bench: Bench, tmp_path: Path) -> None:
    page = Tutorial('getting-started', own_bench, tmp_path, ['orders', 'status'])
    [demo, init, check, run, robot, shop, topics, more, kill, again] = page.commands

    assert 'lost 0 (0.00 %)' in page.does(demo, '--seconds', '3')
    page.does(init)
    page.is_written('bridge.yaml')
    seen = page.does(check)
    assert 'would wait (orders: for subscribers of /orders)' in seen
    assert 'nobody publishes /status' in seen
    with page.shell() as shell, page.starts(robot, 'robot'):
        shell.types(f'{page.line(run)}\n')  # nobody waits for what it says
        assert page.does(shop) == '500 orders sent, 500 done, 0 missing, 0 told twice\n'
        assert '/status' in page.does(topics)
        with page.starts(more, 'shop') as selling:
            eventually(lambda: own_bench.reaches('status', 700), 60, shell.shown)
            shell.types(CTRL_Z)
            eventually(lambda: shell.shows(b'Stopped'), 20, shell.shown)
            shell.types(f'{kill}\n{page.line(again)}\n')
            assert selling.wait(120) == 0, selling.output() + shell.shown()
        shell.types(CTRL_C)
        eventually(lambda: shell.shows(b'orders: stopped'), 60, shell.shown)
        eventually(lambda: shell.shows(b'Killed'), 20, shell.shown)  # told at the next prompt
    assert re.fullmatch(r'1000 orders sent, 1000 done, 0 missing, .*\n', selling.output())


def test_a_shop_without_a_robot_says_what_is_missing(own_bench: Bench, tmp_path: Path) -> None:
    page = Tutorial('getting-started', own_bench, tmp_path, ['orders', 'status'])
    shop = next(command for command in page.commands if 'shop.py' in command)
    with page.starts(f'{shop} --patience 1', 'shop') as alone:
        assert alone.wait(30) == 1
    assert alone.output() == 'no robot has done an order in 1 s: do bridge and robot run?\n'


def test_two_shops_count_only_their_own_orders(own_bench: Bench, tmp_path: Path) -> None:
    page = Tutorial('getting-started', own_bench, tmp_path, ['orders', 'status'])
    [_, init, _, run, robot, shop, *_] = page.commands
    page.does(init)
    page.is_written('bridge.yaml')
    with (
        page.starts(robot, 'robot'),
        page.starts(run, 'bridge'),
        page.starts(shop, 'one') as one,
        page.starts(shop, 'other') as other,
    ):
        for each in (one, other):
            assert each.wait(90) == 0, each.output()
            assert each.output() == '500 orders sent, 500 done, 0 missing, 0 told twice\n'


def test_your_robot_goes_as_it_is_written(own_bench: Bench, tmp_path: Path) -> None:
    page = Tutorial('your-robot', own_bench, tmp_path, ['odom', 'battery_state', 'cmd_vel'])
    [pretend, topics, init, check, run, look, drive, mistake, letters] = page.commands
    with page.starts(pretend, 'robot') as robot:
        robot.wait_for('the robot stands at 0, 0')
        assert re.search(r'odom +/odom +ROS to Kafka +yes', page.does(topics))
        page.does(init)
        written = page.is_written('robot.yaml')
        for shown in fenced('docs/your-robot.md', 'yaml'):
            assert shown in written
        assert '3 routes would run' in page.does(check)
        with page.starts(run, 'bridge') as bridge:
            bridge.wait_for('/odom is read from its message number')
            bridge.wait_for('cmd_vel: first start of this group')
            record = page.does(look)
            assert re.search(r'key /odom\n', record)
            assert re.search(r'ros.seq: \d+\n', record)
            page.does(drive)
            robot.wait_for('told to drive 0.2 m/s')
            page.does(mistake)
            bridge.wait_for('dead_letter: cmd_vel[0]@1: $.linear.y: is missing')
            assert 'DecodeError: $.linear.y: is missing' in page.does(letters)
            page.does(drive)
            eventually(lambda: robot.output().count('told to drive 0.2') == 2, 20, robot.output)
            assert 'told to drive 0.5' not in robot.output()
            assert bridge.end() == 0
