"""A bridge inside a program of one's own: the one of docs/python.md, as it stands there."""

import signal
from pathlib import Path

from support.bridges.routes import to_kafka, values
from support.bridges.workers import there_and_back
from support.install.checkout import fenced
from support.processes.harness import Bench

from rig.processes import Process, Programs, ros_here

ORDERS = [b'order %d' % number for number in range(500)]
IN_THE_MAIN_THREAD = """
import logging, os, sys
from pathlib import Path
from ros2_kafka_bridge import Bridge, load
logging.basicConfig(level=logging.INFO)
Bridge(load(Path(sys.argv[1]), os.environ)).run()
"""
ROS_BEFORE = """
import rclpy
rclpy.init()
node = rclpy.create_node('mine')
"""


def of_the_page() -> str:
    [found] = [text for text in fenced('docs/python.md', 'python') if 'Bridge(' in text]
    return found


def program(bench: Bench, config: Path, text: str) -> Process:
    """A program that gets a configuration; `with` starts it."""
    file = bench.place / 'program.py'
    file.write_text(text)
    here = Programs(bench.place, ros_here(bench.domain))
    return here.python('program', '-P', str(file), str(config))


def move_orders(bench: Bench, running: Process, topic: str, returned: str) -> None:
    running.wait_for('subscribes to /orders')
    bench.produce(topic, ORDERS)
    assert values(bench.records(returned, len(ORDERS))) == ORDERS


def test_the_program_of_the_page_moves_orders_both_ways_and_is_stopped(
    bench: Bench, topic: str, returned: str
) -> None:
    """What is the command's business, workers and monitoring, it passes over."""
    config = bench.config(there_and_back(topic), workers=2, monitoring={'listen': 'off'})
    with program(bench, config, of_the_page()) as running:
        move_orders(bench, running, topic, returned)
        running.wait_for(f'to_kafka running {len(ORDERS)} ')
        assert running.end() == 0, running.output()
    assert f'bridge {bench.name} runs 2 routes' in running.output()
    assert bench.committed(bench.group, topic) == len(ORDERS)


def test_ctrl_c_in_a_run_of_the_main_thread_is_a_drain(
    bench: Bench, topic: str, returned: str
) -> None:
    config = bench.config(there_and_back(topic))
    with program(bench, config, IN_THE_MAIN_THREAD) as running:
        move_orders(bench, running, topic, returned)
        running.send(signal.SIGINT)
        assert running.wait() == -signal.SIGINT, running.output()
    said = f'stopped: {len(ORDERS)} taken, {len(ORDERS)} confirmed'
    assert running.output().count(said) == 2, running.output()


def test_ctrl_c_twice_ends_at_once_and_crashes_nothing(
    bench: Bench, topic: str, returned: str
) -> None:
    config = bench.config(there_and_back(topic))
    with program(bench, config, IN_THE_MAIN_THREAD) as running:
        move_orders(bench, running, topic, returned)
        running.send(signal.SIGINT)
        running.wait_for('stopping: draining')
        running.send(signal.SIGINT)
        assert running.wait() == -signal.SIGINT, running.output()


def test_a_program_that_has_used_ros_before_is_told_so(bench: Bench, topic_name: str) -> None:
    config = bench.config([to_kafka('/orders', topic_name)])
    with program(bench, config, ROS_BEFORE + of_the_page()) as running:
        assert running.wait() == 1, running.output()
    assert 'has started ROS in this process before the bridge' in running.output()
    assert 'Traceback' not in running.output()
