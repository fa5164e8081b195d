"""The lead-through law of the loop (gt_law_lead_through in Python), and its parameters for the C loop."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ...control.lead_through import LeadThroughLaw, LeadThroughState, MountedSensor, SignTest, WrenchStatus
from ...control.lead_through.sensor import OTHER_LOAD
from ...control.lead_through.wrench import IDENTITY, ZERO, Turn, Vector, back, dot, length, plus
from ...results.status import Status
from ..exchange import Command, RobotFeedback
from ..laws import Forward, ReferenceTable
from ..wrenches import Wrench

CartsMotion = Callable[[list[float], list[float]], tuple[Status, list[float], list[float]]]
_ABOUT = ("free", "lock", "hold", "guide")
_STATUS = {
    WrenchStatus.OK: Status.OK,
    WrenchStatus.NO_FORCE: Status.OK,
    WrenchStatus.NOT_FINITE: Status.NOT_FINITE,
    WrenchStatus.STALE: Status.STALE_INPUT,
}


def numbers_of(law: LeadThroughLaw, drift: float) -> ReferenceTable:
    """Return the row that `--gains` of the C loop reads: gains of both motions, gravity, drift, both sensors.

    drift: largest change of a force bias plus noise [N]; smaller forces do not decide the sign test of the first cycle.
    """
    p, w, r = law.translation.gains, law.translation.watch, law.rotation.gains
    row = [
        p.cycle, p.mass, p.damping, p.force_gain, p.force_reference, float(p.any_direction), p.contact_arm,
        math.cos(p.cone), p.normal_filter, p.friction, p.friction_speed, p.least_force, p.enter_force, p.leave_force,
        float(law.translation.dwell_cycles), p.release_force, p.speed_limit, p.force_speed_limit,
        p.acceleration_limit, p.force_range, p.age_limit,
        w.level, 1.0 / (2.0 * math.pi * w.corner), w.window, w.fall, w.recovery, w.least_share, *law.translation.normal,
        float(r.by_handle), r.inertia, r.damping, r.torque_gain, float(_ABOUT.index(r.about_axis)), r.hold_gain,
        r.rate_limit, r.torque_rate_limit, r.acceleration_limit, r.torque_range, *law.rotation.axis,
        *law.rotation.across, *law.gravity, drift,
    ]  # fmt: skip
    for s in (law.handle, law.tool):
        row += [*(x for line in s.turn for x in line), *s.point, *s.force_bias, *s.moment_bias, s.mass, *s.first_moment]
    return ReferenceTable(np.array([row]))


def sign_of(sensor: MountedSensor, force: Vector, turn: Turn, gravity: Vector, drift: float) -> WrenchStatus:
    """Test the direction of the weight in one reading [N], at rest and without contact.

    NO_FORCE: drift [N] hides the weight; WRONG_LOAD: the error exceeds drift plus 0.3 of the weight.
    """
    g = back(sensor.turn, back(turn, gravity))
    pull, size = plus(force, -1.0, sensor.force_bias), length(g)
    if not sensor.mass * size > drift:
        return WrenchStatus.NO_FORCE
    along = dot(pull, g) / size
    if along > drift:
        error = length(plus(pull, -sensor.mass, g))
        return WrenchStatus.WRONG_LOAD if error > drift + OTHER_LOAD * sensor.mass * size else WrenchStatus.OK
    return WrenchStatus.WRONG_SIGN if along < -drift else WrenchStatus.NO_FORCE


@dataclass
class GuidingLaw:
    """Law for leading the tool by hand: `gtmodel.control.lead_through.LeadThroughLaw` on a robot with carts.

    drift: see `numbers_of`. forward: carts -> tool centre point [m]; carts: tool centre point and its velocity -> carts
    and their speeds. hold_cycles: cycles without a datagram that the loop bridges. In the first cycle the robot is at
    rest and touched by nothing, and both sensors must measure the weight of their loads. The tool does not turn: a law
    that would turn it does not start.
    """

    reads_wrenches: ClassVar[bool] = True
    law: LeadThroughLaw
    drift: float
    axes: int
    forward: Forward | None
    carts: CartsMotion | None
    cycle_ms: int
    hold_cycles: int
    now: LeadThroughState | None = None
    tcp_m: Vector = ZERO
    last_ms: int = 0

    def init(self, first: RobotFeedback) -> Status:
        self.last_ms, rotation = 0, self.law.rotation.gains
        turns = rotation.by_handle or rotation.torque_gain > 0 or rotation.about_axis not in ("free", "lock")
        if self.forward is None or self.carts is None or turns or self.law.cycle != self.cycle_ms / 1000.0:
            return Status.OUT_OF_RANGE
        sign = _reported(first) or self._signs(first)
        test = SignTest(None, sign)
        self.now = self.law.start(test, test)
        if sign is not WrenchStatus.OK:
            return Status.OUT_OF_RANGE if sign is WrenchStatus.NO_FORCE else _STATUS.get(sign, Status.OUT_OF_RANGE)
        status, tcp = self.forward((first.planned_m if first.has_planned else first.position_m)[: self.axes])
        if status is Status.OK:
            self.tcp_m = (tcp[0], tcp[1], tcp[2])
        return status

    def step(self, feedback: RobotFeedback, elapsed_ms: int, command: Command) -> Status:
        assert self.now is not None and self.carts is not None
        passed = (elapsed_ms - self.last_ms) // self.cycle_ms
        bridged = min(max(passed - 1, 0), self.hold_cycles)
        self.tcp_m = plus(self.tcp_m, float(bridged) * self.law.cycle, self.now.velocity)
        self.last_ms = elapsed_ms
        bad = _reported(feedback)
        if bad is not None:
            self.now = self.law.stop(self.now, bad if self.now.allowed else self.now.status)
        else:
            handle, tool = _both(feedback)
            self.now = self.law.step(
                self.now, _reading(handle), _reading(tool), IDENTITY,
                handle.age_cycles * self.law.cycle, tool.age_cycles * self.law.cycle,
            )  # fmt: skip
        self.tcp_m = plus(self.tcp_m, self.law.cycle, self.now.velocity)
        status, q, dq = self.carts(list(self.tcp_m), list(self.now.velocity))
        if status is not Status.OK:
            return status
        command.along_path, command.braking = False, not self.now.allowed
        command.position_m[: self.axes], command.speed_m_s[: self.axes] = q, dq
        return _STATUS.get(self.now.status, Status.OUT_OF_RANGE)

    def _signs(self, first: RobotFeedback) -> WrenchStatus:
        """Test the signs of both sensors, after the checks of the law for any reading."""
        handle, tool = _both(first)
        state = self.law.start(SignTest(None, WrenchStatus.OK), SignTest(None, WrenchStatus.OK))
        ages = handle.age_cycles * self.law.cycle, tool.age_cycles * self.law.cycle
        state = self.law.step(state, _reading(handle), _reading(tool), IDENTITY, *ages)
        if not state.allowed:
            return state.status
        for sensor, wrench in ((self.law.tool, tool), (self.law.handle, handle)):
            sign = sign_of(sensor, _vector(wrench.force_N), IDENTITY, self.law.gravity, self.drift)
            if sign is not WrenchStatus.OK:
                return sign
        return WrenchStatus.OK


def _reported(feedback: RobotFeedback) -> WrenchStatus | None:
    """Return the fault that the datagram or the sensors report, or None."""
    if feedback.wrenches is None:
        return WrenchStatus.STALE
    return WrenchStatus.SENSOR_FAULT if any(w.status for w in feedback.wrenches) else None


def _both(feedback: RobotFeedback) -> tuple[Wrench, Wrench]:
    assert feedback.wrenches is not None
    return feedback.wrenches


def _reading(wrench: Wrench) -> tuple[Vector, Vector]:
    return _vector(wrench.force_N), _vector(wrench.moment_N_m)


def _vector(numbers: list[float]) -> Vector:
    return numbers[0], numbers[1], numbers[2]
