"""Endpoints of types that are made: in many threads, and where a ROS needs the packages."""

import sys
from pathlib import Path
from typing import Any

import pytest
from support.bridges.routes import to_kafka, to_ros, values
from support.processes.harness import PEERS, Bench
from support.processes.terminal import finished


@pytest.mark.usefixtures('ros_domain')
def test_threads_that_make_and_destroy_endpoints_at_once_never_stand_still() -> None:
    """No call of the middleware may let another thread of Python in: nobody would go on."""
    done = finished([sys.executable, PEERS / 'made_types_churn.py', '8', '60'])
    assert (done.stdout, done.stderr, done.returncode) == ('done\n', '', 0)


def test_a_ros_that_needs_the_packages_is_told_by_run_and_check(
    bench: Bench, topic_name: str
) -> None:
    why = 'RMW_FASTRTPS_USE_QOS_FROM_XML=1 lets profiles reserve memory, by the size of a type'
    assert_carries(bench, topic_name, f'imports the packages of message types: {why}', **XML)
    file = str(bench.config(there_and_back(topic_name)))
    _, out, _ = bench.command('check', '--connect', file, **XML)
    assert f'their packages are imported: {why}' in ' '.join(out.split())


def test_versions_that_nobody_has_tried_are_tried_at_the_start(
    bench: Bench, topic_name: str, tmp_path: Path
) -> None:
    package = tmp_path / 'share' / 'rmw_fastrtps_cpp' / 'package.xml'
    package.parent.mkdir(parents=True)
    package.write_text('<package><version>99.1.2</version></package>')
    tries = 'nobody has tried these versions of ROS: tries whether types need their packages'
    said = assert_carries(bench, topic_name, tries, AMENT_PREFIX_PATH=str(tmp_path))
    assert 'imports the packages' not in said


XML: dict[str, Any] = {'RMW_FASTRTPS_USE_QOS_FROM_XML': '1'}


def there_and_back(topic: str) -> list[dict[str, Any]]:
    return [to_ros(f'{topic}.there', '/made'), to_kafka('/made', f'{topic}.back')]


def assert_carries(bench: Bench, topic: str, line: str, **environ: Any) -> str:
    """A bridge says a line, carries a message there and back, and ends; returns what it said."""
    bench.create_topic(f'{topic}.there')
    with bench.drained(bench.config(there_and_back(topic)), **environ) as bridge:
        bridge.wait_for(line)
        bench.produce(f'{topic}.there', [b'order'])
        assert values(bench.records(f'{topic}.back', 1)) == [b'order']
    return bridge.output()
