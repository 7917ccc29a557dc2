"""A bridge of which nothing is known, and one that runs badly: what is told of either."""

from typing import Any, Final

from support.monitoring.monitors import report, snapshot

from ros2_kafka_bridge.protocol.monitor import Lifecycle, Reload, Report, RouteReport, Worker
from ros2_kafka_bridge.route.counters import (
    BOUNDS_S,
    Counters,
    Distribution,
    Measures,
    State,
    Trouble,
)

NONE: Final[Any] = None
ALWAYS: Final = 'always known'
SLOW: Final = Distribution((*[0] * len(BOUNDS_S), 7), 700.0)
ORDERS, RETURNED = 'orders', 'returned'

# In the log and in a report: a route that has told nothing, and one that runs badly.
SILENT = RouteReport(1, None, 0.0, Counters(ORDERS).nothing_told)
BAD_MEASURES = Measures(
    bytes_taken=90, bytes_confirmed=10, bytes_published=30, errors={'DecodeError': 9},
    waited_s=70.0, rebalances=8, kafka_up=False, matched=0, mismatched=2, queued=500,
    queue_limit=500, spool_bytes=4_900_000,
    published=SLOW, in_bridge=SLOW, end_to_end=SLOW, round_trip=SLOW,
    broker_round_trip_s=(3.0, 9.0), troubles=(Trouble(1.0, 'DecodeError', 'no JSON', 9),),
)  # fmt: skip
BAD = {
    'taken': 72, 'confirmed': 10, 'published': 12, 'dead_lettered': 9, 'dropped': 8, 'skipped': 1,
    'returned': 2, 'lost': 3, 'given_up': 4, 'spooled': 16, 'in_flight': 7, 'lost_upstream': 5,
    'repeated': 6, 'unproved': 2, 'memory_limit': 111_000_000, 'measures': BAD_MEASURES,
}  # fmt: skip


AT_REST = RouteReport(1, 2.0, 0.0, snapshot(RETURNED, State.FAILED, lag=500, **BAD).at_rest)


def badly(route: str, times: int = 1, **more: Any) -> RouteReport:
    """A route that has failed for good, after so many times seven messages that were slow."""
    slow = Distribution(tuple(times * count for count in SLOW.counts), times * SLOW.sum_s)
    measures = BAD_MEASURES._replace(
        published=slow, in_bridge=slow, end_to_end=slow, round_trip=slow
    )
    told = {**BAD, 'reason': 'no permission', 'final': True, 'measures': measures, **more}
    return RouteReport(1, 40.0, 95.0, snapshot(route, State.FAILED, **told))


def unknown_report() -> Report:
    """A worker of which nobody has heard yet."""
    return report(SILENT, AT_REST, workers=(Worker(1, 0, 1),))


def bad_report(second: int = 0) -> Report:
    return report(
        badly(ORDERS, 1 + second, lag=500), badly(RETURNED, 1 + second),
        workers=(Worker(1, 0, 9, 'was ended by SIGKILL', 40.0),),
        lifecycle=Lifecycle.INACTIVE, stopping=True, time_s=1000.0 + second, started_s=900.0,
        reload=Reload(990.0, done=False, text='line 3: unknown field'),
        paused=(ORDERS,),
    )  # fmt: skip
