"""Independent runs by seed in parallel processes with one BLAS thread each, and coverage of confidence intervals."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import scipy

from ..results.estimate import Estimate, half_width
from ..results.refusal import ArgumentError
from ..results.work import CREW, Crew
from ..workers.mapped import shared

BAND = 0.999  # two-sided: one correct interval in a thousand falls outside
POOLED = (0.94, 0.96)


def binomial_band(runs: int, level: float = 0.95, band: float = BAND) -> tuple[int, int]:
    """Return the smallest and largest plausible number of hits in `runs` runs, for intervals of true coverage `level`.

    The number of hits is inside with probability `band`; each tail has at most (1 - band) / 2.

    >>> gt.inference.binomial_band(200), gt.inference.binomial_band(500)
    ((179, 198), (458, 489))
    """
    tail = (1 - band) / 2
    below = scipy.special.bdtr(np.arange(runs + 1.0), runs, level)  # scipy.stats takes long to import
    return int(np.searchsorted(below, tail)), int(np.searchsorted(below, 1 - tail))


@dataclass(frozen=True, eq=False)
class Coverage:
    """How often the intervals of each name contained the truth.

    `hits` (n,) in `runs` runs at confidence `level`; `bias` (n,) is the mean error over its standard error.
    """

    names: tuple[str, ...]
    hits: np.ndarray
    runs: int
    level: float
    bias: np.ndarray

    @property
    def band(self) -> tuple[int, int]:
        """Smallest and largest plausible number of hits, see binomial_band()."""
        return binomial_band(self.runs, self.level)

    @property
    def pooled(self) -> float:
        """Share of hits over all names."""
        return float(self.hits.sum() / (self.runs * len(self.names)))

    @property
    def outside(self) -> tuple[str, ...]:
        """Names whose hits are outside the band."""
        low, high = self.band
        return tuple(n for n, h in zip(self.names, self.hits, strict=True) if not low <= h <= high)

    @property
    def biased(self) -> tuple[str, ...]:
        """Names with a significant mean error, at the level of the band for all names together."""
        limit = half_width(1 - (1 - BAND) / len(self.names))
        return tuple(n for n, b in zip(self.names, self.bias, strict=True) if abs(b) > limit)

    @property
    def passed(self) -> bool:
        """Whether each name is inside the band and unbiased, and the pooled coverage within one per cent of `level`."""
        return not self.outside and not self.biased and POOLED[0] <= self.pooled + 0.95 - self.level <= POOLED[1]

    def __str__(self) -> str:
        low, high = self.band
        width = max(len(n) for n in self.names)
        rows = [f"{n:{width}s}  {h:5d}  {b:6.2f}" for n, h, b in zip(self.names, self.hits, self.bias, strict=True)]
        head = f"{self.runs} runs, {self.level:.0%} intervals: {low}..{high} hits expected, pooled {self.pooled:.2%}"
        return "\n".join([head, f"{'':{width}s}  {'hits':>5s}  {'bias':>6s}", *rows])


def coverage(estimates: Sequence[Estimate], truth: Mapping[str, float], *, level: float = 0.95) -> Coverage:
    """Count how often the intervals of repeated fits contain the `truth`, name -> true value.

    Raises ArgumentError without runs or true values, and for a name that was not estimated.

    >>> def run(rng, k):  # the mean of ten synthetic values
    ...     return gt.inference.linear_fit(np.ones((10, 1)), 3 + 0.2 * rng.normal(size=10), ["m"])
    >>> runs = gt.inference.monte_carlo(run, 100, seed=1, processes=0)
    >>> seen = gt.inference.coverage(runs.results, {"m": 3.0})
    >>> seen.band, seen.outside, seen.biased
    ((87, 100), (), ())
    """
    if not estimates:
        raise ArgumentError("expected at least one run; found none", "estimates")
    if not truth:
        raise ArgumentError("expected the true value of at least one name; found none", "truth")
    names, true = tuple(truth), np.array(list(truth.values()), float)
    hits, errors = np.zeros(len(truth), int), np.zeros((len(estimates), len(truth)))
    for run, e in enumerate(estimates):
        low, high = e.intervals(names, level)
        hits += (low <= true) & (true <= high)
        errors[run] = [e.value(name) for name in names] - true
    spread = errors.std(axis=0, ddof=1) if len(estimates) > 1 else np.ones(len(truth))
    bias = errors.mean(axis=0) / np.where(spread > 0, spread, 1.0) * np.sqrt(len(estimates))
    return Coverage(names, hits, len(estimates), level, bias)


Task = Callable[[np.random.Generator, int], Any]


@dataclass(frozen=True, eq=False)
class MonteCarlo:
    """Results of the finished runs, in the order of their numbers `indices`; all runs unless `interrupted`."""

    results: tuple[Any, ...]
    indices: tuple[int, ...]
    runs: int
    seed: int
    interrupted: bool


def monte_carlo(
    task: Task,
    runs: int,
    seed: int,
    *,
    processes: int | None = None,
    progress: Callable[[int, int], object] | None = None,
    interrupted: Callable[[], bool] | None = None,
    executor: Any = None,
) -> MonteCarlo:
    """Call task(rng, k) for k = 0..runs-1, each with its own generator spawned from `seed`.

    The results do not depend on the number of `processes`: by default those of the running study or of
    `gt.workers.using`, else one per core; 0 runs all in this process (with its BLAS threads), for debugging. `executor`
    runs the tasks elsewhere, see `gt.workers.each`. `progress(done, runs)` is called after each run. Ctrl-C, or
    `interrupted()` returning True, ends the workers and returns the finished runs; workers ignore Ctrl-C and SIGTERM,
    and end with this process.

    Raises ArgumentError for fewer than one run, RuntimeError with the number of the run in which the task failed.

    >>> def run(rng, k):
    ...     return rng.normal()
    >>> ended = gt.inference.monte_carlo(run, 3, seed=1, processes=0)
    >>> ended.indices, np.round(ended.results, 2)
    ((0, 1, 2), array([-0.64,  2.49,  1.44]))
    """
    if runs < 1:
        raise ArgumentError(f"expected at least one run; found {runs}")
    given = processes is not None or executor is not None
    own = Crew(min(runs, processes) if processes else processes, executor)
    crew = own if given else CREW.get() or own
    results: dict[int, Any] = {}
    stopped = False

    def stop() -> bool:
        nonlocal stopped
        stopped = stopped or (interrupted is not None and interrupted())
        return stopped

    seeded = partial(_run, task, seed)
    rows = shared(crew, seeded, range(runs), stop, ordered=False)
    try:
        with closing(rows):
            for done in rows:
                if done.error is not None:
                    error = done.error
                    raise RuntimeError(f"run {done.index}: {type(error).__name__}: {error}") from error
                results[done.index] = done.value
                if progress is not None:
                    progress(len(results), runs)
    except KeyboardInterrupt:
        stopped = True
    finally:
        own.close()
    indices = tuple(sorted(results))
    return MonteCarlo(tuple(results[k] for k in indices), indices, runs, seed, stopped and len(indices) < runs)


def _run(task: Task, seed: int, k: int) -> Any:
    # the k-th child of SeedSequence(seed).spawn(): a run needs only its number
    return task(np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(k,))), k)
