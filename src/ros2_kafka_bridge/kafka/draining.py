"""How a member of a group is closed: once it was told all that waits for it."""

import contextlib
import time
from collections.abc import Callable
from typing import Final

from confluent_kafka import Consumer, KafkaException

_STEP_S: Final = 0.01


def close(client: Consumer, within_s: float) -> None:
    """Close a client that was told all that waits for it, which may take so long."""
    drain(client, within_s)
    with contextlib.suppress(KafkaException):  # fatal for the client, and known
        client.close()


def poll_while(client: Consumer, condition: Callable[[], bool], within_s: float) -> None:
    """Let a client work for a moment, without taking records; what it raises is as for `drain`."""
    deadline_s = time.monotonic() + within_s
    with contextlib.suppress(KafkaException, SystemError):
        while condition() and time.monotonic() < deadline_s:
            client.poll(_STEP_S)


def drain(client: Consumer, within_s: float, *, has_left: bool = False) -> None:
    """Let a client call back all that waits for that; records that come are dropped.

    A rebalance that still waits when a client is closed is called back from inside of the close.
    What the answer asks of the client then may be purged with the client's own queue, and waited
    for for ever, with Python's lock held: each thread of the process stands still (librdkafka,
    its issue 4041; tried, 2.16).

    What it raises is passed over: that it is of no use any more is known. Of a partition that it
    is told to give up and has not got, it raises a KafkaError, and a SystemError where a call back
    meets that (tried, confluent-kafka 2.16).

    Args:
        client: Nobody else uses it any more.
        within_s: How long that may take.
        has_left: Whether it has unsubscribed: then it has to lose its partitions, too.
    """
    deadline_s = time.monotonic() + within_s
    while time.monotonic() < deadline_s:
        try:
            if client.poll(_STEP_S) is None and not (has_left and client.assignment()):
                return
        except (KafkaException, SystemError):
            time.sleep(_STEP_S)
