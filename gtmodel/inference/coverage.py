"""Do intervals hold the truth as often as they say? Judged by the exact binomial band."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from ..results.estimate import Estimate, half_width
from ..results.refusal import ArgumentError

BAND = 0.999  # two-sided: one perfect interval in a thousand falls outside
POOLED = (0.94, 0.96)


def binomial_band(runs: int, level: float = 0.95, band: float = BAND) -> tuple[int, int]:
    """Smallest and largest number of hits that an interval of true coverage `level` has in `runs` runs.

    The hits lie within both numbers with probability `band`: no more than (1 - band) / 2 lies beyond either end.

    >>> gt.inference.binomial_band(200), gt.inference.binomial_band(500)
    ((179, 198), (458, 489))
    """
    tail = (1 - band) / 2
    below = scipy.special.bdtr(np.arange(runs + 1.0), runs, level)  # scipy.stats takes long to import
    return int(np.searchsorted(below, tail)), int(np.searchsorted(below, 1 - tail))


@dataclass(frozen=True, eq=False)
class Coverage:
    """How often the intervals of each name held the truth.

    `hits` (n,) of `runs` runs at confidence `level`; `bias` (n,) is the mean error over its standard error.
    """

    names: tuple[str, ...]
    hits: np.ndarray
    runs: int
    level: float
    bias: np.ndarray

    @property
    def band(self) -> tuple[int, int]:
        """Smallest and largest number of hits that chance allows, see binomial_band()."""
        return binomial_band(self.runs, self.level)

    @property
    def pooled(self) -> float:
        """Share of hits over all names."""
        return float(self.hits.sum() / (self.runs * len(self.names)))

    @property
    def outside(self) -> tuple[str, ...]:
        """Names whose hits lie outside the band."""
        low, high = self.band
        return tuple(n for n, h in zip(self.names, self.hits, strict=True) if not low <= h <= high)

    @property
    def biased(self) -> tuple[str, ...]:
        """Names whose mean error is larger than chance makes it in so many runs, at the band's level for all names."""
        limit = half_width(1 - (1 - BAND) / len(self.names))
        return tuple(n for n, b in zip(self.names, self.bias, strict=True) if abs(b) > limit)

    @property
    def passed(self) -> bool:
        """Every name inside the band and unbiased, and the pooled coverage within one per cent of the level."""
        return not self.outside and not self.biased and POOLED[0] <= self.pooled + 0.95 - self.level <= POOLED[1]

    def __str__(self) -> str:
        low, high = self.band
        width = max(len(n) for n in self.names)
        rows = [f"{n:{width}s}  {h:5d}  {b:6.2f}" for n, h, b in zip(self.names, self.hits, self.bias, strict=True)]
        head = f"{self.runs} runs, {self.level:.0%} intervals: {low}..{high} hits expected, pooled {self.pooled:.2%}"
        return "\n".join([head, f"{'':{width}s}  {'hits':>5s}  {'bias':>6s}", *rows])


def coverage(estimates: Sequence[Estimate], truth: Mapping[str, float], *, level: float = 0.95) -> Coverage:
    """How often the intervals of repeated fits hold the `truth`, name -> true value, for the names in it.

    Raises ArgumentError for no runs, for no true values, and for a name that was not estimated.

    >>> def run(rng, k):  # the mean of ten synthetic values
    ...     return gt.inference.linear_fit(np.ones((10, 1)), 3 + 0.2 * rng.normal(size=10), ["m"])
    >>> runs = gt.inference.monte_carlo(run, 100, seed=1, processes=0)
    >>> seen = gt.inference.coverage(runs.results, {"m": 3.0})
    >>> seen.band, seen.outside, seen.biased
    ((87, 100), (), ())
    """
    if not estimates:
        raise ArgumentError("coverage needs runs; found none", "estimates")
    if not truth:
        raise ArgumentError("expected a true value of one name or more; found none", "truth")
    names, true = tuple(truth), np.array(list(truth.values()), float)
    hits, errors = np.zeros(len(truth), int), np.zeros((len(estimates), len(truth)))
    for run, e in enumerate(estimates):
        low, high = e.intervals(names, level)
        hits += (low <= true) & (true <= high)
        errors[run] = [e.value(name) for name in names] - true
    spread = errors.std(axis=0, ddof=1) if len(estimates) > 1 else np.ones(len(truth))
    bias = errors.mean(axis=0) / np.where(spread > 0, spread, 1.0) * np.sqrt(len(estimates))
    return Coverage(names, hits, len(estimates), level, bias)
