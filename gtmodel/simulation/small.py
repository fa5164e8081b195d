"""States that stay small beside others: whether their motion is more than the absolute tolerance that it was
integrated with."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..results.check import Check

# of the largest state: an absolute tolerance above it leaves errors of percents
COARSE = 1e-3
# in nominals: states below are rest and round-off
REST = 1e-13


def resolution(largest: float, tolerance: float) -> dict[str, Check]:
    """The check "resolution" of a run whose states stay below COARSE; none for larger ones, and none at rest.

    largest: of any state at any time, in nominals, as the tolerance is.
    """
    if not REST < largest < COARSE:
        return {}
    advice = "declare the nominal sizes of the variables, or use a smaller tolerance"
    return {"resolution": Check(tolerance / largest, COARSE, advice)}


def unresolved(checks: dict[str, Check]) -> str:
    """A sentence for a motion that is not resolved; else an empty one."""
    check = checks.get("resolution")
    if check is None or check.passed:
        return ""
    return f"the tolerance is {check.value:.2g} of the largest state, more than {check.bound:g}: {check.advice}"


Pair = tuple[int, int]
# of the tolerance: the second run's
FINER = 0.01
FINEST = 1e-14
# of the largest state, in nominals: what is smaller may be round-off of that
ROUND_OFF = 1e-11
# a state that the finer tolerance leaves less of was the integrator's error: it rests, to the tolerance
NOISE = 0.5
# of the state's largest value: what a picture shows
BOUND = 1e-2


class History:
    """States at the recorded rows, in nominals, whichever they were."""

    def __init__(self) -> None:
        self._blocks: list[tuple[tuple[Pair, ...], np.ndarray, np.ndarray]] = []

    def add(self, pairs: tuple[Pair, ...], times: np.ndarray, states: np.ndarray) -> None:
        """Rows (n, states) at times (n,)."""
        self._blocks.append((pairs, times, states))

    def largest(self) -> dict[Pair, float]:
        """Of each state, its largest size."""
        sizes: dict[Pair, float] = {}
        for pairs, _, states in self._blocks:
            for pair, value in zip(pairs, np.max(np.abs(states), axis=0, initial=0.0).tolist(), strict=True):
                sizes[pair] = max(sizes.get(pair, 0.0), value)
        return sizes

    def of(self, pair: Pair) -> dict[float, float]:
        """A state by time, where it was one."""
        by_time: dict[float, float] = {}
        for pairs, times, states in self._blocks:
            if pair in pairs:
                by_time |= dict(zip(times.tolist(), states[:, pairs.index(pair)].tolist(), strict=True))
        return by_time


def small(history: History, tolerance: float) -> list[Pair]:
    """States that may be no more than their own error, and far below their nominals: those of any run at a loose
    tolerance are near it, as asked for."""
    sizes = history.largest()
    least, most = ROUND_OFF * max(sizes.values(), default=0.0), min(tolerance / COARSE, COARSE)
    return sorted(p for p, size in sizes.items() if least < size < most) if least else []


def small_states(
    pairs: list[Pair], history: History, finer: History, name: Callable[[Pair], str]
) -> tuple[dict[str, Check], str]:
    """The check "small_states" of a run against one at a finer tolerance, and a sentence where it fails."""
    worst, named = 0.0, ""
    for pair in pairs:
        first, second = history.of(pair), finer.of(pair)
        times = [t for t in first if t in second]
        if not times:
            continue
        a, b = (np.array([run[t] for t in times]) for run in (first, second))
        size = float(np.max(np.abs(b)))
        if size < NOISE * float(np.max(np.abs(a))):
            continue
        error = float(np.max(np.abs(a - b))) / size
        if error > worst:
            worst, named = error, name(pair)
    check = Check(worst, BOUND, f"declare the nominal size of '{named}', or use a smaller tolerance")
    if check.passed:
        return {"small_states": check}, ""
    said = f"'{named}' stays so small that {worst:.2g} of it is the integrator's error, more than {BOUND:g}"
    return {"small_states": check}, f"{said}: {check.advice}"
