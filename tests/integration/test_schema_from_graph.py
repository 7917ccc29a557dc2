"""`schema --from-graph`: a type that only a node knows becomes a folder of .msg files."""

from pathlib import Path

from support.processes.harness import Bench
from support.ros.robots import installed, robot

from ros2_kafka_bridge.message_types import load_layout

PLAN = 'acme_plans/msg/Plan'
MESSAGES = {
    'Plan': 'std_msgs/Header header\nStep[<=3] steps\nstring<=20 name "a \\x23 \\"b\\""\n',
    'Step': 'builtin_interfaces/Duration[2] times\nfloat64 metres 1.5\n',
}


def test_the_files_of_what_a_node_describes_are_read_as_its_definition(
    bench: Bench, tmp_path: Path
) -> None:
    prefix = installed(tmp_path, 'acme_plans', MESSAGES)
    folder = bench.place / 'msgs'
    asked = ('schema', PLAN, '--from-graph', '--format', 'msg', '--output', str(folder))
    with robot(bench, PLAN, prefix, '--name', 'amr', publishes={'/plan': []}):
        status, out, err = bench.command(*asked)
    assert (status, err) == (0, f'{PLAN} is described by the node /amr\n')
    assert load_layout(PLAN, [folder]) == load_layout(PLAN, [prefix / 'src'])
    assert {*out.splitlines()} == {str(file) for file in folder.glob('*/msg/*.msg')}
