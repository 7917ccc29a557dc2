"""The README's commands and the examples, run as they are written."""

import os
import re
import shlex
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from harness import Bench, Process

ROOT = Path(__file__).parents[2]


def sh_blocks() -> list[list[str]]:
    text = (ROOT / 'README.md').read_text()
    return [
        block.strip().splitlines() for block in re.findall(r'```sh\n(.*?)```', text, re.DOTALL)
    ]


def test_the_three_terminals_of_the_readme(
    own_bench: Bench, tmp_path: Path, ros_domain: int
) -> None:
    bench = own_bench  # its topics have the names of the README
    demo, kafka, bridge, round_trip = sh_blocks()
    assert demo == ['make demo']  # run by test_getting_started
    # The broker itself is run by test_local_kafka; here one is there already.
    assert kafka == ["make kafka TOPICS='orders orders.returned'"]
    assert bridge[0] == 'make setup'
    example = (ROOT / 'examples' / 'bridge.yaml').read_text()
    assert len(example.splitlines()) <= 12
    config = tmp_path / 'bridge.yaml'
    config.write_text(example.replace('localhost:9092', bench.bootstrap_servers))
    environ = {'ROS_DOMAIN_ID': str(ros_domain)}
    bench.create_topic('orders')
    bench.create_topic('orders.returned')

    def command(line: str) -> list[str]:
        line = line.replace('examples/bridge.yaml', str(config))
        line = line.replace('.venv/bin/', f'{Path(sys.executable).parent}/')
        return shlex.split(line)

    checked = subprocess.run(
        command(bridge[1]), cwd=ROOT, env={**os.environ, **environ}, check=False, timeout=60
    )
    assert checked.returncode == 0
    with (
        Process(command(bridge[2]), tmp_path / 'bridge.log', environ) as running,
        Process(
            [sys.executable, str(ROOT / 'examples' / 'print_orders.py')],
            tmp_path / 'orders.log',
            environ,
        ) as printing,
    ):
        printing.wait_for('listening to /orders')
        running.wait_for('reads orders')
        done = subprocess.run(
            [*command(round_trip[0]), '--bootstrap-servers', bench.bootstrap_servers],
            cwd=ROOT,
            capture_output=True,
            text=True,
            check=False,
            timeout=120,
        )
        assert done.returncode == 0, done.stdout + done.stderr + running.output()
        assert re.fullmatch(
            r'10000 orders sent, 10000 came back in [\d.]+ s: 0 lost, 0 repeated, in order\n',
            done.stdout,
        )
        # It may match after the last of them: a late reader gets what comes from then on.
        while '"order_id"' not in printing.output():
            subprocess.run(
                [*command(round_trip[0]), '--bootstrap-servers', bench.bootstrap_servers],
                cwd=ROOT,
                capture_output=True,
                check=True,
                timeout=120,
            )
        assert running.end() == 0
        printing.send(signal.SIGINT)  # Ctrl-C
        assert printing.wait() == 0, printing.output()


def test_the_configuration_of_the_readme_is_right(
    bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its parts are those of one file."""
    parts = re.findall(r'```yaml\n(.*?)```', (ROOT / 'README.md').read_text(), re.DOTALL)
    config = tmp_path / 'bridge.yaml'
    config.write_text(''.join(parts))
    monkeypatch.setenv('KAFKA_PASSWORD', 'not-shown')
    monkeypatch.setenv('BRIDGE_TOKEN', 'not-shown-either')
    status, output, errors = bench.command('check', str(config))
    assert status == 0, errors
    assert 'not-shown' not in output
