"""What the log says of the counters, every ten seconds."""

import time
from collections.abc import Callable, Iterable, Sequence
from typing import Final

from ros2_kafka_bridge.config.direction import Direction
from ros2_kafka_bridge.logs.lines import route_log
from ros2_kafka_bridge.logs.summed import Summed
from ros2_kafka_bridge.logs.text import clock_time, count
from ros2_kafka_bridge.route.counters import Counters, Measures, Snapshot, State

_MOST_NAMES: Final = 3
_PERIOD_S: Final = 10.0
_ASKED_S: Final = 1.0
_OLD_S: Final = 3.0  # a route tells its numbers each second


def carried_per_s(now: Snapshot, before: Snapshot, period_s: float) -> float:
    """How many came on in a second."""
    # What runs a route again after its process had died counts from 0.
    earlier = before.carried if before.carried <= now.carried else 0
    return (now.carried - earlier) / period_s


def figures(now: Snapshot, rate: float) -> dict[str, str | float | None]:
    """How a route is doing, for a program."""
    return {
        'state': str(now.state),
        'confirmed': now.confirmed,
        'published': now.published,
        'rate': round(rate, 1),
        'in_flight': now.in_flight,
        'lag': now.lag,
        'dead_lettered': now.dead_lettered,
    }


def status_line(now: Snapshot, rate: float) -> str:
    """The same in one line, for a person."""
    state = f'{now.state} ({now.reason})' if now.reason else str(now.state)
    lag = '' if now.lag is None else f', lag {now.lag}'
    given_up = f', {now.given_up} given up' if now.given_up else ''
    return (
        f'{state}: {_carried(now)}, {rate:.0f}/s, {now.in_flight} in flight{lag}, '
        f'{now.dead_lettered} dead-lettered{given_up}{_rare(now)}'
    )


def totals(snapshot: Snapshot) -> str:
    """One line that says what became of everything a route has taken."""
    given_up = snapshot.in_flight + snapshot.given_up
    return (
        f'{snapshot.taken} taken, {_carried(snapshot)}, '
        f'{snapshot.dead_lettered} dead-lettered, {given_up} given up{_rare(snapshot)}'
    )


def _carried(now: Snapshot) -> str:
    published = f', {now.published} only published' if now.published else ''
    return f'{now.confirmed} confirmed{published}'


_LEFT: Final = {
    Direction.KAFKA_TO_ROS: ('record', 'read again next time'),
    Direction.ROS_TO_KAFKA: (
        'message',
        'lost unless in the spool, or the publisher is TRANSIENT_LOCAL',
    ),
}
"""What a route holds, and what becomes of it."""


def left(snapshot: Snapshot, direction: Direction) -> str:
    """One line that says what a route still held that did not end in time, and what it costs."""
    if not snapshot.made_s:
        return 'what is not known: it has told nothing'
    old_s = time.monotonic() - snapshot.made_s
    noun, fate = _LEFT[direction]
    what = 'nothing in flight'
    if snapshot.in_flight:
        what = f'{count(snapshot.in_flight, noun)} in flight, {fate}'
    old = f', as it told {old_s:.0f} s ago' if old_s > _OLD_S else ''
    return f'{what}{old} ({totals(snapshot)})'


def given_up(held: int, *, empty: bool) -> str:
    """What a route from ROS that had to end in time has not done, and what it costs; or nothing.

    Args:
        held: How many messages are not confirmed.
        empty: Whether all was taken.
    """
    left = [f'{held} messages that Kafka has not confirmed'] * bool(held)
    left += ['what was not taken yet'] * (not empty)
    lost = f'gave up {" and ".join(left)}: lost unless the publisher is TRANSIENT_LOCAL'
    return lost if left else ''


def tell_dropped(dropped: int, occasional: Summed) -> None:
    """Say that messages were dropped for others that came behind them."""
    if dropped:
        occasional.warning(f'drop: {dropped} that waited, to keep newer ones (when_full)')


def held(names: Sequence[str], for_s: float) -> str:
    """Say who may be keeping a route waiting, and since when, by the clock of the log.

    Args:
        names: Of the nodes that are waited for; DDS does not tell which of several it is.
        for_s: How long nothing has moved.
    """
    since = clock_time(for_s)
    shown = in_short(names)
    one_of = 'one of ' if len(names) > 1 else ''
    return f'{one_of}{shown}, since {since}' if names else f'since {since}'


def in_short(names: Sequence[str]) -> str:
    """The first of some names, and how many more there are."""
    shown = ', '.join(names[:_MOST_NAMES])
    more = len(names) - _MOST_NAMES
    return f'{shown} and {more} more' if more > 0 else shown


def _rare(snapshot: Snapshot) -> str:
    counts: dict[str, int | None] = {
        'dropped': snapshot.dropped,
        'skipped': snapshot.skipped,
        'returned': snapshot.returned,
        'spooled': snapshot.spooled,
        'lost on a damaged disk': snapshot.lost,
        'published again': snapshot.repeated,
        'sent though their number is there': snapshot.unproved,
        'lost before the bridge': snapshot.lost_upstream,
    }
    return ''.join(f', {number} {name}' for name, number in counts.items() if number)


class StatusLog:
    """A line for each route that moves or waits, again and again, and one for all others.

    Args:
        snapshots: Makes the counters of all routes.
    """

    def __init__(self, snapshots: Callable[[], Iterable[Snapshot]]) -> None:
        self._snapshots = snapshots
        self._before = {snapshot.route: snapshot for snapshot in snapshots()}
        self._said_s = time.monotonic()

    def say(self) -> None:
        """Say how every route is doing, unless that was said just now; called each second."""
        now_s = time.monotonic()
        period_s = now_s - self._said_s
        if period_s < _PERIOD_S - _ASKED_S:
            return
        now = {snapshot.route: snapshot for snapshot in self._snapshots()}
        if period_s < _PERIOD_S:
            return  # an idle route tells once it is asked: what it tells then is said
        idle = [route for route, snapshot in now.items() if self._is_idle(snapshot)]
        if len(idle) > 1:
            text = 'running: %s had nothing to do: %s'
            route_log().info(text, count(len(idle), 'route'), in_short(idle))
        for route, snapshot in now.items():
            if len(idle) > 1 and route in idle:
                continue
            before = self._before.get(route) or Counters(route).snapshot(0)
            per_s = carried_per_s(snapshot, before, period_s)
            told = {'figures': figures(snapshot, per_s)}
            route_log(route).info('%s', status_line(snapshot, per_s), extra=told)
        self._before, self._said_s = now, now_s

    def _is_idle(self, now: Snapshot) -> bool:
        """Whether a route runs, and has moved nothing since the last line."""
        before = self._before.get(now.route)
        if before is None or now.in_flight or now.lag or now.state is not State.RUNNING:
            return False
        return _timeless(now) == _timeless(before)


def _timeless(snapshot: Snapshot) -> Snapshot:
    return snapshot._replace(lag=None, made_s=0.0, beat_s=0.0, measures=Measures())
