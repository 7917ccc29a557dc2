"""Where a bridge runs as a service, there often is no home, or one that is read-only."""

import pytest
from support.bridges.routes import to_kafka
from support.processes.harness import Bench


@pytest.mark.parametrize('environ', [{'HOME': ''}, {'ROS_LOG_DIR': '/proc/none'}])
def test_a_bridge_needs_no_folder_for_logs_of_ros(
    bench: Bench, topic: str, environ: dict[str, str]
) -> None:
    config = bench.config([to_kafka('/a', topic)])
    with bench.run(config, **environ) as process:
        process.wait_for('subscribes to /a', 60)
        assert process.end(40) == 0, process.output()
    assert 'ERROR' not in process.output()
