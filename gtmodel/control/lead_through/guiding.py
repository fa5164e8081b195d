"""The law of lead-through in six degrees of freedom, from readings of two sensors (Dressler 2012, (8.1)-(8.11))."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

from ...results import ArgumentError
from .law import SurfaceLaw, SurfaceState
from .sensor import MountedSensor, Wrench
from .sign import SignTest
from .status import WrenchStatus
from .synthetic_sensor import GRAVITY
from .turning import TurningLaw, TurningState
from .vectors import IDENTITY, Turn, Vector, dot, is_direction, is_turn, length, whole

ORTHOGONAL = 1e-9  # of axis and direction across
TURN = 1e-3  # of R R' - I: the orientation of a robot comes with few digits from some controllers


@dataclass(frozen=True)
class LeadThroughState:
    """What a cycle ends with: velocity (3,) [m/s] of the tool centre point and rate (3,) [rad/s], in the world frame.

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
        """OK or NO_FORCE while it may move; else why it stands."""
        return self.translation.status

    @property
    def allowed(self) -> bool:
        """False once the sign test or a wrench was refused."""
        return self.translation.allowed


@dataclass(frozen=True)
class LeadThroughLaw:
    """Lead-through in six degrees of freedom: the readings of two sensors in, a twist of the tool out, a cycle at a
    time.

    Order of a cycle: orientation and readings are judged as they came (finite, rotation matrix, range, age); both
    wrenches are freed of bias and weight and taken about the tool centre point in the world frame; `translation`
    decides about contact, by the tool's force or, with `any_direction`, by its torque too; then `rotation`. What
    cannot be used brakes both, for good.

    translation, rotation: a surface is followed with `any_direction` off and torque_gain 0; a peg goes into a hole,
    (8.11), with `any_direction`, force_reference 0 and a torque_gain. handle, tool: the sensors. gravity: (3,) [m/s2].

    Raises ArgumentError for axes that are not of length 1 or not across each other.

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
            raise ArgumentError(f"expected three numbers of length 1; found {axis!r}", "axis")
        if not (is_direction(across) and abs(dot(axis, across)) <= ORTHOGONAL):
            raise ArgumentError(f"expected three numbers of length 1 across the axis; found {across!r}", "across")
        if len(self.gravity) != 3 or not whole(self.gravity):
            raise ArgumentError(f"expected three finite numbers; found {self.gravity!r}", "gravity")

    @property
    def cycle(self) -> float:
        """Between two commands [s]."""
        return self.translation.gains.cycle

    def start(self, tool: SignTest, handle: SignTest) -> LeadThroughState:
        """At rest and free. Unless the sign tests of both sensors ended with OK no step ever moves the robot."""
        worse = handle if tool.status.ok else tool
        return LeadThroughState(self.translation.start(worse), self.rotation.start())

    def step(
        self, state: LeadThroughState, handle: Wrench, tool: Wrench,
        turn: Turn = IDENTITY,
        handle_age: float = 0.0, tool_age: float = 0.0,
    ) -> LeadThroughState:  # fmt: skip
        """The state after a cycle with the sensors' readings (force [N], moment [N m]) and their ages [s].

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
        """The state after a cycle that brakes within the acceleration limits; then it stands, until `start`."""
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
