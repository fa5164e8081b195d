"""A position servo between a predictive controller and its axes, as a part of the plant that the controller predicts.

The plan gives the force of a cycle. The servo F = kp (u - q) + kd (du - dq) makes it, on average over the cycle, by the
position that is commanded. But the robot is not quite where it was predicted to be, and the force changes within the
cycle: the servo acts against both. On the motion that a cycle of length T plans, its force differs from the planned
one by c(t), a polynomial from positions, speeds, accelerations and forces at both ends. The axes then deviate by e(t),

    e'' = L (c - kp e - kd e'),    e(0) = e'(0) = 0,    L: acceleration of the axes by their forces, at this state

whose Taylor series is summed up at T.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from .._pickling import Portable
from ..linear.state_space import held
from ..results.refusal import ArgumentError, naming
from .options import AxisServo
from .statement import Statement

NEEDS = (
    "a servo moves axes that are measured and have a force each: measure their positions alone, and declare their "
    "forces as the one input of a model whose states are positions and speeds"
)
ROUNDED = 1e-6  # relative size of the last term of the series
ELSEWHERE = 1.5  # axes may have so much higher natural frequencies at other states than at the targets
FASTEST = 25.0  # radians in a period, at such states: of a longer series round-off is left


def axis_signals(q: str) -> list[str]:
    """Return the names of position, speed and acceleration of the axes."""
    return [q, f"der({q})", f"der({q},2)"]


class ServoedAxes(Portable):
    """Axes under a servo. `parts`: their position, speed and acceleration, in (x, w). holding: the position to command
    at rest at the targets."""

    def __init__(self, s: Statement, rest: tuple[np.ndarray, np.ndarray], servo: AxisServo, period: float) -> None:
        n, m = s.x.numel(), s.v.numel()
        if len(s.sensors) != 1 or len(s.inputs) != 1 or not s.sensors[0].size == s.inputs[0].size == m == n / 2:
            raise ArgumentError(NEEDS, "servo")
        with naming("servo."):
            self.kp, self.kd = servo.gains(m)
        self.period, self.axes = period, m
        ends = np.cumsum([0, *[k.size for k in s.shown]]).tolist()
        at = {k.name: s.outputs[a : a + k.size] for k, a in zip(s.shown, ends, strict=False)}
        self.parts = q, dq, ddq = [at[name] for name in axis_signals(s.sensors[0].name)]
        places = [k for k in range(n) if ca.depends_on(q, s.x[k])]
        speeds = [k for k in range(n) if k not in places]
        if len(places) != m or ca.depends_on(dq, s.w):
            raise ArgumentError(NEEDS, "servo")
        z = ca.vertcat(s.x, s.w)
        terms = [q, s.forces, *(ca.jacobian(e, z) for e in (s.rates, s.forces, q, dq))]
        values = ca.Function("slopes", [z, s.p], terms)(np.concatenate(rest), s.targets)
        q0, force, *slopes = (np.asarray(ca.DM(v).full()) for v in values)
        self._rates, self._forces, self._position, self._speed = slopes
        with np.errstate(all="ignore"):
            try:
                back = np.linalg.inv(self._forces[:, n:])
            except np.linalg.LinAlgError:
                raise ArgumentError(NEEDS, "servo") from None
        self._per_force = self._rates[:, n:] @ back
        self.holding = q0[:, 0] + force[:, 0] / self.kp
        fastest = ELSEWHERE * period * float(np.abs(np.linalg.eigvals(self._slope(self.kp, self.kd))).max())
        if fastest > FASTEST:
            raise ArgumentError(
                f"it moves the axes at up to {fastest / (ELSEWHERE * period):.3g} rad/s, too fast to predict over a "
                f"period of {period:g} s: expected at most {FASTEST / (ELSEWHERE * period):.3g}; give it a lower "
                "stiffness or damping", "servo",
            )  # fmt: skip
        size, self._terms = 1.0, 2
        while size > ROUNDED or self._terms < fastest:
            self._terms += 1
            size *= fastest / (self._terms - 2)
        self._lightness = ca.solve(ca.jacobian(s.forces, s.w).T, ca.jacobian(ddq, s.w).T).T
        self._places, self._speeds, self._jacobians = places, speeds, [ca.jacobian(e, s.x)[:, places] for e in (q, dq)]
        self._undoing = self._undone()

    def _slope(self, kp: np.ndarray, kd: np.ndarray) -> np.ndarray:
        """Slope of the rates by the state under a servo that holds a position."""
        n = len(self._rates)
        holds = kp[:, None] * self._position[:, :n] + kd[:, None] * self._speed[:, :n] + self._forces[:, :n]
        return self._rates[:, :n] - self._per_force @ holds

    def motion(self, kp: np.ndarray, kd: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the state after a cycle at the targets by that before, by a force that is added, and by its rate."""
        n, m = len(self._rates), self.axes
        A = np.zeros((n + m, n + m))
        A[:n, :n], A[:n, n:] = self._slope(kp, kd), self._per_force
        F, G = held(A, np.vstack([np.zeros((n, m)), np.eye(m)]), self.period)
        return F[:n, :n], F[:n, n:], G[:n]

    def _undone(self) -> np.ndarray:
        """Change of a held command, (m,), that undoes a deviation of positions and speeds after the cycle, (2m,)."""
        n, (_, force, _) = len(self._rates), self.motion(self.kp, self.kd)
        scale = np.repeat([1.0 / self.period, 1.0], self.axes)[:, None]
        by_command = scale * np.vstack([self._position[:, :n], self._speed[:, :n]]) @ (force * self.kp)
        return np.linalg.pinv(by_command) * scale.T

    def _deviation(self, at: Any, at_end: Any, forces: tuple[Any, Any], sent: Any, speeds: Any) -> tuple[Any, Any]:
        """Deviation of positions and of speeds after a cycle, by the series."""
        kp, kd, (q, dq, ddq), T = ca.DM(self.kp), ca.DM(self.kd), [at(e) for e in self.parts], self.period
        jerk, lightness = at_end(self.parts[2]) - ddq, at(self._lightness)  # over the cycle
        before, u = sent[: self.axes], sent[self.axes :]
        du = speeds * ((u - before) / T)
        # derivatives of the force at the beginning, times powers of T
        c = [
            kp * (u - q) + kd * (du - dq) - forces[0], T * (kp * (du - dq) - kd * ddq) - (forces[1] - forces[0]),
            -T * (T * (kp * ddq) + kd * jerk), -T * T * (kp * jerk),
        ]  # fmt: skip
        terms = [ca.SX.zeros(self.axes), ca.SX.zeros(self.axes)]
        for k in range(self._terms - 2):
            given = c[k] if k < len(c) else 0.0
            push = given - (kp * terms[k] + (kd / T) * terms[k + 1])
            terms.append(ca.mtimes(lightness, (T * T) * push))
        place, speed, factorial = terms[-1] * 0.0, terms[-1] * 0.0, 1.0
        for k in range(2, len(terms)):
            speed += terms[k] / (factorial * T)  # (k - 1)!
            factorial *= k
            place += terms[k] / factorial
        return place, speed

    def response(self, at: Any, at_end: Any, forces: tuple[Any, Any], sent: Any, speeds: Any) -> Any:
        """Return what the servo adds to the state after a cycle of a planned force.

        at, at_end: put the motion at the beginning and at the end of the cycle into an expression of (x, w). forces:
        planned at both. sent: the position commanded before, and that of the cycle. speeds: 1 if the
        servo also receives the way between them over the period as a speed, else 0.
        """
        place, speed = self._deviation(at, at_end, forces, sent, speeds)
        by_place, turning = (at_end(e) for e in self._jacobians)
        change = ca.SX.zeros(len(self._rates))
        change[self._places] = ca.solve(by_place, place)
        change[self._speeds] = ca.solve(by_place, speed - ca.mtimes(turning, change[self._places]))
        return change

    def command(self, at: Any, at_end: Any, forces: tuple[Any, Any], before: Any, speeds: Any) -> Any:
        """Return the position by which the servo makes a force, on average over the cycle.

        On a motion of constant acceleration the mean of the servo's force is that of the plan. A stiff servo that holds
        a position brakes the axes within the cycle: without speeds, a second step brings speeds, and positions over the
        period, as near to the plan as one number for each axis can, with the inertia at the targets. Arguments as for
        `response`; before: the position commanded before.
        """
        kp, kd, T, (q, dq, ddq) = ca.DM(self.kp), ca.DM(self.kd), self.period, [at(e) for e in self.parts]
        ahead = speeds * (kp / 2.0 + kd / T)  # the position moves on within the cycle
        wanted = forces[0] + kp * (q + dq * (T / 2.0) + ddq * (T * T / 6.0)) + kd * (dq + ddq * (T / 2.0))
        first = (wanted + ahead * before) / (kp + ahead)
        left = self._deviation(at, at_end, forces, ca.vertcat(before, first), speeds)
        return first - (1.0 - speeds) * ca.mtimes(ca.SX(self._undoing), ca.vertcat(*left))
