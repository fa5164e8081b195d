"""Gains and limits of lead-through (Dressler 2012, chapter 8), the oscillation watch, the rotation, and the hand."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np

from ...results import ArgumentError
from ...results.options import Options, Unit, Within
from .wrench import ZERO, Turn, Vector, cross, dot, forth, limited, plus


@dataclass(frozen=True)
class SurfaceGains(Options):
    """Gains, thresholds and limits of lead-through on a surface; the thesis prints only cycle, cone and reference.

    The other defaults are our own examples, not recommendations.

    >>> gt.control.lead_through.SurfaceGains(force_gain=-0.01)
    Traceback (most recent call last):
        ...
    gtmodel.results.refusal.ArgumentError: force_gain: ...
    """

    cycle: Annotated[float, Unit("s"), Within(above=0.0), "between two commands"] = 0.004
    mass: Annotated[float, Unit("kg"), Within(above=0.0), "M of (8.6), felt at the handle"] = 5.0
    damping: Annotated[float, Unit("N.s/m"), Within(above=0.0), "D of (8.6): steady speed is force / D"] = 100.0
    force_gain: Annotated[float, Unit("m/s/N"), Within(above=0.0), "K of (8.4)"] = 0.01
    force_reference: Annotated[float, Unit("N"), Within(least=0.0), "force on the tool along the normal"] = 2.0
    any_direction: Annotated[
        bool, "contact from the magnitude of the tool's force and torque, normal along the force: for a peg in a hole"
    ] = False
    contact_arm: Annotated[
        float, Unit("m"), Within(above=0.0), "with any_direction: torque / contact_arm counts as a contact force"
    ] = 0.05
    cone: Annotated[float, Unit("rad", written="deg"), Within(least=0.0, most=math.pi / 2), "phi_L of (8.10)"] = (
        math.radians(10.0)
    )
    normal_filter: Annotated[float, Unit("s"), Within(least=0.0), "time constant of the normal; 0: unfiltered"] = 0.2
    friction: Annotated[
        float, Within(least=0.0, most=1.0), "Coulomb coefficient for removing friction from the force's direction"
    ] = 0.0
    friction_speed: Annotated[float, Unit("m/s"), Within(above=0.0), "less friction is removed below this speed"] = 0.01
    least_force: Annotated[float, Unit("N"), Within(above=0.0), "up to here a tool force has no direction"] = 0.2
    enter_force: Annotated[float, Unit("N"), Within(above=0.0), "along the nominal normal: contact begins"] = 1.0
    leave_force: Annotated[float, Unit("N"), Within(), "along the nominal normal: contact ends"] = 0.3
    dwell: Annotated[float, Unit("s"), Within(least=0.0), "least time between two changes of contact"] = 0.1
    release_force: Annotated[float, Unit("N"), Within(above=0.0), "at the handle, along the normal: ends contact"] = (
        10.0
    )
    speed_limit: Annotated[float, Unit("m/s"), Within(above=0.0), "of the motion commanded by the handle"] = 0.25
    force_speed_limit: Annotated[float, Unit("m/s"), Within(above=0.0), "of the force control"] = 0.05
    acceleration_limit: Annotated[float, Unit("m/s2"), Within(above=0.0), "of the command"] = 5.0
    force_range: Annotated[float, Unit("N"), Within(above=0.0), "a component of this size is saturated"] = 100.0
    age_limit: Annotated[float, Unit("s"), Within(least=0.0), "an older wrench stops the motion"] = 0.012

    def __post_init__(self) -> None:
        super().__post_init__()
        least = self.cycle * self.damping / 2  # (8.7) from cycle to cycle: v' = (1 - cycle D / M) v
        if not self.mass > least:
            raise ArgumentError(
                f"must be greater than cycle damping / 2, {least:g} kg, or the guided motion is unstable", "mass"
            )
        if not self.leave_force < self.enter_force:
            raise ArgumentError(f"must be less than enter_force, {self.enter_force:g} N", "leave_force")
        if not self.any_direction and not self.enter_force <= self.force_reference:
            raise ArgumentError(f"must not be above force_reference, {self.force_reference:g} N", "enter_force")


Watched = tuple[float, float, float]
CALM: Watched = (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class OscillationWatch(Options):
    """Reduces the gain of the force control while the tool force oscillates.

    It averages the squared force above `corner` over an exponential window. The gain falls while this is above the
    square of `level`, and recovers without contact. A level of 0 switches the watch off.

    >>> watch = gt.control.lead_through.OscillationWatch(level=0.5)
    >>> seen = (0.0, 0.0, 1.0)
    >>> for k in range(250):  # 2 N and an oscillation of 1 N at 62.5 Hz
    ...     seen = watch.step(seen, 2.0 + (0.0, 1.0, 0.0, -1.0)[k % 4], True, 0.004)
    >>> bool(seen[2] < 0.1)  # remaining share of the gain
    True
    """

    level: Annotated[float, Unit("N"), Within(least=0.0), "a larger root mean square is oscillation; 0: off"] = 0.0
    corner: Annotated[float, Unit("Hz"), Within(above=0.0), "slower changes of the force do not count"] = 5.0
    window: Annotated[float, Unit("s"), Within(above=0.0), "time constant of the exponential window"] = 0.3
    fall: Annotated[float, Unit("s"), Within(above=0.0), "time constant of the falling gain"] = 0.2
    recovery: Annotated[float, Unit("s"), Within(above=0.0), "time constant of the recovery, without contact"] = 5.0
    least_share: Annotated[float, Within(above=0.0, most=1.0), "least share of the gain"] = 0.02

    def step(self, watched: Watched, force: float, contact: bool, cycle: float) -> Watched:
        """Return slow part of the force [N], energy [N2] and share of the gain after a cycle [s]."""
        if self.level == 0.0:
            return watched
        slow, energy, share = watched
        constant = 1.0 / (2.0 * math.pi * self.corner)
        slow = slow + cycle / (constant + cycle) * (force - slow)
        fast = force - slow
        energy = energy + cycle / (self.window + cycle) * (fast * fast - energy)
        if energy > self.level * self.level:
            share = max(share - cycle / (self.fall + cycle) * share, self.least_share)
        elif not contact:
            share = share + cycle / (self.recovery + cycle) * (1.0 - share)
        return slow, energy, share


@dataclass(frozen=True)
class TurningGains(Options):
    """Gains and limits of the rotation. The thesis prints none of them; the defaults are our own examples.

    >>> gt.control.lead_through.TurningGains(torque_gain=2.0, about_axis="lock").about_axis
    'lock'
    """

    by_handle: Annotated[bool, "the handle's torque turns the tool without contact"] = False
    inertia: Annotated[float, Unit("kg.m2", key="inertia_kgm2"), Within(above=0.0), "felt at the handle"] = 0.05
    damping: Annotated[float, Unit("N.m.s/rad"), Within(above=0.0), "steady rate is torque / damping"] = 1.0
    torque_gain: Annotated[
        float,
        Unit("rad/s/(N.m)", key="torque_gain_rad_s_Nm"),
        Within(least=0.0),
        "K of (8.4) for torques: in contact the tool turns until its torque is zero",
    ] = 0.0
    about_axis: Annotated[
        Literal["free", "lock", "hold", "guide"],
        "rotation about the peg's axis in contact: free: by the tool's torque, as printed; lock: none; hold: back to "
        "the angle at the beginning of contact; guide: by the handle's torque",
    ] = "free"
    hold_gain: Annotated[float, Unit("1/s"), Within(above=0.0), "of `hold`"] = 5.0
    rate_limit: Annotated[float, Unit("rad/s"), Within(above=0.0), "of the rotation commanded by the handle"] = 1.0
    torque_rate_limit: Annotated[float, Unit("rad/s"), Within(above=0.0), "of the torque control"] = 0.2
    acceleration_limit: Annotated[float, Unit("rad/s2"), Within(above=0.0), "of the command"] = 20.0
    torque_range: Annotated[float, Unit("N.m"), Within(above=0.0), "a component of this size is saturated"] = 10.0


@dataclass(frozen=True)
class TurningState:
    """Rotation state after a cycle. rate (3,) [rad/s] is the command to the robot, in the world frame.

    guided: (3,) [rad/s] for the next cycle. across: (3,) the perpendicular direction at the beginning of contact.
    about: commanded rotation about the axis in contact [rad], over all contacts.
    """

    rate: Vector = ZERO
    guided: Vector = ZERO
    across: Vector = ZERO
    about: float = 0.0


@dataclass(frozen=True)
class TurningLaw:
    """The rotation in a cycle: inertia and damper at the handle, torque control at the tool, a rule about the axis.

        P_h: without contact all of w_h if `by_handle`, else zero; in contact with `guide` its part about the axis
        w  = P_h(w_h) + K t, without the part about the axis unless `free`; (8.11), torque reference zero
        w_h' = P_h(w_h) + cycle / inertia (t_h - damping w)      (8.7), with its back-calculation

    axis, across: orthogonal unit vectors (3,) in the tool's frame, the peg's axis and a direction that shows its angle.

    >>> law = gt.control.lead_through.TurningLaw(gt.control.lead_through.TurningGains(torque_gain=2.0))
    >>> upright = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    >>> nothing = 0.0, 0.0, 0.0
    >>> state = law.step(law.start(), True, nothing, (0.0, 0.01, 0.0), upright, True, 0.004)
    >>> state.rate  # [rad/s]: follows the torque on the tool
    (0.0, 0.02, 0.0)
    """

    gains: TurningGains = TurningGains()
    axis: Vector = (0.0, 0.0, 1.0)
    across: Vector = (1.0, 0.0, 0.0)

    def start(self) -> TurningState:
        """Return the state at rest."""
        return TurningState()

    def step(
        self, state: TurningState, contact: bool, handle: Vector, tool: Vector, turn: Turn, began: bool, cycle: float
    ) -> TurningState:
        """Return the state after a cycle [s] with torques [N m] about the tool centre point, in the world frame.

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
        target = plus(projected, 1.0, aligned)
        change = limited(plus(target, -1.0, state.rate), p.acceleration_limit * cycle)
        rate = plus(state.rate, 1.0, change)
        net = plus(handle, -p.damping, rate)
        guided = plus(projected, cycle / p.inertia, net)
        about = state.about + cycle * dot(axis, rate) if contact else state.about
        return TurningState(rate, guided, reference, about)

    def stop(self, state: TurningState, cycle: float) -> TurningState:
        """Return the state after a cycle of braking within acceleration_limit."""
        change = limited(plus(ZERO, -1.0, state.rate), self.gains.acceleration_limit * cycle)
        return TurningState(plus(state.rate, 1.0, change), ZERO, state.across, state.about)


Three = tuple[float, float, float]
ZEROS: Three = (0.0, 0.0, 0.0)
LONGEST = 200_000  # cycles


@dataclass(frozen=True)
class GuidePhase(Options):
    """A phase of the hand's action, in the world frame: force, torque and, for a hand with impedance, target velocity.

    >>> gt.control.lead_through.GuidePhase(2.0, force=(5.0, 0.0, -3.0)).duration
    2.0
    """

    duration: Annotated[float, Unit("s"), Within(above=0.0), "of the phase"]
    force: Annotated[Three, Unit("N"), Within(), "of the hand on the handle"] = ZEROS
    moment: Annotated[Three, Unit("N.m"), Within(), "of the hand on the handle, about the grip"] = ZEROS
    velocity: Annotated[Three, Unit("m/s"), Within(), "target velocity of a hand with an impedance"] = ZEROS


@dataclass(frozen=True)
class Hand(Options):
    """Impedance of a hand: mass, and damping and stiffness between the handle and the hand's target.

    >>> gt.control.lead_through.Hand(stiffness=300.0).damping
    10.0
    """

    mass: Annotated[float, Unit("kg"), Within(least=0.0), "moving with the handle"] = 0.5
    damping: Annotated[float, Unit("N.s/m"), Within(least=0.0), "towards the target velocity"] = 10.0
    stiffness: Annotated[float, Unit("N/m"), Within(least=0.0), "towards the target position"] = 200.0

    def force(self, off: np.ndarray, relative: np.ndarray, acceleration: np.ndarray) -> np.ndarray:
        """Return the force (3,) [N] on the handle, from target minus true position and velocity, and its acceleration,
        (3,) each."""
        return self.stiffness * off + self.damping * relative - self.mass * acceleration


def rows_of_phases(phases: list[GuidePhase], cycle: float) -> np.ndarray:
    """Return force, moment and target velocity (cycles, 3, 3). Raises ArgumentError without phases, or for too many
    cycles."""
    if not phases:
        raise ArgumentError("expected one or more phases", "phases")
    counts = [max(round(p.duration / cycle), 1) for p in phases]
    if sum(counts) > LONGEST:
        raise ArgumentError(f"must last at most {LONGEST} cycles together; found {sum(counts)}", "phases")
    rows = np.array([[p.force, p.moment, p.velocity] for p in phases])
    return np.repeat(rows, counts, axis=0)
