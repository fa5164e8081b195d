"""Laws of lead-through on a surface and in six degrees of freedom (Dressler 2012, chapter 8), one cycle per call."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

from ...results import ArgumentError
from .gains import CALM, OscillationWatch, SurfaceGains, TurningLaw, TurningState, Watched
from .scenes import GRAVITY
from .sensor import MountedSensor, SignTest, Wrench
from .wrench import IDENTITY, ZERO, Turn, Vector, WrenchStatus, dot, is_direction, is_turn, length, limited, plus, whole

SHORTEST = 1e-9  # length of a mean of directions: below it they are opposite


@dataclass(frozen=True)
class SurfaceState:
    """State after a cycle. velocity (3,) [m/s] is the command to the robot, in the world frame.

    guided: (3,) [m/s] V_h of (8.7) for the next cycle. normal: (3,) in use; filtered: (3,) before the cone. contact,
    and since: cycles since it changed. watched: see `OscillationWatch`. status: the robot moves with OK and NO_FORCE
    (in contact; the normal stays unchanged); with any other status it brakes and stops, and the first cause is kept.
    allowed: whether the sign test passed and no wrench was rejected.
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
    """Lead-through in three translations: the hand guides along the surface, force control acts along its normal.

    Convention: a tool force is the force *on* the tool, and the normal points from workpiece to tool. In contact
    f_t . n > 0, and (8.4) reads v = K (f_t . n - reference) n: a force above the reference lifts the tool. A handle
    force is the force of the hand on the handle. All vectors are in the frame of the robot's command.

        P_h: all of v_h; in contact its part along the surface; at most `speed_limit` long
        V    = P_h(v_h) + v n, changing by at most `acceleration_limit` times the cycle
        v_h' = P_h(v_h) + cycle / mass (F_h - damping V)         (8.7), with its back-calculation

    In contact n is the direction of the tool force if it is within or on the `cone` around the nominal normal, else
    the nominal normal (8.10). Contact begins at `enter_force`, ends at `leave_force` or with `release_force` at the
    handle, and does not change again within `dwell`. A wrench that is not finite, saturated or old ends the motion: see
    `stop`.

    With `friction` the friction force, opposite to the commanded motion along the surface, is subtracted first. With
    `any_direction` the magnitude of the force determines contact, n is its direction whatever the nominal normal, and
    without a force nothing is projected: (8.11).

    normal: nominal normal of length 1. watch: reduces the gain while the contact oscillates. Raises ArgumentError for a
    normal of another length.

    >>> L = gt.control.lead_through
    >>> law, test = L.SurfaceLaw(), L.SignTest(None, L.WrenchStatus.OK)
    >>> state = law.start(test)
    >>> for _ in range(500):
    ...     state = law.step(state, (5.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    >>> round(state.velocity[0], 4), state.contact  # [m/s]: force / damping
    (0.05, False)
    >>> law.step(state, (0.0, 0.0, 0.0), (0.0, 0.0, 3.0)).velocity[2] > 0  # a force above the reference lifts the tool
    True
    """

    gains: SurfaceGains = field(default_factory=SurfaceGains)
    normal: Vector = (0.0, 0.0, 1.0)
    watch: OscillationWatch = field(default_factory=OscillationWatch)

    def __post_init__(self) -> None:
        if not is_direction(self.normal):
            raise ArgumentError(f"expected a unit vector; found {self.normal!r}", "normal")

    @property
    def dwell_cycles(self) -> int:
        """The dwell in whole cycles, rounded up."""
        return math.ceil(self.gains.dwell / self.gains.cycle - 1e-9)

    def start(self, test: SignTest) -> SurfaceState:
        """Return the state at rest, without contact. The robot never moves after a sign test with a status other than
        OK.

        An unusable wrench also ends the motion: see `stop`.
        """
        return SurfaceState(ZERO, ZERO, self.normal, self.normal, False, self.dwell_cycles, test.status, test.status.ok)

    def step(
        self, state: SurfaceState, handle: Vector, tool: Vector, handle_age: float = 0.0, tool_age: float = 0.0
    ) -> SurfaceState:
        """Return the state after a cycle with forces [N] at handle and tool, without bias and weight, and ages [s]."""
        if not state.allowed:
            return self.stop(state, state.status)
        bad = self._refusal(handle, tool, handle_age, tool_age)
        if bad is not None:
            return self.stop(state, bad)
        return self.moved(state, handle, tool)

    def moved(self, state: SurfaceState, handle: Vector, tool: Vector, torque: float = 0.0) -> SurfaceState:
        """Return the state after a cycle with checked forces [N]; torque: magnitude of the tool's torque [N m]."""
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
        target = plus(projected, pressed, normal)
        change = limited(plus(target, -1.0, state.velocity), p.acceleration_limit * p.cycle)
        velocity = plus(state.velocity, 1.0, change)
        net = plus(handle, -p.damping, velocity)
        guided = plus(projected, p.cycle / p.mass, net)
        if not whole(velocity, guided, watched):  # absurdly large gains
            return self.stop(state, WrenchStatus.NOT_FINITE)
        return SurfaceState(velocity, guided, normal, filtered, contact, since, status, True, watched)

    def stop(self, state: SurfaceState, why: WrenchStatus) -> SurfaceState:
        """Return the state after a cycle of braking within acceleration_limit; then at rest until a new `start`."""
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
        """Filtered direction of the tool force, normal in use (8.10), and whether the force has a direction."""
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
        if p.any_direction and not state.contact:  # at its beginning, independent of the nominal normal
            return estimate, estimate, WrenchStatus.OK
        share = p.cycle / (p.normal_filter + p.cycle)  # first order, implicit: 1 without a filter
        mixed = plus(state.filtered, share, plus(estimate, -1.0, state.filtered))
        mixture = length(mixed)
        if mixture <= SHORTEST:  # opposite directions
            return self.normal, self.normal, WrenchStatus.OK
        filtered = (mixed[0] / mixture, mixed[1] / mixture, mixed[2] / mixture)
        inside = p.any_direction or dot(self.normal, filtered) >= math.cos(p.cone)
        return filtered, filtered if inside else self.normal, WrenchStatus.OK


ORTHOGONAL = 1e-9  # tolerance of axis . across
TURN = 1e-3  # tolerance of R R' - I: some controllers report orientations with few digits


@dataclass(frozen=True)
class LeadThroughState:
    """State after a cycle: velocity (3,) [m/s] of the tool centre point and rate (3,) [rad/s], in the world frame.

    status and allowed are those of the translation; see `SurfaceState` and `TurningState`.
    """

    translation: SurfaceState
    rotation: TurningState

    @property
    def velocity(self) -> Vector:
        """Command [m/s]."""
        return self.translation.velocity

    @property
    def rate(self) -> Vector:
        """Command [rad/s]."""
        return self.rotation.rate

    @property
    def contact(self) -> bool:
        """Whether the tool touches something."""
        return self.translation.contact

    @property
    def status(self) -> WrenchStatus:
        """OK or NO_FORCE while motion is allowed; otherwise the cause of the stop."""
        return self.translation.status

    @property
    def allowed(self) -> bool:
        """False after a failed sign test or a rejected wrench."""
        return self.translation.allowed


@dataclass(frozen=True)
class LeadThroughLaw:
    """Lead-through in six degrees of freedom: in each cycle from the readings of two sensors to a twist of the tool.

    Each cycle checks the raw orientation and readings (finite, rotation matrix, range, age) and converts both to
    wrenches about the tool centre point in the world frame, without bias and weight. Then `translation` determines
    contact from the tool's force, with `any_direction` also from its torque, and computes the velocity; `rotation`
    computes the rate. An unusable reading stops both permanently.

    translation, rotation: to follow a surface, `any_direction` is off and torque_gain 0; to insert a peg, (8.11), use
    `any_direction`, force_reference 0 and a torque_gain. handle, tool: the sensors. gravity: (3,) [m/s2].

    Raises ArgumentError if the axes are not orthogonal unit vectors.

    >>> L = gt.control.lead_through
    >>> law = L.LeadThroughLaw(tool=L.MountedSensor(mass=0.8))
    >>> free, weight = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)), ((0.0, 0.0, -0.8 * 9.81), (0.0, 0.0, 0.0))
    >>> push = (5.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    >>> state = law.start(L.SignTest(None, L.WrenchStatus.OK), L.SignTest(None, L.WrenchStatus.OK))
    >>> for _ in range(500):
    ...     state = law.step(state, push, weight)
    >>> round(state.velocity[0], 4), state.contact, state.status.name  # [m/s]: force / damping
    (0.05, False, 'OK')
    """

    translation: SurfaceLaw = field(default_factory=SurfaceLaw)
    rotation: TurningLaw = field(default_factory=TurningLaw)
    handle: MountedSensor = field(default_factory=MountedSensor)
    tool: MountedSensor = field(default_factory=MountedSensor)
    gravity: Vector = GRAVITY

    def __post_init__(self) -> None:
        axis, across = self.rotation.axis, self.rotation.across
        if not is_direction(axis):
            raise ArgumentError(f"expected a unit vector; found {axis!r}", "axis")
        if not (is_direction(across) and abs(dot(axis, across)) <= ORTHOGONAL):
            raise ArgumentError(f"expected a unit vector perpendicular to the axis; found {across!r}", "across")
        if len(self.gravity) != 3 or not whole(self.gravity):
            raise ArgumentError(f"expected three finite numbers; found {self.gravity!r}", "gravity")

    @property
    def cycle(self) -> float:
        """Time between two commands [s]."""
        return self.translation.gains.cycle

    def start(self, tool: SignTest, handle: SignTest) -> LeadThroughState:
        """Return the state at rest, without contact. The robot never moves unless both sign tests have status OK."""
        worse = handle if tool.status.ok else tool
        return LeadThroughState(self.translation.start(worse), self.rotation.start())

    def step(
        self, state: LeadThroughState, handle: Wrench, tool: Wrench,
        turn: Turn = IDENTITY,
        handle_age: float = 0.0, tool_age: float = 0.0,
    ) -> LeadThroughState:  # fmt: skip
        """Return the state after a cycle with the sensors' readings (force [N], moment [N m]) and their ages [s].

        turn: rows of the rotation matrix whose columns are the tool's axes in the world frame.
        """
        before = state.translation
        if not before.allowed:
            return self.stop(state, before.status)
        bad = self._refusal(handle, tool, turn, handle_age, tool_age)
        if bad is not None:
            return self.stop(state, bad)
        f_h, t_h = self.handle.wrench(handle, turn, self.gravity)
        f_t, t_t = self.tool.wrench(tool, turn, self.gravity)
        moved = self.translation.moved(before, f_h, f_t, length(t_t))
        if not moved.allowed:
            return self.stop(state, moved.status)
        began = moved.contact and not before.contact
        turned = self.rotation.step(state.rotation, moved.contact, t_h, t_t, turn, began, self.cycle)
        if not (whole(turned.rate, turned.guided) and math.isfinite(turned.about)):
            return self.stop(state, WrenchStatus.NOT_FINITE)
        return LeadThroughState(moved, turned)

    def stop(self, state: LeadThroughState, why: WrenchStatus) -> LeadThroughState:
        """Return the state after a cycle of braking within the acceleration limits; then at rest until `start`."""
        return replace(
            state, translation=self.translation.stop(state.translation, why),
            rotation=self.rotation.stop(state.rotation, self.cycle),
        )  # fmt: skip

    def _refusal(
        self, handle: Wrench, tool: Wrench, turn: Turn, handle_age: float, tool_age: float
    ) -> WrenchStatus | None:
        p, most = self.translation.gains, self.rotation.gains.torque_range
        if not (whole(*handle, *tool, *turn) and math.isfinite(handle_age) and math.isfinite(tool_age)):
            return WrenchStatus.NOT_FINITE
        for force, moment in (handle, tool):
            for x in force:
                if abs(x) >= p.force_range:
                    return WrenchStatus.SATURATED
            for x in moment:
                if abs(x) >= most:
                    return WrenchStatus.SATURATED
        if not (0.0 <= handle_age <= p.age_limit and 0.0 <= tool_age <= p.age_limit):
            return WrenchStatus.STALE
        return None if is_turn(turn, TURN) else WrenchStatus.NO_ROTATION
