"""The law of lead-through on a surface, a cycle at a time: plain numbers, sums in one order (Dressler 2012, 8.3-8.10).

Sums run over x, y, z in this order, with + - * / and the square root alone; the cosine of the cone is a constant.
Another language that keeps the order has the same bits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

from ...results import ArgumentError
from .gains import SurfaceGains
from .sign import SignTest
from .status import WrenchStatus
from .vectors import ZERO, Vector, dot, is_direction, length, limited, plus, whole
from .watch import CALM, OscillationWatch, Watched

SHORTEST = 1e-9  # of a mixture of directions: below it they are opposed


@dataclass(frozen=True)
class SurfaceState:
    """What a cycle ends with: velocity (3,) [m/s] is the command to the robot, in the world frame.

    guided: (3,) [m/s] V_h of (8.7) for the next cycle. normal: (3,) in use; filtered: (3,) before the cone. contact,
    and since: cycles since it changed. watched: see `OscillationWatch`. status: OK or NO_FORCE (in contact: the normal
    stays as it was) and the robot moves, else it brakes and stands: the first cause stays. allowed: the sign test was
    passed, and no wrench refused.
    """

    velocity: Vector
    guided: Vector
    normal: Vector
    filtered: Vector
    contact: bool
    since: int
    status: WrenchStatus
    allowed: bool
    watched: Watched = CALM


@dataclass(frozen=True)
class SurfaceLaw:
    """Lead-through in three translations: guided along the surface by hand, the force held along its normal.

    Convention: a tool force is the force *on* the tool, the normal points from workpiece to tool, so that in contact
    f_t . n > 0, and (8.4) reads v = K (f_t . n - reference) n: too large a force lifts the tool. A handle force is the
    force of the hand on the handle. All in one frame with the robot's command.

        P_h: all of v_h, in contact its part along the surface; its length at most `speed_limit`
        V    = P_h(v_h) + v n, changed by `acceleration_limit` times the cycle at most
        v_h' = P_h(v_h) + cycle / mass (F_h - damping V)         (8.7), with its back-calculation

    In contact n is the direction of the tool force within `cone` of the nominal normal, else the nominal one (8.10),
    equality included. Contact begins at `enter_force`, ends at `leave_force` or with `release_force` at the handle, and
    does not change again within `dwell`. A wrench that is not finite, saturated or old ends the motion: see `stop`.

    With `friction` the force of friction, against the commanded motion along the surface, is taken out before. With
    `any_direction` the size of the force decides about contact, n is its direction, whatever the nominal normal, and
    without a force nothing is projected: (8.11).

    normal: the nominal one, of length 1. watch: reduces the gain while the contact oscillates. Raises ArgumentError
    for another length.

    >>> L = gt.control.lead_through
    >>> law, test = L.SurfaceLaw(), L.SignTest(None, L.WrenchStatus.OK)
    >>> state = law.start(test)
    >>> for _ in range(500):
    ...     state = law.step(state, (5.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    >>> round(state.velocity[0], 4), state.contact  # [m/s]: force / damping
    (0.05, False)
    >>> law.step(state, (0.0, 0.0, 0.0), (0.0, 0.0, 3.0)).velocity[2] > 0  # too large a force lifts the tool
    True
    """

    gains: SurfaceGains = field(default_factory=SurfaceGains)
    normal: Vector = (0.0, 0.0, 1.0)
    watch: OscillationWatch = field(default_factory=OscillationWatch)

    def __post_init__(self) -> None:
        if not is_direction(self.normal):
            raise ArgumentError(f"expected three numbers of length 1; found {self.normal!r}", "normal")

    @property
    def dwell_cycles(self) -> int:
        """The dwell in whole cycles, rounded up."""
        return math.ceil(self.gains.dwell / self.gains.cycle - 1e-9)

    def start(self, test: SignTest) -> SurfaceState:
        """At rest and free. After a sign test that did not end with OK no step ever moves the robot.

        A wrench that cannot be used ends the motion too: see `stop`.
        """
        return SurfaceState(ZERO, ZERO, self.normal, self.normal, False, self.dwell_cycles, test.status, test.status.ok)

    def step(
        self, state: SurfaceState, handle: Vector, tool: Vector, handle_age: float = 0.0, tool_age: float = 0.0
    ) -> SurfaceState:
        """The state after a cycle with forces [N] at handle and tool, without bias and weight, and their ages [s]."""
        if not state.allowed:
            return self.stop(state, state.status)
        bad = self._refusal(handle, tool, handle_age, tool_age)
        if bad is not None:
            return self.stop(state, bad)
        return self.moved(state, handle, tool)

    def moved(self, state: SurfaceState, handle: Vector, tool: Vector, torque: float = 0.0) -> SurfaceState:
        """The state after a cycle with forces that may be used [N]; torque: size of the tool's [N m]."""
        p = self.gains
        force = length(tool) if p.any_direction else dot(tool, self.normal)
        touch = max(force, torque / p.contact_arm) if p.any_direction else force
        contact, since = self._contact(state, 0.0 if p.any_direction else dot(handle, self.normal), touch)
        watched = self.watch.step(state.watched, force, contact, p.cycle)
        filtered, normal, status = self._normal(state, contact, tool)
        projected, pressed = state.guided, 0.0
        if contact and not (p.any_direction and status is WrenchStatus.NO_FORCE):
            along = dot(normal, projected)
            projected = plus(projected, -along, normal)
            pressed = p.force_gain * watched[2] * (dot(tool, normal) - p.force_reference)
            pressed = min(max(pressed, -p.force_speed_limit), p.force_speed_limit)
        projected = limited(projected, p.speed_limit)
        wanted = plus(projected, pressed, normal)
        change = limited(plus(wanted, -1.0, state.velocity), p.acceleration_limit * p.cycle)
        velocity = plus(state.velocity, 1.0, change)
        net = plus(handle, -p.damping, velocity)
        guided = plus(projected, p.cycle / p.mass, net)
        if not whole(velocity, guided, watched):  # of gains beyond reason
            return self.stop(state, WrenchStatus.NOT_FINITE)
        return SurfaceState(velocity, guided, normal, filtered, contact, since, status, True, watched)

    def stop(self, state: SurfaceState, why: WrenchStatus) -> SurfaceState:
        """The state after a cycle that brakes within acceleration_limit; then it stands, until `start` begins anew."""
        change = limited(plus(ZERO, -1.0, state.velocity), self.gains.acceleration_limit * self.gains.cycle)
        return replace(state, velocity=plus(state.velocity, 1.0, change), guided=ZERO, status=why, allowed=False)

    def _refusal(self, handle: Vector, tool: Vector, handle_age: float, tool_age: float) -> WrenchStatus | None:
        p = self.gains
        for x in (*handle, *tool, handle_age, tool_age):
            if not math.isfinite(x):
                return WrenchStatus.NOT_FINITE
        for x in (*handle, *tool):
            if abs(x) >= p.force_range:
                return WrenchStatus.SATURATED
        if not (0.0 <= handle_age <= p.age_limit and 0.0 <= tool_age <= p.age_limit):
            return WrenchStatus.STALE
        return None

    def _contact(self, state: SurfaceState, pulled: float, pressed: float) -> tuple[bool, int]:
        p, since = self.gains, min(state.since + 1, self.dwell_cycles)
        if since < self.dwell_cycles:
            return state.contact, since
        if state.contact:
            ends = pressed <= p.leave_force or pulled >= p.release_force
            return (False, 0) if ends else (True, since)
        begins = pressed >= p.enter_force and pulled < p.release_force
        return (True, 0) if begins else (False, since)

    def _normal(self, state: SurfaceState, contact: bool, tool: Vector) -> tuple[Vector, Vector, WrenchStatus]:
        """Filtered direction of the tool force, the normal in use (8.10), and whether there is a direction."""
        p = self.gains
        if not contact:
            return self.normal, self.normal, WrenchStatus.OK
        along = plus(state.velocity, -dot(state.normal, state.velocity), state.normal)
        speed = max(length(along), p.friction_speed)
        pushed = plus(tool, p.friction * max(dot(tool, state.normal), 0.0) / speed, along)
        size = length(pushed)
        if size <= p.least_force:
            return state.filtered, state.normal, WrenchStatus.NO_FORCE
        estimate = (pushed[0] / size, pushed[1] / size, pushed[2] / size)
        if p.any_direction and not state.contact:  # where it begins, the nominal normal says nothing
            return estimate, estimate, WrenchStatus.OK
        share = p.cycle / (p.normal_filter + p.cycle)  # first order, implicit: 1 without a filter
        mixed = plus(state.filtered, share, plus(estimate, -1.0, state.filtered))
        mixture = length(mixed)
        if mixture <= SHORTEST:  # turned right over
            return self.normal, self.normal, WrenchStatus.OK
        filtered = (mixed[0] / mixture, mixed[1] / mixture, mixed[2] / mixture)
        inside = p.any_direction or dot(self.normal, filtered) >= math.cos(p.cone)
        return filtered, filtered if inside else self.normal, WrenchStatus.OK
