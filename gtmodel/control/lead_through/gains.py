"""Gains, thresholds and limits of lead-through along a surface or into a hole."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

from ...results import ArgumentError
from ...results.options import Options, Unit, Within


@dataclass(frozen=True)
class SurfaceGains(Options):
    """Gains, thresholds and limits of lead-through on a surface; the thesis prints only cycle, cone and reference.

    The defaults of the others are ours: examples, not recommendations.

    >>> gt.control.lead_through.SurfaceGains(force_gain=-0.01)
    Traceback (most recent call last):
        ...
    gtmodel.results.refusal.ArgumentError: force_gain: ...
    """

    cycle: Annotated[float, Unit("s"), Within(above=0.0), "between two commands"] = 0.004
    mass: Annotated[float, Unit("kg"), Within(above=0.0), "M of (8.6), felt at the handle"] = 5.0
    damping: Annotated[
        float, Unit("N.s/m", key="damping_Ns_m"), Within(above=0.0), "D of (8.6): steady speed is force / D"
    ] = 100.0
    force_gain: Annotated[float, Unit("m/s/N"), Within(above=0.0), "K of (8.4)"] = 0.01
    force_reference: Annotated[float, Unit("N"), Within(least=0.0), "held along the normal, on the tool"] = 2.0
    any_direction: Annotated[
        bool, "contact by the size of the tool's force and torque, the force's direction as normal: a peg in a hole"
    ] = False
    contact_arm: Annotated[
        float, Unit("m"), Within(above=0.0), "with any_direction: a torque over it counts as a force towards contact"
    ] = 0.05
    cone: Annotated[float, Unit("rad", written="deg"), Within(least=0.0, most=math.pi / 2), "phi_L of (8.10)"] = (
        math.radians(10.0)
    )
    normal_filter: Annotated[float, Unit("s"), Within(least=0.0), "time constant of the normal; 0: unfiltered"] = 0.2
    friction: Annotated[
        float, Within(least=0.0, most=1.0), "Coulomb coefficient taken out of the force's direction"
    ] = 0.0
    friction_speed: Annotated[float, Unit("m/s"), Within(above=0.0), "below it less friction is taken out"] = 0.01
    least_force: Annotated[float, Unit("N"), Within(above=0.0), "up to it a tool force has no direction"] = 0.2
    enter_force: Annotated[float, Unit("N"), Within(above=0.0), "along the nominal normal: contact from it on"] = 1.0
    leave_force: Annotated[float, Unit("N"), Within(), "contact ends at it and below"] = 0.3
    dwell: Annotated[float, Unit("s"), Within(least=0.0), "least time between two changes of contact"] = 0.1
    release_force: Annotated[float, Unit("N"), Within(above=0.0), "at the handle, along the normal: ends contact"] = (
        10.0
    )
    speed_limit: Annotated[float, Unit("m/s"), Within(above=0.0), "of what the handle commands"] = 0.25
    force_speed_limit: Annotated[float, Unit("m/s"), Within(above=0.0), "of the force control"] = 0.05
    acceleration_limit: Annotated[float, Unit("m/s2"), Within(above=0.0), "of the command"] = 5.0
    force_range: Annotated[float, Unit("N"), Within(above=0.0), "a component that reaches it is saturated"] = 100.0
    age_limit: Annotated[float, Unit("s"), Within(least=0.0), "an older wrench stops the motion"] = 0.012

    def __post_init__(self) -> None:
        super().__post_init__()
        least = self.cycle * self.damping / 2  # (8.7) from cycle to cycle: v' = (1 - cycle D / M) v
        if not self.mass > least:
            raise ArgumentError(
                f"must be greater than cycle damping / 2, {least:g} kg: else it swings by itself", "mass"
            )
        if not self.leave_force < self.enter_force:
            raise ArgumentError(f"must be less than enter_force, {self.enter_force:g} N", "leave_force")
        if not self.any_direction and not self.enter_force <= self.force_reference:
            raise ArgumentError(f"is above the force held, {self.force_reference:g} N", "enter_force")
