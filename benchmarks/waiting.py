"""What it costs to learn which of many topics has a message: a wait set, and as the bridge does.

    python -m benchmarks.waiting --topics 1 10 100 1000

One message at a time comes on one of so many topics, is waited for and taken: by a wait set of
rclpy, which is filled and asks every subscription for each wait, and then by the bridge's
`Arrivals`, which DDS tells. CPU time of the thread that waits, in microseconds a message.
"""

import argparse
import random
import statistics
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, Final, NamedTuple

import rclpy
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.signals import SignalHandlerOptions
from rich.console import Console
from rich.table import Table
from std_msgs.msg import String

from benchmarks.command import run
from rig.peers.ends import qos, wait_for_readers
from ros2_kafka_bridge.ros.arrivals import Arrivals
from ros2_kafka_bridge.ros.take import take
from ros2_kafka_bridge.threads.wakeup import Wakeup

MESSAGES: Final = 300
LONGEST_S: Final = 5.0
_LIMIT: Final = 100

Take = Callable[[], int]
"""Waits until something comes, and tells how much was taken."""


class Result(NamedTuple):
    """CPU time of one message, the median, in microseconds."""

    topics: int
    wait_set_us: float
    told_us: float


def measure(count: int) -> Result:
    """Let messages come on one of so many topics at a time."""
    with _topics(count) as (node, names):
        publishers = [node.create_publisher(String, name, qos()) for name in names]
        subscriptions = {
            name: node.create_subscription(String, name, lambda _: None, qos(), raw=True)
            for name in names
        }
        wait_for_readers(publishers)
        by_wait_set = _spent_us(_by_wait_set(node.context, subscriptions), publishers)
        return Result(count, by_wait_set, _spent_us(_told(subscriptions), publishers))


@contextmanager
def _topics(count: int) -> Iterator[tuple[Any, Sequence[str]]]:
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    try:
        yield rclpy.create_node('waiting'), [f'/waiting/n{number}' for number in range(count)]
    finally:
        rclpy.shutdown()


def _by_wait_set(context: Any, by_name: Mapping[str, Any]) -> Take:
    subscriptions = list(by_name.values())
    wait_set = rclpy_implementation.WaitSet(len(subscriptions), 0, 0, 0, 0, 0, context.handle)
    by_place = {subscription.handle.pointer: subscription for subscription in subscriptions}

    def wait_and_take() -> int:
        wait_set.clear_entities()
        for subscription in subscriptions:
            wait_set.add_subscription(subscription.handle)
        wait_set.wait(int(LONGEST_S * 1e9))
        ready = wait_set.get_ready_entities('subscription')
        return sum(len(take(by_place[place], _LIMIT)[0]) for place in ready)

    return wait_and_take


def _told(subscriptions: Mapping[str, Any]) -> Take:
    arrivals = Arrivals(Wakeup())
    for name, subscription in subscriptions.items():
        arrivals.of(name).attach(subscription)

    def wait_and_take() -> int:
        ready = arrivals.wait(LONGEST_S)
        return sum(len(take(subscriptions[name], _LIMIT)[0]) for name in ready)

    return wait_and_take


def _spent_us(way: Take, publishers: Sequence[Any]) -> float:
    """The median of many messages."""
    chosen = random.Random(1)  # noqa: S311 (no secret)
    spent_us = []
    for _ in range(MESSAGES):
        chosen.choice(publishers).publish(String(data='x'))
        begun_s = time.thread_time()
        while not way():
            pass
        spent_us.append((time.thread_time() - begun_s) * 1e6)
    return statistics.median(spent_us)


def show(results: Sequence[Result], console: Console) -> None:
    """Print the table."""
    table = Table('topics', 'wait set, us a message', 'told by DDS', 'ratio')
    for one in results:
        ratio = one.wait_set_us / one.told_us
        table.add_row(
            f'{one.topics:,}', f'{one.wait_set_us:.0f}', f'{one.told_us:.0f}', f'{ratio:.1f}'
        )
    console.print(table)


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and print; returns the exit status."""
    parser = argparse.ArgumentParser(
        prog='python -m benchmarks.waiting', description='Waits for one of many topics.'
    )
    parser.add_argument('--topics', type=int, nargs='+', default=[1, 10, 100, 1000])
    return run(
        parser,
        arguments,
        lambda options, _: [measure(count) for count in options.topics],
        show,
        lambda results, _: {'results': [one._asdict() for one in results]},
        has_kafka=False,
        says_versions=True,
    )


if __name__ == '__main__':
    sys.exit(main())
