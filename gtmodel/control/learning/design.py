"""Q for a set of models: as near 1 as monotone convergence allows for every one of them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from ...results import ArgumentError
from .axis import AxisPlant
from .contraction import Peak, frequency_bound
from .estimators import ToolEstimate
from .given import CONTRACTION, LENGTH, SAMPLE_TIME

GRID, FINE = 501, 5001  # frequencies of the design, and of its check
SHIFT_GRID = 200  # frequencies below the cutoff
LEAST_AT_REST = 0.5  # of Q: below, even a constant error stays
STEEPNESS = 8  # of the low pass, as of the square of a Butterworth filter of fourth order


@dataclass(frozen=True, eq=False)
class RobustFilter:
    """A zero-phase filter Q and how it was designed.

    taps: (m + 1,) for the lags 0 to m, both ways. frequency: (k,) [Hz], at which follow response: of the realised Q,
    and rest: the largest |1 - L T| over the models (k,). bound: sup |Q| |1 - L T| of the realised Q over the set and
    over frequency; `cutoff` [Hz], above which Q falls.
    """

    taps: np.ndarray
    frequency: np.ndarray
    response: np.ndarray
    rest: np.ndarray
    bound: Peak
    cutoff: float


def robust_filter(
    rests: Any,
    frequency: Any,
    cutoff: float,
    *,
    contraction: float = CONTRACTION,
    length: int = LENGTH,
    sample_time: float = SAMPLE_TIME,
) -> RobustFilter:
    """Q near min(low pass, contraction / max |1 - L T|), realised with finite length, its bound checked on the result.

    Args:
        rests: |1 - L T| of each model (models, k). frequency: (k,) from 0 to half the sampling rate [Hz].
        cutoff: of the low pass [Hz]. contraction: what the bound shall be, below 1.
        length: lags on either side, in samples.

    The taps are the linear program that makes Q largest below those limits, low frequencies first. Raises ArgumentError
    where the realised filter does not keep the bound below 1 or hardly learns, or for numbers out of range.

    >>> learning = gt.control.learning
    >>> f = learning.frequencies(0.004, 2001)
    >>> loop = learning.flexible_axis(11.5, 0.05).responses(f)["tool"]
    >>> Q = learning.robust_filter([abs(1 - 0.9 * np.exp(2j * np.pi * f * 0.04) * loop)], f, cutoff=30.0)
    >>> Q.bound.value < 0.94, float(Q.response[0]) > 0.99
    (True, True)
    """
    f, worst = np.asarray(frequency, float), np.max(np.atleast_2d(np.abs(np.asarray(rests))), axis=0)
    if not 0 < contraction < 1:
        raise ArgumentError(f"expected a contraction between 0 and 1; found {contraction:g}", "contraction")
    if not 0 < cutoff < 0.5 / sample_time:
        raise ArgumentError(f"expected a cutoff above 0 and below {0.5 / sample_time:g} Hz; found {cutoff:g}", "cutoff")
    if worst.shape != f.shape or not np.all(np.isfinite(worst)):
        raise ArgumentError(f"expected finite numbers at {len(f)} frequencies; found {worst.shape}", "rests")
    grid = np.linspace(0.0, 0.5 / sample_time, GRID)
    # between two frequencies of the program the limit of the larger one holds
    coarse = np.interp(grid, f, scipy.ndimage.maximum_filter1d(worst, max(1, 2 * (len(f) // GRID) + 1)))
    limit = np.minimum(1 / (1 + (grid / cutoff) ** STEEPNESS), contraction / np.maximum(coarse, contraction))
    rows = _cosines(grid, length, sample_time)
    weights = 1 / (1 + grid / 5.0)
    solved = scipy.optimize.linprog(
        -(weights @ rows), A_ub=np.vstack([rows, -rows]), b_ub=np.concatenate([limit, np.zeros(GRID)]),
        bounds=(None, None), method="highs",
    )  # fmt: skip
    if solved.status != 0:
        raise ArgumentError(f"no filter of {length} lags keeps the limits; take a longer one", "length")
    taps = np.asarray(solved.x)
    response = _cosines(f, length, sample_time) @ taps
    bound = frequency_bound(response, worst, f)
    if bound.value >= 1:
        raise ArgumentError(
            f"|Q| |1 - L T| reaches {bound.value:.3g} at {bound.frequency:.3g} Hz for one of the models, so learning "
            "would diverge; take more lags, a lower cutoff, or another shift",
            "cutoff",
        )
    if response[0] < LEAST_AT_REST:
        raise ArgumentError(
            f"with {length} lags the models leave a Q of {response[0]:.2g} at rest, which learns next to nothing; take "
            "more lags, a smaller set of models, or the shift of the delay of what is controlled",
            "length",
        )
    return RobustFilter(taps, f, response, worst, bound, cutoff)


def rests_of(
    estimates: ToolEstimate, plants: Sequence[AxisPlant], gain: float, shift: int, frequency: np.ndarray
) -> np.ndarray:
    """|1 - gain q^shift (F_u + F_y T)| of each plant (plants, k), at frequencies (k,) [Hz].

    >>> learning = gt.control.learning
    >>> f = learning.frequencies(0.004, 11)
    >>> learning.rests_of(learning.measured(300), [learning.flexible_axis(11.5, 0.05)], 0.9, 10, f).shape
    (1, 11)
    """
    z = np.exp(2j * np.pi * frequency * plants[0].sample_time)
    return np.array([np.abs(1 - gain * z**shift * estimates.response(p, frequency)) for p in plants])


def best_shift(
    estimates: ToolEstimate, plants: Sequence[AxisPlant], gain: float, cutoff: float, shifts: Iterable[int] = range(25)
) -> int:
    """The shift with the least |1 - L T| below the cutoff [Hz], squared, of the worst model at each frequency.

    It is the lag of what is controlled: of the motor loop and of the tool behind it.

    >>> learning = gt.control.learning
    >>> learning.best_shift(learning.kinematic(300), [learning.flexible_axis(11.5, 0.05)], gain=0.9, cutoff=10.0)
    10
    """
    f = np.linspace(0.0, cutoff, SHIFT_GRID)
    left = {n: float(np.mean(rests_of(estimates, plants, gain, n, f).max(axis=0) ** 2)) for n in shifts}
    return min(left, key=left.__getitem__)


def _cosines(frequency: np.ndarray, length: int, sample_time: float) -> np.ndarray:
    """Responses (k, length + 1) of taps of 1."""
    rows = 2 * np.cos(2 * np.pi * np.outer(frequency * sample_time, np.arange(length + 1)))
    rows[:, 0] = 1.0
    return rows
