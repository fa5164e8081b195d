"""Rotation in lead-through: guided by the handle's torque, aligned by the tool's (Dressler 2012, (8.5), (8.11))."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from ...results.options import Options, Unit, Within
from .vectors import ZERO, Turn, Vector, cross, dot, forth, limited, plus


@dataclass(frozen=True)
class TurningGains(Options):
    """Gains and limits of the rotation; the thesis prints none of them: the defaults are ours, examples.

    >>> gt.control.lead_through.TurningGains(torque_gain=2.0, about_axis="lock").about_axis
    'lock'
    """

    by_handle: Annotated[bool, "the handle's torque turns the tool, free of contact"] = False
    inertia: Annotated[float, Unit("kg.m2", key="inertia_kgm2"), Within(above=0.0), "felt at the handle"] = 0.05
    damping: Annotated[
        float, Unit("N.m.s/rad", key="damping_Nms_rad"), Within(above=0.0), "steady rate is torque / damping"
    ] = 1.0
    torque_gain: Annotated[
        float,
        Unit("rad/s/(N.m)", key="torque_gain_rad_s_Nm"),
        Within(least=0.0),
        "K of (8.4) for torques: turns the tool to none, in contact",
    ] = 0.0
    about_axis: Annotated[
        Literal["free", "lock", "hold", "guide"],
        "rotation about the peg's axis, in contact: as the tool's torque says, as printed; none; back to the angle at "
        "which contact began; by the handle's torque",
    ] = "free"
    hold_gain: Annotated[float, Unit("1/s"), Within(above=0.0), "of `hold`"] = 5.0
    rate_limit: Annotated[float, Unit("rad/s"), Within(above=0.0), "of what the handle commands"] = 1.0
    torque_rate_limit: Annotated[float, Unit("rad/s"), Within(above=0.0), "of the torque control"] = 0.2
    acceleration_limit: Annotated[float, Unit("rad/s2"), Within(above=0.0), "of the command"] = 20.0
    torque_range: Annotated[float, Unit("N.m"), Within(above=0.0), "a component that reaches it is saturated"] = 10.0


@dataclass(frozen=True)
class TurningState:
    """What a cycle ends with: rate (3,) [rad/s] is the command to the robot, in the world frame.

    guided: (3,) [rad/s] for the next cycle. across: (3,) where the direction across the axis pointed when contact
    began. about: commanded turn about the axis in contact [rad], over all contacts.
    """

    rate: Vector = ZERO
    guided: Vector = ZERO
    across: Vector = ZERO
    about: float = 0.0


@dataclass(frozen=True)
class TurningLaw:
    """The rotation of a cycle: mass-damper by the handle, torque control by the tool, and what holds about the axis.

        P_h: free of contact all of w_h where `by_handle`, else nothing; with `guide` in contact its part about the axis
        w  = P_h(w_h) + K t, without the part about the axis unless `free`; (8.11), torque reference zero
        w_h' = P_h(w_h) + cycle / inertia (t_h - damping w)      (8.7), with its back-calculation

    axis, across: (3,) of length 1 and across each other, in the tool's frame: of the peg, and one that shows its angle.

    >>> law = gt.control.lead_through.TurningLaw(gt.control.lead_through.TurningGains(torque_gain=2.0))
    >>> upright = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    >>> nothing = 0.0, 0.0, 0.0
    >>> state = law.step(law.start(), True, nothing, (0.0, 0.01, 0.0), upright, True, 0.004)
    >>> state.rate  # [rad/s]: it follows the torque on the tool
    (0.0, 0.02, 0.0)
    """

    gains: TurningGains = TurningGains()
    axis: Vector = (0.0, 0.0, 1.0)
    across: Vector = (1.0, 0.0, 0.0)

    def start(self) -> TurningState:
        """At rest."""
        return TurningState()

    def step(
        self, state: TurningState, contact: bool, handle: Vector, tool: Vector, turn: Turn, began: bool, cycle: float
    ) -> TurningState:
        """The state after a cycle [s] with torques [N m] about the tool centre point, in the world frame.

        turn: rows of the rotation matrix whose columns are the tool's axes. began: contact began in this cycle.
        """
        p = self.gains
        axis, across = forth(turn, self.axis), forth(turn, self.across)
        reference = across if began else state.across
        projected, aligned = ZERO, ZERO
        if contact:
            aligned = plus(ZERO, p.torque_gain, tool)
            if p.about_axis != "free":
                aligned = plus(aligned, -dot(axis, aligned), axis)
            aligned = limited(aligned, p.torque_rate_limit)
            if p.about_axis == "hold":
                back = p.hold_gain * dot(axis, cross(across, reference))
                aligned = plus(aligned, min(max(back, -p.torque_rate_limit), p.torque_rate_limit), axis)
            if p.about_axis == "guide":
                projected = plus(ZERO, dot(axis, state.guided), axis)
        elif p.by_handle:
            projected = state.guided
        projected = limited(projected, p.rate_limit)
        wanted = plus(projected, 1.0, aligned)
        change = limited(plus(wanted, -1.0, state.rate), p.acceleration_limit * cycle)
        rate = plus(state.rate, 1.0, change)
        net = plus(handle, -p.damping, rate)
        guided = plus(projected, cycle / p.inertia, net)
        about = state.about + cycle * dot(axis, rate) if contact else state.about
        return TurningState(rate, guided, reference, about)

    def stop(self, state: TurningState, cycle: float) -> TurningState:
        """The state after a cycle that brakes within acceleration_limit."""
        change = limited(plus(ZERO, -1.0, state.rate), self.gains.acceleration_limit * cycle)
        return TurningState(plus(state.rate, 1.0, change), ZERO, state.across, state.about)
