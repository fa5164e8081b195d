"""Why a run ends early, in one sentence."""

from __future__ import annotations

import numpy as np

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
