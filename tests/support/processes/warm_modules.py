"""What a bridge and the nodes of the tests import and link, done once for all of them.

What is left out here is no mistake: each process imports what it has not got. An ImportError is
passed over by multiprocessing; `tests/integration/test_warm.py` finds that.
"""

import ctypes
import gc
import importlib
from pathlib import Path
from typing import Final

import std_msgs.msg
from rclpy.type_support import check_for_type_support
from support.processes.warm import end_with_parent

from ros2_kafka_bridge.process.load import load_checked

LATE: Final = (
    'confluent_kafka.admin',
    'rclpy.node',
    'ros2_kafka_bridge.bridge',
    'ros2_kafka_bridge.process.single_process',
    'rosidl_generator_py',
)
EXAMPLE: Final = Path(__file__).parents[3] / 'examples' / 'bridge.yaml'

end_with_parent()
for module in LATE:
    importlib.import_module(module)
load_checked(EXAMPLE)
check_for_type_support(std_msgs.msg.String)
ctypes.CDLL('librmw_fastrtps_cpp.so')
gc.collect()
