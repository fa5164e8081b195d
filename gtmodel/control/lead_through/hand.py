"""The operator: what a hand does in phases, and how it resists motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from ...results import ArgumentError
from ...results.options import Options, Unit, Within

Three = tuple[float, float, float]
ZEROS: Three = (0.0, 0.0, 0.0)
LONGEST = 200_000  # cycles


@dataclass(frozen=True)
class GuidePhase(Options):
    """What the hand does for a while: a force and a torque at the handle, and, where it has an impedance, a velocity
    that it wants; in the world frame.

    >>> gt.control.lead_through.GuidePhase(2.0, force=(5.0, 0.0, -3.0)).duration
    2.0
    """

    duration: Annotated[float, Unit("s"), Within(above=0.0), "of the phase"]
    force: Annotated[Three, Unit("N"), Within(), "of the hand on the handle"] = ZEROS
    moment: Annotated[Three, Unit("N.m"), Within(), "of the hand on the handle, about the grip"] = ZEROS
    velocity: Annotated[Three, Unit("m/s"), Within(), "of the hand that has an impedance, as it wants it"] = ZEROS


@dataclass(frozen=True)
class Hand(Options):
    """A hand that resists: mass, damping and stiffness between the handle and where the hand wants to be.

    >>> gt.control.lead_through.Hand(stiffness=300.0).damping
    10.0
    """

    mass: Annotated[float, Unit("kg"), Within(least=0.0), "that moves with the handle"] = 0.5
    damping: Annotated[float, Unit("N.s/m", key="damping_Ns_m"), Within(least=0.0), "towards the wanted velocity"] = (
        10.0
    )
    stiffness: Annotated[float, Unit("N/m"), Within(least=0.0), "towards the wanted position"] = 200.0

    def force(self, off: np.ndarray, relative: np.ndarray, acceleration: np.ndarray) -> np.ndarray:
        """(3,) [N] on the handle: wanted less true position and velocity, (3,) each, and its acceleration."""
        return self.stiffness * off + self.damping * relative - self.mass * acceleration


def rows_of_phases(phases: list[GuidePhase], cycle: float) -> np.ndarray:
    """Force, moment and wanted velocity, (cycles, 3, 3). Raises ArgumentError for none and for too many cycles."""
    if not phases:
        raise ArgumentError("expected one or more phases", "phases")
    counts = [max(round(p.duration / cycle), 1) for p in phases]
    if sum(counts) > LONGEST:
        raise ArgumentError(f"last {sum(counts)} cycles together; at most {LONGEST} are run", "phases")
    wanted = np.array([[p.force, p.moment, p.velocity] for p in phases])
    return np.repeat(wanted, counts, axis=0)
