"""The queue of a KEEP_LAST reader, replayed message by message.

One reader, one callback at a time. A message waits in the reader's queue until its callback
begins, and leaves the queue then. One that arrives while `depth` others wait pushes the oldest of
them out: it is lost. How many wait, and so how many are lost, is the same whether the oldest or
the newest goes; only which one is lost differs.

An idle reader needs time to wake up: the message that wakes it waits until then, as do those that
come meanwhile.

Where two things happen in the same nanosecond, a callback ends, and one begins, before a message
arrives.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Times = npt.NDArray[np.int64]
"""Nanoseconds, one entry for each message."""

SEED = 0
"""Of every random number that this package draws: the same recording has the same answer."""


class Replay(NamedTuple):
    """What became of each arrival.

    Args:
        lost: How many messages were lost.
        loss: Their share of all arrivals, 0 to 1.
        waiting: For each arrival, how many waited that came before it; int64[n].
        is_lost: For each arrival, whether it cost a message; bool[n]. The message lost is the
            one that waited longest, not the one that arrived.
        idle: For each arrival, whether it met an idle reader; bool[n].
    """

    lost: int
    loss: float
    waiting: Times
    is_lost: npt.NDArray[np.bool_]
    idle: npt.NDArray[np.bool_]


def replay(
    arrivals_ns: Times, service_ns: Times | int, depth: int | None, wake_ns: Times | int = 0
) -> Replay:
    """Replay a queue exactly.

    Args:
        arrivals_ns: When each message arrives, int64[n], not decreasing.
        service_ns: How long each callback takes, int64[n] or one number for all. The k-th entry
            is that of the k-th message served, whichever it is.
        depth: Of the KEEP_LAST queue, at least 1; None for a queue without an end.
        wake_ns: How long an idle reader takes from the arrival of a message to its callback, one
            number for all or an int64 array of any length. The k-th entry is that of the k-th
            message that meets an idle reader; after the last one it goes on with the first.

    Raises:
        ValueError: The arrivals are not in order, a length or a sign is wrong.
    """
    arrivals, service = checked(arrivals_ns, service_ns)
    if depth is not None and depth < 1:
        raise ValueError(f'a depth is 1 or more, not {depth}')
    wake = _wake(wake_ns, len(arrivals))
    if depth is None and not wake.any():
        is_lost = np.zeros(len(arrivals), np.bool_)
        starts = _starts(arrivals, service)
    else:
        # As many places as messages are a queue without an end.
        places = max(1, len(arrivals)) if depth is None else depth
        is_lost, starts = _served(arrivals, service, wake, places)
    kept = ~is_lost
    before: Times = np.cumsum(kept) - kept
    waiting = before - np.minimum(np.searchsorted(starts, arrivals, side='right'), before)
    idle = np.zeros(len(arrivals), np.bool_)
    ends = starts + service[: len(starts)]
    idle[kept] = np.append(True, arrivals[kept][1:] >= ends[:-1])[: len(starts)]
    lost = int(is_lost.sum())
    return Replay(lost, lost / max(1, len(arrivals)), waiting, is_lost, idle)


def resample(service_ns: Times, count: int, seed: int = SEED) -> Times:
    """Draw `count` service times from a recording of another length, in blocks.

    Blocks keep the correlation of one callback with the next; they are as long as the square
    root of the recording, begin anywhere, and go on at its beginning where it ends.
    """
    recorded = np.asarray(service_ns, np.int64)
    if not len(recorded):
        raise ValueError('there are no service times')
    length = max(1, int(len(recorded) ** 0.5))
    begins = np.random.default_rng(seed).integers(len(recorded), size=-(-count // length))
    places = (begins[:, None] + np.arange(length)).ravel()[:count]
    drawn: Times = recorded[places % len(recorded)]
    return drawn


def checked(arrivals_ns: Times, service_ns: Times | int) -> tuple[Times, Times]:
    """Both as arrays of one length.

    Raises:
        ValueError: They are not what `replay` takes.
    """
    arrivals = np.asarray(arrivals_ns, np.int64)
    service = np.asarray(service_ns, np.int64)
    if arrivals.ndim != 1:
        raise ValueError('arrivals are one row of times')
    behind = np.flatnonzero(np.diff(arrivals) < 0)
    if len(behind):
        raise ValueError(f'arrival {behind[0] + 2} is earlier than the one before it')
    if not service.ndim:
        service = np.full(len(arrivals), service)
    if service.shape != arrivals.shape:
        raise ValueError(f'{len(arrivals)} arrivals, but {len(service)} service times')
    if len(service) and service.min() < 0:
        raise ValueError('a service time is negative')
    return arrivals, service


def _wake(wake_ns: Times | int, count: int) -> Times:
    """As many times to wake up as there are messages."""
    wake = np.atleast_1d(np.asarray(wake_ns, np.int64))
    if wake.ndim != 1 or not len(wake):
        raise ValueError('times to wake up are one number, or one row of them')
    if wake.min() < 0:
        raise ValueError('a time to wake up is negative')
    return np.resize(wake, count)


def _starts(arrivals: Times, service: Times) -> Times:
    """When each callback begins: Lindley's recursion start = max(arrival, end before), summed up.

    With S the service of all before, start - S is the largest arrival - S so far.
    """
    before = np.cumsum(service) - service
    starts: Times = np.maximum.accumulate(arrivals - before) + before
    return starts


def _served(
    arrivals: Times, service: Times, wake: Times, depth: int
) -> tuple[npt.NDArray[np.bool_], Times]:
    """Which arrivals cost a message, and when each callback begins.

    `depth` messages wait as long as the one `depth` places back has not begun.
    """
    starts = [-1] * depth + [0] * len(arrivals)
    first = int(arrivals[0]) if len(arrivals) else 0
    starts[:depth] = [first] * depth
    services, wakes = service.tolist(), wake.tolist()
    lost = []
    end, served, woken = first, 0, 0
    for number, arrival in enumerate(arrivals.tolist()):
        if starts[served] > arrival:
            lost.append(number)
        else:
            if arrival >= end:
                end = arrival + wakes[woken]
                woken += 1
            starts[served + depth] = end
            end += services[served]
            served += 1
    is_lost = np.zeros(len(arrivals), np.bool_)
    is_lost[lost] = True
    return is_lost, np.array(starts[depth : depth + served], np.int64)
