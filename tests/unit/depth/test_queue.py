"""The replay of a KEEP_LAST queue: worked by hand, against a slow simulation, against theory."""

from collections import deque
from itertools import cycle
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ros2_kafka_bridge.depth import replay, resample


class Case(NamedTuple):
    """Arrivals and service times, a depth, and what is lost and found waiting."""

    arrivals: list[int]
    service: list[int] | int
    depth: int | None
    lost: int
    waiting: list[int]
    wake: list[int] | int = 0


BY_HAND = {
    # 0 is served from 0 to 10, and so on: nobody ever waits.
    'each is served before the next comes': Case([0, 10, 20], 5, 1, 0, [0, 0, 0]),
    # 0-10 serves the first; 2 waits; 4 finds one waiting at depth 1, and pushes it out.
    'a third in a row pushes the second out': Case([0, 2, 4], 10, 1, 1, [0, 0, 1]),
    'with room for two it does not': Case([0, 2, 4], 10, 2, 0, [0, 0, 1]),
    # At 10 the first callback ends and the second message is taken, before the third arrives.
    'an end comes before an arrival of the same time': Case([0, 5, 10], 10, 1, 0, [0, 0, 0]),
    # At 0 the first is taken at once; of the other four two fit.
    'a burst of five at depth two': Case([0, 0, 0, 0, 0], 10, 2, 2, [0, 0, 1, 2, 2]),
    # Served: 0-3, 3-4 (waited from 1), 4-5 (from 2), 10-12.
    'service times belong to the messages served': Case(
        [0, 1, 2, 10], [3, 1, 1, 2], None, 0, [0, 0, 1, 0]
    ),
    # Depth 1: 0-4 (first), at 1 one waits, at 2 and 3 it is replaced: two are lost. The second
    # served begins at 4 and takes 9, to 13; 5 waits, 6 replaces it, taken at 13.
    'what is lost takes no service time': Case(
        [0, 1, 2, 3, 5, 6], [4, 9, 1, 1, 1, 1], 1, 3, [0, 0, 1, 1, 0, 1]
    ),
    'no depth loses nothing': Case([0, 0, 0, 0], 100, None, 0, [0, 0, 1, 2]),
    'no messages': Case([], 1, 1, 0, []),
    'no messages, and a slow start': Case([], 1, 1, 0, [], 5),
    # The first waits from 0 to 6, where it is begun: at 2 and 4 it is not yet gone, at 6 it is.
    'the message that wakes the reader waits': Case([0, 2, 4, 6], 1, None, 0, [0, 1, 2, 2], 6),
    # The first waits until 3; 1 pushes it out, 2 that one. Begun at 3, over at 13; 5 waits.
    'it can be pushed out itself': Case([0, 1, 2, 5], 10, 1, 2, [0, 1, 1, 0], 3),
    # 0 is begun at 3, over at 5; what waited goes on at once. At 7 all is done.
    'a busy reader needs not be woken': Case([0, 2, 7, 8], 2, 2, 0, [0, 1, 0, 1], 3),
    # The first is over at 5: the second meets an idle reader, and is not gone at 6.
    'a message at the end of a callback wakes the reader': Case(
        [0, 5, 6], 3, None, 0, [0, 0, 1], 2
    ),
    # Woken at 0, 10, 20: 4, 1 and 4 again (0-4, 10-11, 20-24).
    'times to wake up are those of the messages that wake': Case(
        [0, 3, 4, 10, 11, 20, 23], 1, 9, 0, [0, 1, 1, 0, 0, 0, 1], [4, 1]
    ),
}


@pytest.mark.parametrize('case', BY_HAND.values(), ids=BY_HAND.keys())
def test_worked_by_hand(case: Case) -> None:
    service = np.array(case.service) if isinstance(case.service, list) else case.service
    wake = np.array(case.wake) if isinstance(case.wake, list) else case.wake
    found = replay(np.array(case.arrivals, np.int64), service, case.depth, wake)
    assert found.lost == case.lost
    assert found.waiting.tolist() == case.waiting
    assert found.loss == pytest.approx(case.lost / max(1, len(case.arrivals)))


class Slowly(NamedTuple):
    """Which messages are lost, what each arrival found, and whether it met an idle reader."""

    lost: set[int]
    found: list[int]
    idle: list[bool]


def slowly(arrivals: list[int], service: list[int], depth: int | None, wake: list[int]) -> Slowly:
    """A queue that drops its oldest, one step of the clock after the other."""
    waiting: deque[int] = deque()
    done = Slowly(set(), [], [])
    coming, services, wakes = deque(enumerate(arrivals)), iter(service), cycle(wake)
    busy_until, begins_at = 0, 0

    def take(now: int) -> None:
        nonlocal busy_until
        while waiting and now >= max(busy_until, begins_at):
            waiting.popleft()
            busy_until = now + next(services)

    for now in range((arrivals or [0])[-1] + 1):
        take(now)
        while coming and coming[0][1] == now:
            number, _ = coming.popleft()
            idle = not waiting and now >= busy_until
            done.idle.append(idle)
            done.found.append(len(waiting))
            if len(waiting) == depth:
                done.lost.add(waiting.popleft())
            waiting.append(number)
            if idle:
                begins_at = now + next(wakes)
            take(now)
    return done


TRAFFIC = st.lists(st.tuples(st.integers(0, 6), st.integers(0, 9)), max_size=60)


WAKE = st.one_of(st.just([0]), st.lists(st.integers(0, 12), min_size=1, max_size=5))


@given(traffic=TRAFFIC, depth=st.one_of(st.none(), st.integers(1, 8)), wake=WAKE)
def test_it_does_what_a_slow_simulation_does(
    traffic: list[tuple[int, int]], depth: int | None, wake: list[int]
) -> None:
    arrivals = np.cumsum([gap for gap, _ in traffic], dtype=np.int64)
    service = np.array([time for _, time in traffic], np.int64)
    slow = slowly(arrivals.tolist(), service.tolist(), depth, wake)
    found = replay(arrivals, service, depth, np.array(wake))
    assert found.lost == len(slow.lost)
    assert found.waiting.tolist() == slow.found
    assert found.idle.tolist() == slow.idle


@given(gaps=st.lists(st.integers(0, 6), min_size=1, max_size=60), service=st.integers(0, 9))
def test_a_deeper_queue_loses_no_more(gaps: list[int], service: int) -> None:
    arrivals = np.cumsum(gaps, dtype=np.int64)
    losses = [replay(arrivals, service, depth).lost for depth in range(1, 12)]
    assert losses == sorted(losses, reverse=True)


@given(traffic=TRAFFIC, wake=WAKE)
def test_a_queue_as_deep_as_its_highest_peak_loses_nothing(
    traffic: list[tuple[int, int]], wake: list[int]
) -> None:
    arrivals = np.cumsum([gap for gap, _ in traffic], dtype=np.int64)
    service = np.array([time for _, time in traffic], np.int64)
    times = np.array(wake)
    endless = replay(arrivals, service, None, times)
    peak = int(endless.waiting.max(initial=0))
    assert endless.lost == 0
    assert replay(arrivals, service, peak + 1, times).lost == 0
    assert not peak or replay(arrivals, service, peak, times).lost > 0


@pytest.mark.parametrize(('load', 'depth'), [(0.5, 1), (0.8, 5), (0.9, 10), (1.2, 3)])
def test_random_arrivals_and_service_lose_what_theory_says(load: float, depth: int) -> None:
    # M/M/1/K: K = depth waiting and one in service.
    random = np.random.default_rng(1)
    count = 400_000
    arrivals = np.cumsum(random.exponential(1e6, count)).astype(np.int64)
    service = random.exponential(load * 1e6, count).astype(np.int64)
    places = depth + 1
    theory = (1 - load) * load**places / (1 - load ** (places + 1))
    assert replay(arrivals, service, depth).loss == pytest.approx(theory, rel=0.04)


@pytest.mark.parametrize(('load', 'depth'), [(0.6, 1), (0.8, 2), (0.9, 4)])
def test_random_arrivals_of_one_size_lose_what_theory_says(load: float, depth: int) -> None:
    arrivals = np.cumsum(np.random.default_rng(2).exponential(1e6, 400_000)).astype(np.int64)
    theory = m_d_1_k(load, depth + 1)
    assert replay(arrivals, int(load * 1e6), depth).loss == pytest.approx(theory, rel=0.04)


def m_d_1_k(load: float, places: int) -> float:
    """Loss of M/D/1/K, by the chain of what each departure leaves behind (Gross and Harris)."""
    coming = [np.exp(-load) * load**k / np.prod(np.arange(1, k + 1)) for k in range(places + 1)]
    left = np.zeros((places, places))
    for state in range(places):
        base = max(state - 1, 0)
        for more in range(places - base):
            left[state, base + more] = coming[more]
        left[state, places - 1] += 1 - left[state].sum()
    values, vectors = np.linalg.eig(left.T)
    steady = np.real(vectors[:, np.argmin(abs(values - 1))])
    steady /= steady.sum()
    return float(1 - 1 / (steady[0] + load))


def test_a_million_messages_lose_what_theory_says() -> None:
    random = np.random.default_rng(3)
    arrivals = np.cumsum(random.exponential(1e6, 1_000_000)).astype(np.int64)
    service = random.exponential(0.8e6, 1_000_000).astype(np.int64)
    assert replay(arrivals, service, 10).loss == pytest.approx(0.0184, rel=0.05)
    assert replay(arrivals, service, None).lost == 0


@pytest.mark.parametrize(
    ('arrivals', 'service', 'depth', 'said'),
    [
        ([1, 3, 2], 1, 1, 'arrival 3 is earlier'),
        ([1, 2], [1, 2, 3], 1, '2 arrivals, but 3 service times'),
        ([1, 2], -1, 1, 'service time is negative'),
        ([1, 2], 1, 0, 'depth is 1 or more'),
        ([[1, 2]], 1, 1, 'one row'),
    ],
)
def test_what_is_no_traffic_is_refused(
    arrivals: list[int], service: list[int] | int, depth: int, said: str
) -> None:
    times = np.array(service) if isinstance(service, list) else service
    with pytest.raises(ValueError, match=said):
        replay(np.array(arrivals), times, depth)


@pytest.mark.parametrize(
    ('wake', 'said'), [(-1, 'negative'), ([3, -1], 'negative'), ([], 'one number'), ([[1]], 'row')]
)
def test_what_is_no_time_to_wake_up_is_refused(wake: int | list[int], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        replay(np.array([1, 2]), 1, 1, np.array(wake))


def test_drawn_service_times_keep_their_runs_and_their_mean() -> None:
    # Slow ones come in runs of fifty.
    recorded = np.tile(np.repeat([100, 900], 50), 100)
    drawn = resample(recorded, 30_000)
    assert len(drawn) == 30_000
    assert drawn.mean() == pytest.approx(500, rel=0.1)
    changes = np.count_nonzero(np.diff(drawn))
    assert changes < 1500  # 15,000 where each is drawn by itself
    assert np.array_equal(drawn, resample(recorded, 30_000))


def test_service_times_cannot_be_drawn_from_none() -> None:
    with pytest.raises(ValueError, match='no service times'):
        resample(np.array([], np.int64), 5)
