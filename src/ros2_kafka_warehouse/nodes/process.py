"""A module as a process: ROS begins, the module spins, and all is let go of by a signal."""

import faulthandler
import logging
import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Final

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions

from ros2_kafka_warehouse.nodes.node import Module, Settings

_DDS: Final = Path(__file__).parent.parent / 'data' / 'fastdds.xml'
_DDS_VARIABLES: Final = ('FASTDDS_DEFAULT_PROFILES_FILE', 'FASTRTPS_DEFAULT_PROFILES_FILE')
_ALIVE_S: Final = 2.0
_LET_GO_S: Final = 5.0


def run(name: str, code: ModuleType, settings: Settings) -> int:
    """Run a module until SIGTERM or SIGINT; returns the exit status.

    Args:
        name: Of the module.
        code: Its file: `start(module)` puts it together.
        settings: What it is started with.

    Raises:
        SiteError: The site cannot be.
    """
    logging.basicConfig(
        level=logging.INFO, format=f'%(asctime)s %(levelname)-7s {name}: %(message)s'
    )
    faulthandler.enable()  # whoever ends a module that hangs, by SIGABRT, sees where it hung
    if not any(os.environ.get(variable) for variable in _DDS_VARIABLES):
        os.environ[_DDS_VARIABLES[0]] = str(_DDS)
    # Whoever started this process may have SIGINT ignored, as a shell does in the background.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    # Without files of ROS for each start, below a home that may be read-only.
    arguments = ['--ros-args', '--disable-external-lib-logs']
    rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.ALL)
    try:
        with _node(name) as node:
            _spin(Module(name, node, settings, logging.getLogger(name)), code)
    except (KeyboardInterrupt, ExternalShutdownException):
        return 0
    except rclpy_implementation.RCLError:
        if rclpy.ok():
            raise
        return 0  # a signal came while ROS was at work
    finally:
        rclpy.try_shutdown()
    return 0


@contextmanager
def _node(name: str) -> Iterator[Node]:
    node = rclpy.create_node(
        name,
        use_global_arguments=False,
        enable_rosout=False,
        start_parameter_services=False,
        parameter_overrides=[Parameter('start_type_description_service', value=False)],
    )
    try:
        yield node
    finally:
        node.destroy_node()


def _spin(module: Module, code: ModuleType) -> None:
    executor = SingleThreadedExecutor()
    try:
        code.start(module)
        if module.settings.alive is not None:
            module.each_s(_ALIVE_S, module.settings.alive.touch)
        executor.add_node(module.node)
        module.log.info('is up')
        executor.spin()
    finally:
        # Seldom the middleware does not let go: then the log shows where, and the process ends.
        faulthandler.dump_traceback_later(_LET_GO_S, exit=True)
        module.end()
