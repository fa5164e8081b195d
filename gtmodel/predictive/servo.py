"""A position servo between a predictive controller and its axes, as a part of the plant that the controller predicts.

The plan gives the force of a cycle. The servo F = kp (u - q) + kd (du - dq) makes it, on average over the cycle, by the
position that is commanded. But the robot is not quite where it was predicted to be, and the force changes within the
cycle: the servo acts against both. On the motion of a cycle of length T under the constant force that is planned, the
force of the servo differs from it by c0 + c1 t + c2 t^2. The state then ends at

    x(T) + response[0] c0 + response[1] c1 + response[2] c2

with constant matrices from the linear model at the targets, where the filter has its gains.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from .._pickling import Portable
from ..linear.state_space import held as held_input
from ..results.refusal import ArgumentError, naming
from .options import AxisServo
from .statement import Statement

NEEDS = (
    "a servo moves axes that are measured and have a force each: measure their positions alone, and declare their forces "
    "as the one input of the model"
)


def axis_signals(q: str) -> list[str]:
    """Return the names of position, speed and acceleration of the axes."""
    return [q, f"der({q})", f"der({q},2)"]


class ServoedAxes(Portable):
    """Axes under a servo, about rest at the targets; `parts` are their position, speed and acceleration, in (x, w)."""

    def __init__(self, s: Statement, rest: tuple[np.ndarray, np.ndarray], servo: AxisServo, period: float) -> None:
        n, m = s.x.numel(), s.v.numel()
        if len(s.sensors) != 1 or len(s.inputs) != 1 or not s.sensors[0].size == s.inputs[0].size == m:
            raise ArgumentError(NEEDS, "servo")
        with naming("servo."):
            self.kp, self.kd = servo.gains(m)
        self.period, self.axes = period, m
        ends = np.cumsum([0, *[k.size for k in s.shown]]).tolist()
        at = {k.name: s.outputs[a : a + k.size] for k, a in zip(s.shown, ends, strict=False)}
        self.parts = [at[name] for name in axis_signals(s.sensors[0].name)]
        z = ca.vertcat(s.x, s.w)
        slopes = [ca.jacobian(e, z) for e in (s.rates, s.forces, self.parts[0], self.parts[1])]
        values = ca.Function("slopes", [z, s.p], slopes)(np.concatenate(rest), s.targets)
        (self._rates, self._forces, self._position, self._speed) = (np.asarray(ca.DM(v).full()) for v in values)
        if np.any(self._speed[:, n:]) or not np.all(np.isfinite(self._back())):
            raise ArgumentError(NEEDS, "servo")

    def _back(self) -> np.ndarray:
        """Input of the stages by the force of the axes."""
        try:
            return np.linalg.inv(self._forces[:, len(self._rates) :])
        except np.linalg.LinAlgError:
            return np.full((self.axes, self.axes), np.nan)

    def motion(self, kp: np.ndarray, kd: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
        """Return the state after a cycle by that before, (n, n), and by the numbers of a force c0 + c1 t + c2 t^2."""
        n, m = len(self._rates), self.axes
        per_force = self._rates[:, n:] @ self._back()
        holds = kp[:, None] * self._position[:, :n] + kd[:, None] * self._speed[:, :n] + self._forces[:, :n]
        A, B = np.zeros((n + 2 * m, n + 2 * m)), np.zeros((n + 2 * m, m))
        A[:n, :n], A[:n, n : n + m], A[n : n + m, n + m :] = self._rates[:, :n] - per_force @ holds, per_force, np.eye(m)
        B[n + m :] = 2 * np.eye(m)
        F, G = held_input(A, B, self.period)
        return F[:n, :n], [F[:n, n : n + m], F[:n, n + m :], G[:n]]

    def response(self, parts: list[Any], force: Any, sent: Any, speeds: Any) -> Any:
        """Return what the servo adds to the state after a cycle of a planned force.

        parts: position, speed and acceleration at its beginning. sent: the position commanded before, and that of the
        cycle. speeds: 1 if the servo also receives the way between them over the period as a speed, else 0.
        """
        kp, kd, (q, dq, ddq) = ca.DM(self.kp), ca.DM(self.kd), parts
        before, u = sent[: self.axes], sent[self.axes :]
        du = speeds * ((u - before) / self.period)
        numbers = [kp * (u - q) + kd * (du - dq) - force, kp * (du - dq) - kd * ddq, -(kp / 2.0) * ddq]
        _, matrices = self.motion(self.kp, self.kd)
        total = ca.SX.zeros(len(self._rates))
        for G, c in zip(matrices, numbers, strict=True):
            total += ca.mtimes(ca.SX(G), c)
        return total

    def command(self, parts: list[Any], force: Any, before: Any, speeds: Any) -> Any:
        """Return the position by which the servo makes a force, on average over the cycle.

        It is the position after which `response` is least, in the squares of speed and of position over the period: a
        stiff servo that holds a position within the cycle cannot bring both to nothing. Arguments as for `response`;
        before: the position commanded before.
        """
        if_held = self.response(parts, force, ca.vertcat(before, before), speeds)
        without, with_ = (self._undoing(s) for s in (0.0, 1.0))
        return before - ca.mtimes((1.0 - speeds) * ca.SX(without) + speeds * ca.SX(with_), if_held)

    def _undoing(self, speeds: float) -> np.ndarray:
        """Change of a command, (m,), that undoes a change of the state after the cycle, (n,), as far as it can."""
        n, (_, (held, ramp, _)) = len(self._rates), self.motion(self.kp, self.kd)
        by_command = held * (self.kp + speeds * self.kd / self.period) + ramp * (speeds * self.kp / self.period)
        weights = np.vstack([self._speed[:, :n], self._position[:, :n] / self.period])
        return np.linalg.lstsq(weights @ by_command, weights, rcond=None)[0]
