"""Which of the assembly modes of a pose is the commanded one."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...results.status import ModesStatus
from .result import AssemblyModes
from .six_links import Hands

# commanded pose from its mode, over the size or in rad: two Newton iterations, each to rounding times condition
COMMANDED = 1e-9


@dataclass(frozen=True)
class Judged:
    """Poses with their modes. commanded: index of the commanded mode of each, None where there is none.

    errors: relative distance or angle [rad], the larger, from the commanded pose to the nearest mode; NaN without one.
    """

    hands: Hands
    results: list[AssemblyModes]
    commanded: list[int | None]
    errors: list[float]

    @classmethod
    def of(cls, hands: Hands, results: list[AssemblyModes]) -> Judged:
        """Look for every commanded pose among the real modes."""
        commanded: list[int | None] = []
        errors = []
        for i, modes in enumerate(results):
            if not np.isfinite(hands.T[i]).all() or not np.isfinite(hands.R[i]).all():
                commanded.append(None)
                errors.append(math.nan)
                continue
            k, distance, angle = modes.nearest(hands.R[i], hands.T[i])
            error = max(distance / modes.size, math.radians(angle)) if k >= 0 else math.inf
            commanded.append(k if error <= COMMANDED else None)
            errors.append(error)
        return cls(hands, results, commanded, errors)

    def done(self, i: int) -> bool:
        """True for a pose that was searched."""
        return self.results[i].status not in (ModesStatus.INTERRUPTED, ModesStatus.BAD_INPUT)

    def refused(self) -> list[str]:
        """Why poses could not be searched, as sentences."""
        return [self.message(i) for i, r in enumerate(self.results) if r.status is ModesStatus.BAD_INPUT]

    def message(self, i: int) -> str:
        """The sentence of a pose."""
        return self.hands.faults.get(i) or self.results[i].message

    def leg_error(self, i: int) -> float:
        """Largest error of a leg length at a real mode over the size: the legs as given, not the scaled ones."""
        hands, modes = self.hands, self.results[i]
        joints = modes.T[:, None] + hands.B[i] @ np.swapaxes(modes.R, 1, 2)
        errors = np.abs(np.linalg.norm(joints - hands.A[i], axis=2) - hands.L[i])
        return float(np.max(errors, initial=0.0)) / modes.size if errors.size else 0.0

    def commanded_nearest(self, i: int) -> tuple[float, float]:
        """Distance [m] and angle [deg] of the real mode nearest the commanded one; NaN or infinite without."""
        k = self.commanded[i]
        if k is None:
            return math.nan, math.nan
        return float(self.results[i].nearest_distance[k]), float(self.results[i].nearest_angle_deg[k])
