"""docs/warehouse.md, command by command, with the broker that the warehouse brings along."""

import json
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Self

import pytest
from support.install.checkout import ROOT, fenced
from support.processes.harness import Process, eventually
from support.processes.terminal import finished

BIN = Path(sys.executable).parent
PAGE = 'docs/warehouse.md'


class Reader:
    """A plain client that shows the records of a topic as they come."""

    def __init__(self, command: str, environ: dict[str, str], log: Path) -> None:
        self.process = Process(['bash', '-c', f'cd {ROOT} && exec {command}'], log, environ)

    def __enter__(self) -> Self:
        self.process.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()

    def has(self, **wanted: str) -> bool:
        """Whether a record has come with these fields, each with this text in it."""
        return any(
            all(text in str(record.get(name)) for name, text in wanted.items())
            for record in self._records()
        )

    def _records(self) -> Iterator[dict[str, Any]]:
        for line in self.process.output().splitlines(keepends=True):
            if line.startswith('  {') and line.endswith('\n'):
                yield json.loads(line)


@pytest.fixture
def environ(ros_domain: int) -> dict[str, str]:
    return {'ROS_DOMAIN_ID': str(ros_domain)}


def started_by(make: str, *options: str) -> list[str]:
    """The command that `make` would run."""
    [*_, told] = subprocess.run(
        [*shlex.split(make), '--dry-run', f'A={" ".join(options)}'],
        cwd=ROOT, capture_output=True, text=True, check=True,
    ).stdout.splitlines()  # fmt: skip
    return shlex.split(here(told))


def here(command: str) -> str:
    return command.replace('.venv/bin/', f'{BIN}/')


def test_the_tutorial_goes_as_it_is_written(environ: dict[str, str], tmp_path: Path) -> None:
    lines = [line for block in fenced(PAGE, 'sh') for line in block.splitlines()]
    [make, address, follow, _, order, look, fail, repair, rejoin, cut, *lines] = lines
    [close, order_there, open_again, kill_orders, kill_bridge, send] = lines

    def does(line: str) -> str:
        result = finished(['bash', '-c', here(line)], cwd=ROOT, env=everything)
        assert result.returncode == 0, result.stdout + result.stderr
        return result.stdout

    def kill(line: str, part: str) -> None:
        [pid] = re.findall(rf' {part} is process (\d+)', run.output())
        assert re.fullmatch(r'kill -KILL \d+', line)
        does(re.sub(r'\d+', pid, line))
        run.wait_for(f'{part} was ended by SIGKILL: is started again in 0.5 s')
        run.wait_for(f'{part} is started again, as process')

    command = started_by(make, '--port=0', '--step-s=0.1', f'--logs={tmp_path / "logs"}')
    with Process(command, tmp_path / 'run.log', environ) as run:
        run.wait_for('the warehouse is up', 120)
        [servers] = re.findall(r'an embedded broker answers at (\S+)', run.output())
        assert re.fullmatch(r'export KAFKA=127\.0\.0\.1:\d+', address)
        everything = {**environ, 'KAFKA': servers}
        looking, _, wanted = here(follow).partition(' | grep ')
        watching = looking.replace('order-events', 'failures')
        with (
            Reader(looking, everything, tmp_path / 'events.log') as events,
            Reader(watching, everything, tmp_path / 'failures.log') as failures,
        ):
            does(order)
            eventually(lambda: events.has(orderId=wanted, status='DELIVERED'), 120, run.output)
            assert re.search(r'warehouse.orders +\d+ +\d+ +orders reads', does(look))

            does(fail)
            eventually(lambda: failures.has(outcome='the operator is called'), 60, run.output)
            does(repair)
            eventually(lambda: failures.has(outcome='shows nothing any more'), 60, run.output)
            does(rejoin)
            eventually(lambda: failures.has(outcome='it was told to rejoin'), 60, run.output)
            does(cut)
            eventually(lambda: failures.has(outcome='COMM_LOST became ROBOT_LOST'), 60, run.output)

            does(close)
            does(order_there)
            why = 'no way is free from (28, 4) to the station at (41, 13)'
            eventually(lambda: events.has(orderId='O-18', reason=why), 60, run.output)
            eventually(lambda: failures.has(code='NO_ROUTE', evidence='O-18/1'), 60, run.output)
            does(open_again)
            eventually(lambda: events.has(orderId='O-18', status='DELIVERED'), 120, run.output)

            kill(kill_orders, 'orders')
            kill(kill_bridge, 'bridge')
            assert '3 orders sent' in does(send)
            eventually(lambda: events.has(orderId='R-', status='DELIVERED'), 120, run.output)
        assert run.end() == 0
