"""How the loss goes on beyond the depths that a recording shows.

Peaks over threshold (Pickands 1975; Balkema and de Haan 1974; Coles 2001, ch. 4) on the peaks of
the busy periods of a queue without an end: such periods do not depend on one another. A reader
of depth d loses about peak + 1 - d messages of a busy period that reaches d, so that the loss is
the mean excess over d times the rate of such periods.

The theory of queues says that the tail is exponential (shape 0) where neither bursts nor service
times are heavy-tailed (Kelly 1996). The shape is therefore drawn towards 0 by its prior, with
room for what is not: four fifths narrow, one fifth wide. docs/depth.md has the simulations which
this was chosen by.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import stats

from ros2_kafka_bridge.depth.queue import SEED, Times

Floats = npt.NDArray[np.float64]

FEWEST = 20
"""Peaks above the threshold without which no tail is estimated."""
_WANTED = 100
_DRAWS = 4000
_SHAPES = np.linspace(-0.5, 0.9, 141)
_SCALES = np.geomspace(0.05, 5.0, 110)  # in means of the excess
_LEAST_SCALE = 0.1
_NARROW, _WIDE, _WIDE_SHARE = 0.05, 0.4, 0.2


class Tail(NamedTuple):
    """What is believed of the tail, as draws from its posterior distribution.

    Args:
        threshold: The depth from which on it speaks.
        rates: Messages lost of all, for each message of mean excess; float64[draws].
        shapes: Of the generalized Pareto distribution; float64[draws].
        scales: Of the same, in messages; float64[draws].
    """

    threshold: int
    rates: Floats
    shapes: Floats
    scales: Floats

    def losses(self, depth: int) -> Floats:
        """The loss at a depth of the threshold or more; float64[draws]."""
        return self.rates * _mean_excess(depth - self.threshold, self.shapes, self.scales)


def fit(peaks: Times, threshold: int, lost: int, messages: int) -> Tail | None:
    """Fit the tail.

    Args:
        peaks: The most messages that waited in each busy period.
        threshold: Of `find_threshold`.
        lost: Messages that a reader of that depth loses, replayed.
        messages: How many arrived in all.

    Returns:
        None where too few busy periods reach the threshold to say anything.
    """
    excesses = peaks[peaks >= threshold] - threshold
    if len(excesses) < FEWEST:
        return None
    random = np.random.default_rng(SEED)
    shapes, scales = _draws(excesses, random)
    # A queue with an end is empty earlier, and may fill again in the same busy period.
    more = lost / float((excesses + 1).sum())
    # Jeffreys' prior for the rate of busy periods that reach the threshold.
    numbers = random.gamma(len(excesses) + 0.5, size=_DRAWS)
    return Tail(threshold, more * numbers / messages, shapes, scales)


def find_threshold(peaks: Times) -> int:
    """The largest depth that enough busy periods reach, at least 1."""
    wanted = min(_WANTED, len(peaks))
    return max(1, int(np.partition(peaks, -wanted)[-wanted])) if wanted else 1


def _draws(excesses: Times, random: np.random.Generator) -> tuple[Floats, Floats]:
    """Shapes and scales from their posterior distribution, on a grid."""
    scales = np.unique(np.maximum(_LEAST_SCALE, _SCALES * max(1.0, float(excesses.mean()))))
    shape, scale = (grid.ravel() for grid in np.meshgrid(_SHAPES, scales, indexing='ij'))
    logs = _log_likelihood(excesses, shape, scale) + np.log(_prior(shape))
    weights = np.exp(logs - logs.max())
    places = random.choice(len(weights), _DRAWS, p=weights / weights.sum())
    return shape[places], scale[places]


def _log_likelihood(excesses: Times, shape: Floats, scale: Floats) -> Floats:
    """Of whole numbers: an excess of y stands for all between y and y + 1."""
    values, numbers = np.unique(excesses, return_counts=True)
    total = np.zeros(len(shape))
    for value, number in zip(values, numbers, strict=True):
        share = _survival(value, shape, scale) - _survival(value + 1, shape, scale)
        total += number * np.log(np.maximum(share, 1e-300))
    return total


def _prior(shape: Floats) -> Floats:
    narrow = stats.norm.pdf(shape, scale=_NARROW)
    wide = stats.norm.pdf(shape, scale=_WIDE)
    return np.asarray((1 - _WIDE_SHARE) * narrow + _WIDE_SHARE * wide, np.float64)


def _survival(excess: float, shape: Floats, scale: Floats) -> Floats:
    return np.asarray(stats.genpareto.sf(excess, shape, scale=scale), np.float64)


def _mean_excess(excess: float, shape: Floats, scale: Floats) -> Floats:
    """How many messages beyond `excess`, in the mean of all busy periods above the threshold.

    The half belongs to whole numbers: a peak of y over a depth costs y + 1 messages.
    """
    beyond = np.maximum(0.0, scale + shape * excess) / (1 - shape)
    return _survival(excess, shape, scale) * (beyond + 0.5)
