"""A package of messages that is built for real: published and taken by rclpy through DDS."""

import os
import subprocess
import sys
from pathlib import Path

from support.ros.package import build_package, write_package

MESSAGES = {
    'Crane': """\
std_msgs/Header header
string<=20 name "K1"
float64[3] position
Hook[<=2] hooks
uint64 lifts
""",
    'Hook': 'uint8 LOADED=1\nuint8 state\nfloat32 load 2.5\n',
}
PROGRAM = """\
import sys, time
from pathlib import Path
import rclpy
from acme_msgs.msg import Crane, Hook
from ros2_kafka_bridge.message_types import load_layout
from ros2_kafka_bridge.ros.types import load_type

loaded = load_type('acme_msgs/msg/Crane', 'import')
assert loaded.endpoint_class is Crane
assert loaded.layout == load_layout('acme_msgs/msg/Crane', [Path(sys.argv[1])])

sent = Crane(hooks=[Hook(state=Hook.LOADED)], lifts=2**64 - 1)
taken = []
rclpy.init(domain_id=int(sys.argv[2]))
node = rclpy.create_node('harbour')
node.create_subscription(Crane, '/crane', taken.append, 1)
publisher = node.create_publisher(Crane, '/crane', 1)
end = time.monotonic() + 60
while not taken and time.monotonic() < end:
    publisher.publish(sent)
    rclpy.spin_once(node, timeout_sec=0.1)
assert taken[0] == sent
(there,) = node.get_publishers_info_by_topic('/crane')
assert str(there.topic_type_hash) == loaded.type_hash, there.topic_type_hash
rclpy.shutdown()
"""


def test_a_package_that_the_user_has_built_is_loaded_and_has_the_hash_that_dds_tells(
    tmp_path: Path, ros_domain: int
) -> None:
    package = write_package(tmp_path / 'src', 'acme_msgs', MESSAGES)
    built = build_package(package, tmp_path / 'install', ['std_msgs', 'builtin_interfaces'])
    subprocess.run(
        [sys.executable, '-c', PROGRAM, package, str(ros_domain)],
        env=os.environ | built,
        check=True,
        timeout=120,
    )
