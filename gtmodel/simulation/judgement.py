"""What is said of a run: why it ends early, in one sentence, and whether states that stay small beside others move by
more than the absolute tolerance that they were integrated with."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..results.check import Check
from ..results.status import SolveStatus
from .systems import SimulatedSystem

# where a run ends, a state of so many nominals has grown without bound
UNBOUNDED = 1e6
# a margin this small beside its typical size is named as what ends the motion
NEAR_ZERO = 1e-3
# Newton unknowns that would go this far, in nominals, in the shortest interval turn back
STEEP = 1e-6
# intervals become so much shorter until the integrator goes over one, down to the last one [s]. Where it goes over so
# many of these, one after the other, the next longer one took too many steps, and no end of the motion lies there
SHORTER, LAST, EQUAL = 10.0, 1e-15, 20
# intervals that are shorter than this part of what the run has gone are no matter of its length
SLOWER = 1e-3


class Ended(Exception):
    """The run ends early; says why."""

    def __init__(self, status: SolveStatus, sentence: str) -> None:
        super().__init__(sentence)
        self.status = status


def wall(
    system: SimulatedSystem,
    x: np.ndarray,
    z: np.ndarray,
    time: float,
    p: np.ndarray,
    shortest: float,
    run: tuple[float, float],
    failed: float,
) -> Ended:
    """Why a run does not go on from a point, where intervals of `shortest` [s] do not help.

    run: its start and end [s]; failed: an interval [s] that the integrator did not go over at once, 0 where it is not
    that.
    """
    reduced, continuation = system.reduced, system.continuation
    at = f"the motion ends at {time:.6g} s"
    if np.any(np.abs(x) > UNBOUNDED * system.stepper.x_scale):
        return Ended(SolveStatus.DIVERGED, f"{at}: the state grows without bound")
    numbers = np.asarray(reduced.margins(x, z, time, p).full()).reshape(-1)
    margins = [m for b in reduced.plan.blocks for m in b.margins]
    gone: dict[str, list[str]] = {"condition": [], "discriminant": [], "pivot": []}
    for m, value in zip(margins, numbers.tolist(), strict=True):
        size = abs(value) if m.kind == "pivot" else value
        if not size > NEAR_ZERO * m.scale:
            gone[m.kind].append(f"the {m.kind} of {m.label} is {size:.3g}, typically {m.scale:.3g}")
    lost = gone["condition"] or gone["discriminant"] or gone["pivot"]
    if lost:
        return Ended(SolveStatus.FAILED, f"{at}, where it leads out of the model's range: {'; '.join(lost[:3])}")
    if continuation is not None:
        rates = np.asarray(reduced.rate(x, z, time, p).full()).reshape(-1)
        along = shortest * np.concatenate([rates, [1.0], np.zeros(p.size)])
        ahead = continuation.tangent(z, continuation.place(x, time, p), along)
        if not continuation.apart(z, z + ahead) <= STEEP:
            return Ended(
                SolveStatus.FAILED,
                f"{at}, where the equations of {reduced.unknowns} become singular: the solution turns back or ends "
                "there",
            )
    elif (span := _followed_span(system, x, time, p, failed)) >= SLOWER * (time - run[0]) and span > 0.0:
        length = run[1] - run[0]
        return Ended(
            SolveStatus.FAILED,
            f"{at}, because a run of {length:.3g} s is too long for so fast a motion: the integrator goes over "
            f"{span:.1g} s at a time, of which the run would take {length / span:.1g}; simulate a shorter one",
        )
    return Ended(
        SolveStatus.FAILED,
        f"{at}: the integrator's steps became too small there, or no numbers came out; look for a term that is "
        "discontinuous, or nearly so, at that time",
    )


def _followed_span(system: SimulatedSystem, x: np.ndarray, time: float, p: np.ndarray, failed: float) -> float:
    """The time [s] that the integrator goes over in one call, and again from there, less than `failed`; 0 where the
    motion ends within a few of them."""
    if not failed > 0.0:
        return 0.0
    span, none = failed, np.zeros(0)
    while span > LAST * max(1.0, abs(time)) and system.stepper(x, none, time, span, p) is None:
        span /= SHORTER
    for n in range(EQUAL):
        result = system.stepper(x, none, time + n * span, span, p)
        if result is None:
            return 0.0
        x = result[0][-1]
    return span if np.all(np.abs(x) <= UNBOUNDED * system.stepper.x_scale) else 0.0


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
