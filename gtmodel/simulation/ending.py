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


class Ended(Exception):
    """The run ends early; says why."""

    def __init__(self, status: SolveStatus, sentence: str) -> None:
        super().__init__(sentence)
        self.status = status


def wall(system: SimulatedSystem, x: np.ndarray, z: np.ndarray, time: float, p: np.ndarray, shortest: float) -> Ended:
    """Why a motion does not go on from a point, where intervals of `shortest` [s] do not help."""
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
    return Ended(
        SolveStatus.FAILED,
        f"{at}: the integrator's steps became too small there, or no numbers came out; look for a term that is "
        "discontinuous, or nearly so, at that time",
    )
