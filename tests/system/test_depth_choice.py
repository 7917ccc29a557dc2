"""Which depth is chosen, and how far its estimates can be trusted."""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import pytest

from ros2_kafka_bridge.depth import Choice, Prediction, choose, load, predict
from ros2_kafka_bridge.depth.tail import fit

Times = npt.NDArray[np.int64]
Traffic = Callable[[np.random.Generator, int], tuple[Times, Times]]


def random_traffic(busy: float) -> Traffic:
    """M/M/1."""

    def made(random: np.random.Generator, count: int) -> tuple[Times, Times]:
        arrivals = np.cumsum(random.exponential(1e6, count)).astype(np.int64)
        return arrivals, random.exponential(busy * 1e6, count).astype(np.int64)

    return made


def bursts(random: np.random.Generator, count: int) -> tuple[Times, Times]:
    """Bursts of ten in the mean, at random: M[X]/D/1 with half the time busy."""
    sizes = random.geometric(0.1, count // 5)
    times = np.cumsum(random.exponential(10e6, len(sizes)))
    arrivals = np.repeat(times, sizes)[:count].astype(np.int64)
    return arrivals, np.full(count, 500_000)


def loss_of_random_traffic(busy: float, depth: int) -> float:
    places = depth + 1
    return (1 - busy) * busy**places / (1 - busy ** (places + 1))


# What 600 million messages lost (docs/depth.md).
LOSS_OF_BURSTS = {140: 3.0e-4, 200: 1.1e-5, 240: 1.0e-6}


@pytest.mark.parametrize(
    ('traffic', 'truth'),
    [
        (random_traffic(0.5), {n: loss_of_random_traffic(0.5, n) for n in (11, 15, 18)}),
        (random_traffic(0.8), {n: loss_of_random_traffic(0.8, n) for n in (33, 43, 54)}),
        (bursts, LOSS_OF_BURSTS),
    ],
    ids=['half busy', 'four fifths busy', 'bursts'],
)
def test_the_interval_covers_losses_that_were_not_seen(
    traffic: Traffic, truth: dict[int, float]
) -> None:
    # 1e-4 to 1e-6, of recordings with 50,000 messages: down to a twentieth of one message.
    depths = list(truth)
    covered = np.zeros(len(depths))
    runs = 20
    for run in range(runs):
        arrivals, service = traffic(np.random.default_rng(run), 50_000)
        for place, found in enumerate(predict(arrivals, service, depths)):
            covered[place] += found.low <= truth[found.depth] <= found.high
    # Of 20 intervals with 95 % two or less miss in 92 runs of 100; the seeds are fixed.
    assert covered.min() >= runs - 2, covered / runs


def test_the_recommended_depth_is_enough_and_not_absurd() -> None:
    needed = next(n for n in range(1, 999) if loss_of_random_traffic(0.8, n) <= 1e-6)
    found = [
        choose(*random_traffic(0.8)(np.random.default_rng(run), 50_000), loss=1e-6)
        for run in range(10)
    ]
    recommended = [choice.recommended or 0 for choice in found]
    assert min(recommended) >= needed
    assert np.median(recommended) < 3 * needed
    assert np.median([choice.estimated or 0 for choice in found]) == pytest.approx(needed, rel=0.2)


def test_what_was_seen_is_replayed_and_what_was_not_is_estimated() -> None:
    arrivals, service = random_traffic(0.8)(np.random.default_rng(1), 50_000)
    shallow, deep = predict(arrivals, service, [2, 60])
    assert shallow.seen
    assert shallow.loss == shallow.replayed > 0.1
    assert shallow.low < loss_of_random_traffic(0.8, 2) < shallow.high
    assert not deep.seen
    assert deep.replayed == 0
    assert 0 < deep.loss < 1e-6


def test_the_loss_falls_with_the_depth() -> None:
    arrivals, service = random_traffic(0.8)(np.random.default_rng(1), 50_000)
    found = predict(arrivals, service, range(1, 120))
    assert all(one.low <= one.loss <= one.high for one in found)
    for of in ('loss', 'high'):
        values = [getattr(one, of) for one in found]
        rises = [n for n in range(1, len(values)) if values[n] > 1.1 * values[n - 1]]
        assert not rises, (of, rises)


def test_the_choice_holds_what_it_was_chosen_by() -> None:
    arrivals, service = random_traffic(0.5)(np.random.default_rng(1), 50_000)
    choice = choose(arrivals, service, 1e-5, depths=(10, 100))
    assert choice.recommended is not None
    assert choice.estimated is not None
    by_depth = {one.depth: one for one in choice.predictions}
    assert by_depth.keys() == {10, 100, choice.recommended, choice.estimated}
    assert by_depth[choice.recommended].high <= 1e-5
    [before] = predict(arrivals, service, [choice.recommended - 1])
    assert before.high > 1e-5
    assert by_depth[choice.estimated].loss <= 1e-5
    assert choice.load.busy_periods == pytest.approx(25_000, rel=0.03)
    assert choice.load.utilisation == pytest.approx(0.5, rel=0.03)


def test_the_same_recording_has_the_same_answer() -> None:
    arrivals, service = random_traffic(0.8)(np.random.default_rng(1), 20_000)
    assert choose(arrivals, service[:5000], 1e-6) == choose(arrivals, service[:5000], 1e-6)


def test_a_reader_that_is_too_slow_is_helped_by_no_depth() -> None:
    arrivals = np.arange(10_000) * 1_000_000
    choice = choose(arrivals, 1_250_000, 1e-3)
    assert choice.recommended is None
    assert choice.estimated is None
    assert 'no depth helps; in the long run 20.0% are lost' in ' '.join(choice.notes)
    assert all(one.loss == pytest.approx(0.2, abs=0.02) for one in choice.predictions)
    assert all(one.low <= one.loss <= one.high for one in choice.predictions)


def test_traffic_that_never_waits_is_bounded_by_its_length_alone() -> None:
    arrivals = np.arange(100_000) * 1_000_000
    enough = choose(arrivals, 200_000, 1e-4)
    assert enough.recommended == 1
    too_much = choose(arrivals, 200_000, 1e-6)
    assert too_much.estimated == 1
    assert too_much.recommended is None
    assert 'record longer' in ' '.join(too_much.notes)
    [seen] = predict(arrivals, 200_000, [1])
    assert (seen.loss, seen.low) == (0, 0)
    assert seen.high == pytest.approx(3.7e-5, rel=0.01)  # -ln(0.025) of 100,000


def test_bursts_of_one_size_need_a_queue_of_that_size() -> None:
    # Ten at once every second: one is served, nine wait.
    arrivals = np.repeat(np.arange(2000) * 10**9, 10)
    choice = choose(arrivals, 1_000_000, 1e-4)
    assert choice.estimated in {9, 10}
    assert choice.recommended is not None
    assert 9 <= choice.recommended <= 12


def test_a_rare_long_stall_is_not_taken_for_the_end() -> None:
    # Pareto service: the tail is no exponential, and the bound must say so.
    random = np.random.default_rng(4)
    arrivals = np.cumsum(random.exponential(1e6, 100_000)).astype(np.int64)
    service = ((random.pareto(2.5, 100_000) + 1) * 0.3e6).astype(np.int64)
    [found] = predict(arrivals, service, [200])
    assert found.high > 1.1e-5  # what it really loses, of 600 million


def test_a_short_recording_says_so() -> None:
    arrivals, service = random_traffic(0.5)(np.random.default_rng(1), 200)
    choice = choose(arrivals, service, 1e-6)
    assert '200 messages say little' in choice.notes[0]


def test_a_queue_that_hardly_empties_is_told() -> None:
    # Faster for the second half than the reader: one busy period to the end.
    gaps = np.repeat([2_000_000, 990_000], 5000)
    choice = choose(np.cumsum(gaps), 1_000_000, 1e-3)
    assert 'in one busy period' in ' '.join(choice.notes)


def test_service_times_of_another_recording_are_drawn_from() -> None:
    arrivals, service = random_traffic(0.8)(np.random.default_rng(1), 50_000)
    found = load(arrivals, service[:20_000])
    assert found.utilisation == pytest.approx(0.8, rel=0.05)


def test_an_idle_reader_that_is_slow_to_wake_up_needs_more_depth() -> None:
    # Bursts of eight every 10 ms: by the time the reader has woken up, all eight are there.
    arrivals = np.repeat(np.arange(2000) * 10_000_000, 8) + np.tile(np.arange(8) * 7000, 2000)
    service = 10_000
    at_once = choose(arrivals, service, 0.01)
    woken = choose(arrivals, service, 0.01, wake_ns=200_000)
    assert at_once.load.peak == 2
    assert woken.load.peak == 7
    assert woken.load.wake_seconds == pytest.approx(2e-4)
    assert woken.load.utilisation == at_once.load.utilisation
    assert (at_once.recommended, woken.recommended) == (3, 8)
    [before], [after] = (predict(arrivals, service, [4], wake_ns=wake) for wake in (0, 200_000))
    assert before.loss < 0.01
    assert after.loss == pytest.approx(0.5)
    assert load(arrivals, service, wake_ns=200_000) == woken.load


def test_times_to_wake_up_of_another_recording_are_drawn_with_its_service_times() -> None:
    arrivals, service = random_traffic(0.5)(np.random.default_rng(1), 20_000)
    # The first half of the other recording was asleep: all of it must be drawn from.
    wake = np.repeat([0, 2_000_000], 10_000)
    own = load(arrivals, service, wake_ns=wake)
    drawn = load(arrivals, service[:19_000], wake_ns=wake)
    assert own.busy_periods > 1.1 * drawn.busy_periods


def test_too_few_peaks_make_no_tail() -> None:
    assert fit(np.array([0] * 1000 + [3] * 19), 1, 50, 5000) is None


@pytest.mark.parametrize(
    ('wrong', 'said'),
    [
        (lambda: choose(np.arange(5), 1, 0.0), 'a loss is above 0'),
        (lambda: choose(np.arange(5), 1, -1e-6), 'a loss is above 0'),
        (lambda: choose(np.arange(5), 1, 0.1, confidence=95), 'a confidence is above 0'),
        (lambda: choose(np.arange(1), 1, 0.1), '1 message of one moment'),
        (lambda: choose(np.zeros(5, np.int64), 1, 0.1), '5 messages of one moment'),
        (lambda: predict(np.array([2, 1]), 1, [1]), 'earlier than the one before'),
    ],
)
def test_what_cannot_be_asked_is_refused(
    wrong: Callable[[], Choice | list[Prediction]], said: str
) -> None:
    with pytest.raises(ValueError, match=said):
        wrong()


def test_an_overloaded_reader_loses_more_in_the_long_run_than_its_recording_shows() -> None:
    arrivals = np.arange(2000) * 1_000_000
    [prediction] = predict(arrivals, 1_200_000, [330])
    assert prediction.replayed < 0.01
    assert prediction.loss == pytest.approx(1 - 1 / 1.2, abs=0.01)
    assert not prediction.seen
