"""docs/getting-started.md, command by command."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

from harness import Bench, Process, eventually
from pages import ROOT, fenced

BIN = Path(sys.executable).parent


def commands() -> list[str]:
    blocks = fenced('docs/getting-started.md', 'sh')
    return [line for block in blocks for line in block.splitlines()]


def test_the_ten_minutes_go_as_they_are_written(own_bench: Bench, tmp_path: Path) -> None:
    bench = own_bench
    [demo, kafka, init, check, run, robot, shop, topics, more, kill, again] = commands()
    file = tmp_path / 'bridge.yaml'
    environ = {'ROS_DOMAIN_ID': str(bench.domain)}

    def words(line: str, *more: str) -> list[str]:
        """A command of the page, for this place: other broker, other directory."""
        line = line.replace('~/bridge/bin/', f'{BIN}/').replace('examples/', f'{ROOT}/examples/')
        return [word.replace('bridge.yaml', str(file)) for word in shlex.split(line)] + [*more]

    def done(line: str, *more: str) -> str:
        result = subprocess.run(
            words(line, *more), cwd=tmp_path, env=bench.environ, capture_output=True, text=True,
            check=False, timeout=120,
        )  # fmt: skip
        assert result.returncode == 0, result.stdout + result.stderr
        return result.stdout

    assert 'lost 0 (0.00 %)' in done(demo, '--seconds', '3')

    # The broker itself is run by test_readme; here one is there already.
    local_kafka = '~/bridge/bin/python -m ros2_kafka_bridge.testing.local_kafka'
    assert kafka == f'{local_kafka} --topics orders status'
    for topic in ('orders', 'status'):
        bench.create_topic(topic)
    brokers = ('--bootstrap-servers', bench.bootstrap_servers)
    done(init)
    file.write_text(file.read_text().replace('localhost:9092', bench.bootstrap_servers))
    seen = done(check)
    assert 'would wait (orders: for subscribers of /orders)' in seen
    assert 'nobody publishes /status' in seen

    with Process(words(robot), tmp_path / 'robot.log', environ) as working:
        working.wait_for('the robot waits for orders')
        with Process(words(run), tmp_path / 'first.log', environ) as bridge:
            bridge.wait_for('first start of this group')
            bridge.wait_for('subscribes to /status')
            assert done(shop, *brokers) == '500 orders sent, 500 done, 0 missing, 0 told twice\n'
            assert '/status' in done(topics)
            with Process(words(more, *brokers), tmp_path / 'shop.log', environ) as selling:
                eventually(lambda: bench.reaches('status', 700), 60, bridge.output)
                subprocess.run(words(kill), check=True)
                bridge.wait()
                with Process(words(again), tmp_path / 'second.log', environ) as second:
                    assert selling.wait(120) == 0, selling.output() + second.output()
                    assert second.end() == 0
    assert re.fullmatch(r'1000 orders sent, 1000 done, 0 missing, .*\n', selling.output())
