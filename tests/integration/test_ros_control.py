"""The node of a bridge, as a lifecycle manager uses it."""

from pathlib import Path

from support.bridges.routes import lines, to_ros
from support.processes.harness import Bench, eventually
from support.ros.caller import caller


def test_a_bridge_that_waits_for_a_manager_is_configured_activated_and_shut_down(
    bench: Bench, topic: str, tmp_path: Path
) -> None:
    file = tmp_path / 'received'
    monitoring = {'listen': 'off', 'node': True, 'start': 'unconfigured'}
    routes = [to_ros(topic, '/orders')]
    config = bench.config(routes, monitoring=monitoring, kafka=bench.patient_kafka)
    bench.produce(topic, [b'1', b'2'])
    with (
        bench.subscriber('/orders', file),
        bench.bridge(config) as bridge,
        caller(bench.domain, bench.node) as node,
    ):
        assert node.state == 'unconfigured'
        assert not node.change('activate')
        right = config.read_text()
        config.write_text(right.replace('format: text', 'format: textt'))
        assert not node.change('configure')
        assert node.state == 'unconfigured'
        bridge.wait_for(' ERROR   configure: refused: all goes on as it was')
        wrong = [line for line in lines(bridge.log) if 'format: expected text' in line]
        assert len(wrong) == 1, bridge.output()
        assert f' ERROR   configure: {config}:' in wrong[0]
        config.write_text(right)
        assert node.change('configure'), bridge.output()
        assert node.state == 'inactive'
        assert node.change('cleanup'), bridge.output()
        assert node.state == 'unconfigured'
        assert node.change('configure'), bridge.output()
        assert lines(file) == []
        assert node.change('activate'), bridge.output()
        eventually(lambda: lines(file) == ['1', '2'], 60, bridge.output)
        node.begin('shutdown')
        assert bridge.wait(60) == 0, bridge.output()
    assert 'Traceback' not in bridge.output()
