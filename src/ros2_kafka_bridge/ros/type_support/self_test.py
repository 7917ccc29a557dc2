"""A message through endpoints of a made type, in a process that may end of it.

It runs with the settings of the user, who runs the bridge with them, too.
"""

import os
import resource
import signal
import subprocess
import sys
import time
from tempfile import TemporaryFile
from typing import Any, Final

from ros2_kafka_bridge.logs.text import printable
from ros2_kafka_bridge.outside.parent import end_with_parent
from ros2_kafka_bridge.ros.helper_process import helper_process
from ros2_kafka_bridge.threads.stop import Stop

_PATIENCE_S: Final = 30.0
_LOOK_S: Final = 0.02
_ANSWER_S: Final = 15.0
_STEP_S: Final = 0.005
_LONGEST: Final = 300
_TYPE: Final = 'builtin_interfaces/msg/Time'
_MESSAGE: Final = b'\x00\x01\x00\x00' + bytes(range(8))
# The structures alone are tried: no other process is to see it, and it needs no keys.
_OWN: Final = {
    'ROS_AUTOMATIC_DISCOVERY_RANGE': 'OFF',
    'ROS_DOMAIN_ID': '0',
    'ROS_SECURITY_ENABLE': 'false',
}


def self_test_problem(stop: Stop) -> str:
    """Why a made type cannot be used here, found in a process of its own; empty where it can.

    Args:
        stop: Ends the waiting.
    """
    with TemporaryFile() as said:
        no_input = subprocess.DEVNULL
        try:
            with helper_process(
                __name__, env=os.environ | _OWN, stdin=no_input, stdout=said, stderr=said
            ) as child:
                until_s = time.monotonic() + _PATIENCE_S
                while child.poll() is None and time.monotonic() < until_s and not stop.asked:
                    time.sleep(_LOOK_S)
        except OSError as error:
            return f'types without them could not be tried: {error}'
        if child.returncode == 0:
            return ''
        if stop.asked:
            return 'a stop came before it was known whether types need them'
        said.seek(0)
        return f'types without them were tried, and failed: {_end_of(child, said.read())}'


def _end_of(child: subprocess.Popen[bytes], said: bytes) -> str:
    if child.returncode == -signal.SIGKILL:
        return f'that had not ended after {_PATIENCE_S:g} s'
    if child.returncode < 0:
        return f'ended by signal {-child.returncode} ({signal.strsignal(-child.returncode)})'
    lines = [line for line in said.decode(errors='replace').splitlines() if line.strip()]
    return printable(lines[-1])[:_LONGEST] if lines else f'exit status {child.returncode}'


def main() -> str:
    """Compare what installed types tell, then publish and take; returns what does not fit.

    It ends with the process that waits for it.
    """
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    end_with_parent()
    import rclpy  # noqa: PLC0415 (heavy)

    from ros2_kafka_bridge.ros.type_support.comparison import difference  # noqa: PLC0415

    if problem := difference():
        return problem
    context = rclpy.Context()
    rclpy.init(args=['--ros-args', '--disable-external-lib-logs'], context=context)
    node = rclpy.create_node('type_support_self_test', context=context, enable_rosout=False)
    try:
        return _carry(node)
    finally:
        node.destroy_node()
        context.try_shutdown()


def _carry(node: Any) -> str:
    """Publish a message, and say what is wrong with what comes of it."""
    from ros2_kafka_bridge.message_types import describe  # noqa: PLC0415 (not for the parent)
    from ros2_kafka_bridge.ros.take import MatchEvents, take  # noqa: PLC0415 (heavy)
    from ros2_kafka_bridge.ros.type_support.handle import endpoint_class  # noqa: PLC0415

    made = endpoint_class(_TYPE, describe(_TYPE).types)
    subscription = node.create_subscription(made, '/tried', lambda _: None, 10, raw=True)
    publisher = node.create_publisher(made, '/tried', 10)
    events = MatchEvents(publisher)
    until_s = time.monotonic() + _ANSWER_S
    while not events.look()[0] and time.monotonic() < until_s:
        time.sleep(_STEP_S)
    publisher.publish(_MESSAGE)
    while not (taken := take(subscription, 1)[0]) and time.monotonic() < until_s:
        time.sleep(_STEP_S)
    came = bytes(taken[0][0]) if taken else b''
    if came != _MESSAGE:
        return f'of {_MESSAGE.hex()}, which was published, {came.hex() or "nothing"} came'
    shown = [info.topic_type for info in node.get_publishers_info_by_topic('/tried')]
    return '' if shown == [_TYPE] else f'the graph shows {shown} of a publisher of {_TYPE}'


if __name__ == '__main__':
    sys.exit(main() or 0)
