"""One cell: its parts run, and what came is counted."""

import shutil
import uuid
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from benchmarks.contestants import Contestant, Ends, bare, bridge, paper
from benchmarks.experiment.grid import orders_of
from benchmarks.experiment.parts import Place, Run
from benchmarks.experiment.results import (
    SHARES,
    Cell,
    Counts,
    Hops,
    Latency,
    Load,
    Result,
    Usage,
)
from benchmarks.experiment.traffic import PROBE, Received, Sending
from benchmarks.topics import topics
from rig.processes import ProcessError

# The queue of a recording holds whatever comes; the paper's nodes are otherwise as printed.
_NO_LIMIT: Final = 1_000_000

Array = npt.NDArray[np.int64]


def recording_file(recordings: Path, cell: Cell) -> Path:
    """Where a recording is kept."""
    return recordings / f'{cell.load.name}.times'


def measure(cell: Cell, place: Place, seed: int, most: int) -> Result:
    """Measure a cell, from the first order on: the bridges have stood idle before it.

    Raises:
        ProcessError: A part ended, or nobody reads the orders.
    """
    at = datetime.now(UTC).isoformat(timespec='seconds')
    total = orders_of(cell.load, cell.seconds, most)
    sending = Sending(cell.load.rate, cell.load.burst, total, seed)
    with _prepared(cell, place, sending) as (run, stack):
        run.start(stack)
        run.send()
        run.end()
    return _result(cell, at, run)


def start_up(contestant: str, depth: int | None, place: Place) -> float:
    """Measure how long an order that waits in Kafka takes from the start of both bridges on.

    Returns:
        Seconds.

    Raises:
        ProcessError: A part ended, or the order did not come through.
    """
    cell = Cell(contestant, depth, Load('start-up', 'one order that waits', 0.0), 0.0)
    with _prepared(cell, place, Sending(0.0, 1, 0, 0)) as (run, stack):
        begun_ns = run.start_behind_an_order(stack)
        run.end()
    if run.problems:
        raise ProcessError('; '.join(run.problems))
    return (min(run.received.come_ns) - begun_ns) / 1e9


@contextmanager
def _prepared(cell: Cell, place: Place, sending: Sending) -> Iterator[tuple[Run, ExitStack]]:
    mark = uuid.uuid4().hex[:8]
    stem = f'experiment-{cell.contestant}-{mark}'
    files = place.logs / cell.key
    shutil.rmtree(files, ignore_errors=True)
    files.mkdir(parents=True)
    ends = Ends(
        place.bootstrap_servers, f'{stem}.orders', f'/orders_{mark}', f'{stem}.returned', files
    )
    with topics(ends.bootstrap_servers, [ends.source, ends.sink]), ExitStack() as stack:
        try:
            yield Run(_contestant(cell, place), ends, sending, place), stack
        except EOFError as error:
            raise ProcessError('the producer or the consumer has ended') from error
        except ProcessLookupError as error:
            raise ProcessError(str(error)) from error


def _contestant(cell: Cell, place: Place) -> Contestant:
    match cell.contestant:
        case 'paper':
            return paper(cell.depth or 0)
        case 'recording':
            place.recordings.mkdir(parents=True, exist_ok=True)
            return paper(_NO_LIMIT, '--record', str(recording_file(place.recordings, cell)))
        case 'bare':
            return bare('-Xlinger.ms=0')
        case _:
            return bridge(cell.depth)


# What came


def _result(cell: Cell, at: str, run: Run) -> Result:
    received = run.received
    order_ids = np.asarray(received.order_ids, np.int64)
    sent_ns = np.asarray(received.sent_ns, np.int64)
    come_ns = np.asarray(received.come_ns, np.int64)
    real = order_ids != PROBE
    first = np.zeros(len(order_ids), bool)
    first[np.unique(order_ids, return_index=True)[1]] = True
    latency_ms = (come_ns - sent_ns)[real & first] / 1e6
    used = {name: watched.usage() for name, watched in run.watched.items()}
    come_s = come_ns[real] / 1e9
    return Result(
        cell=cell,
        at=at,
        counts=Counts(
            producer=run.sent.taken,
            kafka_ros=run.counted('kafka_to_ros'),
            ros_kafka=run.counted('ros_to_kafka'),
            consumer=int((real & first).sum()),
            duplicated=int((real & ~first).sum()),
            out_of_order=out_of_order(order_ids[real]),
        ),
        sent_per_s=run.sent.taken / max(run.sent.seconds, 1e-3),
        delivered_per_s=len(come_s) / max(float(np.ptp(come_s)), 1e-3) if len(come_s) else 0.0,
        latency=_latency(latency_ms) if len(latency_ms) else None,
        kafka_ros=used['kafka_ros'],
        ros_kafka=used['ros_kafka'],
        broker=used.get('broker', Usage(0.0, 0.0, 0.0)),
        hops=_hops(received),
        problems=run.problems,
    )


def out_of_order(order_ids: Array) -> int:
    """Orders that came after one with a higher number."""
    if not len(order_ids):
        return 0
    highest_before = np.maximum.accumulate(order_ids)[:-1]
    return int((order_ids[1:] < highest_before).sum())


def _latency(latency_ms: npt.NDArray[np.float64]) -> Latency:
    # Nearest rank: each is the latency of an order that there was.
    at = np.quantile(latency_ms, (0.5, 0.95, 0.99, 0.999), method='inverted_cdf').tolist()
    curve = np.quantile(latency_ms, SHARES, method='inverted_cdf').tolist()
    return Latency(
        first=float(latency_ms[0]),
        fastest=float(latency_ms.min()),
        median=at[0],
        p95=at[1],
        p99=at[2],
        p999=at[3],
        slowest=float(latency_ms.max()),
        curve=[round(ms, 4) for ms in curve],
    )


def _hops(received: Received) -> Hops | None:
    """Part the way of those orders whose records tell the ROS time."""
    if not received.sample:
        return None
    sample = np.asarray(received.sample, np.int64)
    places, appended_ns, source_ns = sample[:, 0], sample[:, 1], sample[:, 2]
    sent_ns = np.asarray(received.sent_ns, np.int64)[places] + received.wall_ns
    come_ns = np.asarray(received.come_ns, np.int64)[places] + received.wall_ns
    appended_ns = appended_ns + 500_000  # it is cut to whole milliseconds
    return Hops(
        *(
            float(np.median(later - earlier)) / 1e6
            for earlier, later in (
                (sent_ns, source_ns), (source_ns, appended_ns), (appended_ns, come_ns),
            )
        )
    )  # fmt: skip
