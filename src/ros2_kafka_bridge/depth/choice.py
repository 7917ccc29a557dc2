"""Which depth a reader needs: replayed as far as the recording goes, estimated beyond it."""

from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import stats

from ros2_kafka_bridge.depth.queue import Replay, Times, checked, replay, resample
from ros2_kafka_bridge.depth.tail import FEWEST, Floats, Tail, find_threshold, fit
from ros2_kafka_bridge.logs.text import count

USUAL_DEPTHS = (10, 100, 200)
DEEPEST = 100_000
"""No deeper queue is looked for."""
_FEWEST_MESSAGES = 1000
_BLOCKS = 20
_LARGE_SHARE = 0.2
_NEARLY_FULL = 0.95
_HEAVY = 0.15
_FAR = 1.0  # messages of the recording that the wanted loss would be


class Workload(NamedTuple):
    """What a recording asks of its reader.

    Args:
        messages: How many arrived.
        seconds: From the first to the last.
        rate: Messages per second.
        utilisation: Time of service over time; a queue with 1 or more grows without end.
        wake_seconds: From a message's arrival to its callback where the reader is idle; median.
        peak: The most messages that waited at once in a queue without an end.
        busy_periods: How often the reader was idle and then busy.
    """

    messages: int
    seconds: float
    rate: float
    utilisation: float
    wake_seconds: float
    peak: int
    busy_periods: int


class Prediction(NamedTuple):
    """The loss at one depth.

    Args:
        depth: Of the KEEP_LAST queue.
        loss: Share of the messages that are lost, 0 to 1.
        low: Lower end of the interval.
        high: Upper end of the interval.
        seen: Whether `loss` is replayed; False: estimated, from the busy periods with the longest
            queues, because too few or none of the recording reach this depth.
        replayed: Share that was lost in the replay of this recording.
    """

    depth: int
    loss: float
    low: float
    high: float
    seen: bool
    replayed: float


class Choice(NamedTuple):
    """The answer.

    Args:
        recommended: The smallest depth whose loss stays under the wanted one with the
            confidence asked for; None where no depth does, or none can be told.
        estimated: The smallest depth whose estimated loss does; None where no depth does.
        loss: The wanted one.
        confidence: Of the intervals.
        load: What the recording asks of the reader.
        predictions: At the usual depths and at the two above.
        notes: What limits the answer, a sentence each.
    """

    recommended: int | None
    estimated: int | None
    loss: float
    confidence: float
    load: Workload
    predictions: tuple[Prediction, ...]
    notes: tuple[str, ...]


def load(arrivals_ns: Times, service_ns: Times | int, *, wake_ns: Times | int = 0) -> Workload:
    """What a recording asks of its reader; the arguments are those of `choose`."""
    return _Queue(fitted(arrivals_ns, service_ns, wake_ns), 0.95).load


def predict(
    arrivals_ns: Times,
    service_ns: Times | int,
    depths: Sequence[int],
    confidence: float = 0.95,
    *,
    wake_ns: Times | int = 0,
) -> list[Prediction]:
    """The loss at each of the depths; the arguments are those of `choose`."""
    queue = _Queue(fitted(arrivals_ns, service_ns, wake_ns), confidence)
    return [queue.predict(depth) for depth in depths]


def choose(
    arrivals_ns: Times,
    service_ns: Times | int,
    loss: float,
    confidence: float = 0.95,
    depths: Sequence[int] = USUAL_DEPTHS,
    *,
    wake_ns: Times | int = 0,
) -> Choice:
    """Find the smallest depth for a wanted loss.

    Args:
        arrivals_ns: When each message arrives, int64[n], not decreasing.
        service_ns: How long each callback takes: one number for all; int64[n], recorded with the
            arrivals; or a recording of another length, from which blocks are drawn
            (`queue.resample`).
        loss: Share of the messages that may be lost, above 0 and below 1.
        confidence: Of the intervals, above 0 and below 1.
        depths: Where the loss is predicted, too.
        wake_ns: How long an idle reader takes to begin (`queue.replay`). Where service times are
            drawn from another recording, these are, too.

    Raises:
        ValueError: An argument is not of this kind, or all messages are of one moment.
    """
    if not 0 < loss < 1:
        raise ValueError(f'a loss is above 0 and below 1, not {loss:g}')
    if not 0 < confidence < 1:
        raise ValueError(f'a confidence is above 0 and below 1, not {confidence:g}')
    queue = _Queue(fitted(arrivals_ns, service_ns, wake_ns), confidence)
    recommended = queue.smallest(lambda prediction: prediction.high <= loss)
    estimated = queue.smallest(lambda prediction: prediction.loss <= loss)
    shown = {*depths, *(depth for depth in (recommended, estimated) if depth is not None)}
    return Choice(
        recommended=recommended,
        estimated=estimated,
        loss=loss,
        confidence=confidence,
        load=queue.load,
        predictions=tuple(queue.predict(depth) for depth in sorted(shown)),
        notes=tuple(_notes(queue, loss, recommended)),
    )


class Fitted(NamedTuple):
    """Arrivals, and service times and times to wake up that fit them."""

    arrivals: Times
    service: Times
    wake: Times


class _Queue:
    """A recording with what is known of its queue.

    Args:
        fitted: What was recorded.
        confidence: Of the intervals.
    """

    def __init__(self, fitted: Fitted, confidence: float) -> None:
        self._fitted = fitted
        self._confidence = confidence
        endless = self._replay(None)
        self._period = np.cumsum(endless.idle) - 1  # which busy period each arrival belongs to
        begins = np.flatnonzero(endless.idle)
        self.peaks = np.maximum.reduceat(endless.waiting, begins)
        self.longest = int(np.diff(np.append(begins, len(fitted.arrivals))).max())
        self.load = _load(fitted, self.peaks)
        self.predict = lru_cache(maxsize=None)(self._predict)
        self._threshold = find_threshold(self.peaks)
        self.tail = self._fit() if self.stable else None

    @property
    def stable(self) -> bool:
        """Whether the reader is fast enough at all."""
        return self.load.utilisation < 1

    def smallest(self, fits: Callable[[Prediction], bool]) -> int | None:
        """The smallest depth whose prediction fits; None where none does."""
        deepest = 1
        while not fits(self.predict(deepest)):
            # Without a tail nothing is known beyond the highest peak.
            if deepest == DEEPEST or (self.tail is None and deepest > self.load.peak):
                return None
            deepest = min(2 * deepest, DEEPEST)
        too_small = deepest // 2
        while deepest - too_small > 1:
            middle = (too_small + deepest) // 2
            if fits(self.predict(middle)):
                deepest = middle
            else:
                too_small = middle
        return deepest

    def _fit(self) -> Tail | None:
        lost = self._replay(self._threshold).lost
        return fit(self.peaks, self._threshold, lost, self.load.messages)

    def _replay(self, depth: int | None) -> Replay:
        arrivals, service, wake = self._fitted
        return replay(arrivals, service, depth, wake)

    def _predict(self, depth: int) -> Prediction:
        # No message can be lost where fewer ever wait.
        reached = depth <= self.load.peak
        is_lost = self._replay(depth).is_lost if reached else np.zeros(self.load.messages, bool)
        replayed = float(is_lost.mean())
        if not self.stable:
            # A deep queue only puts the loss off, to beyond the end of the recording.
            least = 1 - 1 / self.load.utilisation
            low, high = _between_blocks(is_lost, self._confidence)
            loss = max(replayed, least)
            is_seen = reached and replayed >= least
            return Prediction(depth, loss, low, max(high, least), is_seen, replayed)
        if self.tail is None or depth <= self.tail.threshold:
            low, high = self._between_periods(
                np.bincount(self._period, is_lost).astype(np.float64)
            )
            return Prediction(depth, replayed, low, high, reached, replayed)
        outside = (1 - self._confidence) / 2
        losses = np.minimum(1.0, self.tail.losses(depth))
        low, middle, high = (float(q) for q in np.quantile(losses, (outside, 0.5, 1 - outside)))
        return Prediction(depth, middle, low, high, seen=False, replayed=replayed)

    def _between_periods(self, lost: Floats) -> tuple[float, float]:
        """The interval of a replayed loss: busy periods that lose come as a Poisson process.

        Each weighs as many messages as it loses (Fay and Feuer 1997). One that was not seen may
        weigh as much as the heaviest.
        """
        total, squares = float(lost.sum()), float((lost**2).sum())
        heaviest = float(lost.max()) if total else float(max(1, self.load.peak))
        outside = (1 - self._confidence) / 2
        low = 0.0
        if total:
            low = squares / total / 2 * stats.chi2.ppf(outside, 2 * total**2 / squares)
        more, more_squares = total + heaviest, squares + heaviest**2
        freedom = 2 * more**2 / more_squares
        high = more_squares / more / 2 * stats.chi2.ppf(1 - outside, freedom)
        return float(low) / self.load.messages, min(1.0, float(high) / self.load.messages)


def _between_blocks(is_lost: npt.NDArray[np.bool_], confidence: float) -> tuple[float, float]:
    """The interval of a loss that never ends, from blocks of the recording, one after another."""
    shares = [float(block.mean()) for block in np.array_split(is_lost, _BLOCKS) if len(block)]
    mean, freedom = float(np.mean(shares)), max(1, len(shares) - 1)
    error = float(np.std(shares, ddof=min(1, freedom))) / len(shares) ** 0.5
    half = error * float(stats.t.ppf((1 + confidence) / 2, freedom))
    return max(0.0, mean - half), min(1.0, mean + half)


def fitted(arrivals_ns: Times, service_ns: Times | int, wake_ns: Times | int) -> Fitted:
    """Arrivals and as many service times, checked."""
    service = np.asarray(service_ns, np.int64)
    wake = np.atleast_1d(np.asarray(wake_ns, np.int64))
    if service.ndim and len(service) != len(arrivals_ns):
        service = resample(service, len(arrivals_ns))
        wake = resample(wake, len(arrivals_ns))
    arrivals, service = checked(arrivals_ns, service)
    if not len(arrivals) or arrivals[0] == arrivals[-1]:
        raise ValueError(f'{count(len(arrivals), "message")} of one moment have no rate')
    return Fitted(arrivals, service, wake)


def _load(fitted: Fitted, peaks: Times) -> Workload:
    arrivals, service, wake = fitted
    span_ns = int(arrivals[-1] - arrivals[0])
    work_ns = int(service[:-1].sum())
    return Workload(
        messages=len(arrivals),
        seconds=span_ns / 1e9,
        rate=(len(arrivals) - 1) / span_ns * 1e9,
        utilisation=work_ns / span_ns,
        wake_seconds=float(np.median(wake)) / 1e9,
        peak=int(peaks.max()),
        busy_periods=len(peaks),
    )


def _notes(queue: _Queue, loss: float, recommended: int | None) -> Iterator[str]:
    """What limits the answer."""
    load, tail = queue.load, queue.tail
    if load.messages < _FEWEST_MESSAGES:
        yield (
            f'{count(load.messages, "message")} say little: record {_FEWEST_MESSAGES} or more, '
            'over the busiest time'
        )
    if not queue.stable:
        least = 1 - 1 / load.utilisation
        yield (
            f'the reader is too slow: its callbacks take {load.utilisation:.2f} times the time '
            f'there is, so that no depth helps; in the long run {least:.1%} are lost: make the '
            'callback faster, share the topic between several readers, or slow the source '
            '(max_rate)'
        )
        return
    if load.utilisation > _NEARLY_FULL:
        yield (
            f'the reader is busy {load.utilisation:.1%} of the time: a little more traffic, and '
            'no depth helps'
        )
    if queue.longest > _LARGE_SHARE * load.messages:
        yield (
            f'{queue.longest / load.messages:.0%} of the messages came in one busy period: the '
            'recording is too short for what it shows, or its rate changes; record longer'
        )
    if tail is None:
        yield (
            f'messages waited in fewer than {FEWEST} busy periods: nothing is estimated beyond '
            f'what was seen, and bounds stay at {queue.predict(load.peak + 1).high:.1e}'
        )
    elif float(np.median(tail.shapes)) > _HEAVY:
        yield (
            'the longest queues are much longer than the others (heavy tail): more depth helps '
            'slowly; look for what holds the callback up, or for the bursts, and record longer'
        )
    if recommended is None:
        yield (
            f'no depth can be named for a loss of {loss:g} with this confidence: record longer, '
            'or ask for a larger loss'
        )
    elif loss * load.messages < _FAR:
        yield (
            f'a loss of {loss:g} is one message in {1 / loss:,.0f}, and the recording has '
            f'{load.messages:,}: the answer rests on the tail going on as it began'
        )
