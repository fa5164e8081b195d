"""Judgement of a run: why it ends early, in one sentence, and whether small states exceed the absolute tolerance."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..results.check import Check
from ..results.status import SolveStatus
from .systems import SimulatedSystem

# in nominals: a state beyond this at the end of a run has grown without bound
UNBOUNDED = 1e6
# a margin below this share of its typical size is named as the reason for the end
NEAR_ZERO = 1e-3
# in nominals: Newton unknowns that would move farther than this in the shortest interval turn back
STEEP = 1e-6
# intervals are shortened by this factor, down to LAST [s], until the integrator passes one. If it passes EQUAL of them
# in a row, the longer interval only took too many steps, and the motion does not end there
SHORTER, LAST, EQUAL = 10.0, 1e-15, 20
# intervals below this share of the time already simulated are not short because of the length of the run
SLOWER = 1e-3


class Ended(Exception):
    """The run ends early; the message gives the reason."""

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
    """Return why a run ends at a point, although intervals are as short as `shortest` [s].

    run: its start and end [s]; failed: an interval [s] that the integrator could not pass in one call, 0 if another
    reason ended the run.
    """
    reduced, continuation = system.reduced, system.continuation
    begin = f"the motion ends at {time:.6g} s"
    if np.any(np.abs(x) > UNBOUNDED * system.stepper.x_scale):
        return Ended(SolveStatus.DIVERGED, f"{begin}: the state grows without bound")
    numbers = np.asarray(reduced.margins(x, z, time, p).full()).reshape(-1)
    margins = [m for b in reduced.plan.blocks for m in b.margins]
    vanished: dict[str, list[str]] = {"condition": [], "discriminant": [], "pivot": []}
    for m, value in zip(margins, numbers.tolist(), strict=True):
        size = abs(value) if m.kind == "pivot" else value
        if not size > NEAR_ZERO * m.scale:
            vanished[m.kind].append(f"the {m.kind} of {m.label} is {size:.3g}, typically {m.scale:.3g}")
    reasons = vanished["condition"] or vanished["discriminant"] or vanished["pivot"]
    if reasons:
        return Ended(SolveStatus.FAILED, f"{begin}, where it leaves the model's range: {'; '.join(reasons[:3])}")
    if continuation is not None:
        rates = np.asarray(reduced.rate(x, z, time, p).full()).reshape(-1)
        along = shortest * np.concatenate([rates, [1.0], np.zeros(p.size)])
        ahead = continuation.tangent(z, continuation.place(x, time, p), along)
        if not continuation.apart(z, z + ahead) <= STEEP:
            return Ended(
                SolveStatus.FAILED,
                f"{begin}, where the equations of {reduced.unknowns} become singular: the solution turns back or ends "
                "there",
            )
    elif (span := _followed_span(system, x, time, p, failed)) >= SLOWER * (time - run[0]) and span > 0.0:
        length = run[1] - run[0]
        return Ended(
            SolveStatus.FAILED,
            f"{begin}, because a run of {length:.3g} s is too long for so fast a motion: the integrator advances by "
            f"{span:.1g} s per call, and the run would take {length / span:.1g} calls; simulate a shorter run",
        )
    return Ended(
        SolveStatus.FAILED,
        f"{begin}: the integrator's steps became too small there, or values are not finite; look for a term that is "
        "discontinuous, or nearly so, at that time",
    )


def _followed_span(system: SimulatedSystem, x: np.ndarray, time: float, p: np.ndarray, failed: float) -> float:
    """Return the time [s], shorter than `failed`, that the integrator passes in each of several calls; 0 if the motion
    ends within them."""
    if not failed > 0.0:
        return 0.0
    span, no_z = failed, np.zeros(0)
    while span > LAST * max(1.0, abs(time)) and system.stepper(x, no_z, time, span, p) is None:
        span /= SHORTER
    for n in range(EQUAL):
        result = system.stepper(x, no_z, time + n * span, span, p)
        if result is None:
            return 0.0
        x = result[0][-1]
    return span if np.all(np.abs(x) <= UNBOUNDED * system.stepper.x_scale) else 0.0


# largest ratio of the absolute tolerance to the largest state: above it, errors are percents
COARSE = 1e-3
# in nominals: smaller states are rest and round-off
REST = 1e-13


def resolution(largest: float, tolerance: float) -> dict[str, Check]:
    """Return the check "resolution" if all states stay below COARSE, but not at rest.

    largest: the largest state at any time, in nominals, like the tolerance.
    """
    if not REST < largest < COARSE:
        return {}
    advice = "declare the nominal sizes of the variables, or use a smaller tolerance"
    return {"resolution": Check(tolerance / largest, COARSE, advice)}


def unresolved(checks: dict[str, Check]) -> str:
    """Return a sentence if the motion is not resolved, else an empty string."""
    check = checks.get("resolution")
    if check is None or check.passed:
        return ""
    return f"the tolerance is {check.value:.2g} of the largest state, more than {check.bound:g}: {check.advice}"


Pair = tuple[int, int]
# tolerance of the second run relative to the first, and its lower limit
FINER = 0.01
FINEST = 1e-14
# relative to the largest state, in nominals: smaller states may be its round-off
ROUND_OFF = 1e-11
# if the finer tolerance reduces a state below this share, the state was the integrator's error and is at rest
NOISE = 0.5
# largest error relative to the state's largest value
BOUND = 1e-2


class History:
    """The states at the recorded rows, in nominals, for any choice of states."""

    def __init__(self) -> None:
        self._blocks: list[tuple[tuple[Pair, ...], np.ndarray, np.ndarray]] = []

    def add(self, pairs: tuple[Pair, ...], times: np.ndarray, states: np.ndarray) -> None:
        """Add rows (n, states) at times (n,)."""
        self._blocks.append((pairs, times, states))

    def largest(self) -> dict[Pair, float]:
        """Return the largest absolute value of each state."""
        sizes: dict[Pair, float] = {}
        for pairs, _, states in self._blocks:
            for pair, value in zip(pairs, np.max(np.abs(states), axis=0, initial=0.0).tolist(), strict=True):
                sizes[pair] = max(sizes.get(pair, 0.0), value)
        return sizes

    def of(self, pair: Pair) -> dict[float, float]:
        """Return a variable by time, for the rows at which it was a state."""
        by_time: dict[float, float] = {}
        for pairs, times, states in self._blocks:
            if pair in pairs:
                by_time |= dict(zip(times.tolist(), states[:, pairs.index(pair)].tolist(), strict=True))
        return by_time


def small(history: History, tolerance: float) -> list[Pair]:
    """Return the states that may be as small as their errors and are far below their nominals."""
    sizes = history.largest()
    least, most = ROUND_OFF * max(sizes.values(), default=0.0), min(tolerance / COARSE, COARSE)
    return sorted(p for p, size in sizes.items() if least < size < most) if least else []


def small_states(
    pairs: list[Pair], history: History, finer: History, name: Callable[[Pair], str]
) -> tuple[dict[str, Check], str]:
    """Return the check "small_states" of a run against a run at a finer tolerance, and a sentence if it fails."""
    worst, worst_name = 0.0, ""
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
            worst, worst_name = error, name(pair)
    check = Check(worst, BOUND, f"declare the nominal size of '{worst_name}', or use a smaller tolerance")
    if check.passed:
        return {"small_states": check}, ""
    sentence = (
        f"'{worst_name}' is so small that the integrator's error is {worst:.2g} of its value, more than {BOUND:g}"
    )
    return {"small_states": check}, f"{sentence}: {check.advice}"
