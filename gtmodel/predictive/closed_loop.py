"""The closed loop of a predictive controller near its targets, as a linear map from cycle to cycle.

With no limit active the program is the linear-quadratic regulator of its horizon, so that state, filter, delay, and
the servo that makes the forces are one matrix. Its spectral radius tells whether the loop settles.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np

from .discretised import Discretised
from .options import AxisServo


class LinearCycle:
    """Slopes of a controller at rest at its targets."""

    def __init__(self, program: Discretised) -> None:
        self.program, self.n, self.m = program, program.statement.x.numel(), program.statement.v.numel()
        self.gain = self._gain()

    def _derivatives(self, f: ca.Function, result: int, speeds: bool) -> list[np.ndarray]:
        """Slopes of a result of `advance` or `command` by each argument."""
        program, symbols = self.program, f.sx_in()
        s, rest = program.statement, program.standstill
        values = [rest.x, rest.w, 0.0, s.targets]
        if program.servo:
            values += [np.resize(program.servo.holding, symbols[4].numel()), float(speeds)]
        e = f.call(symbols)[result]
        slopes = ca.Function("derivatives", symbols, [ca.jacobian(e, a) for a in symbols])(*values)
        return [np.asarray(ca.DM(v).full()) for v in slopes]

    def _gain(self) -> np.ndarray:
        """Gain of the horizon without limits, w = -gain x."""
        program, n = self.program, self.n
        A, B, H = program.matrices
        P: np.ndarray = program.terminal
        K = np.zeros((self.m, n))
        for _ in range(program.qp.count):
            inner = H[n:, n:] + B.T @ P @ B
            K = np.linalg.lstsq(inner, H[n:, :n] + B.T @ P @ A, rcond=None)[0]
            P = H[:n, :n] + A.T @ P @ A - (H[:n, n:] + A.T @ P @ B) @ K
        return K

    def radius(self, servo: AxisServo | None, speeds: bool) -> float:
        """Return the spectral radius of a cycle; below 1 the loop settles.

        Without a servo the plant takes the inputs of the controller. servo: that of the plant, of a controller that
        commands one. speeds: whether it receives speeds.
        """
        n, m, program = self.n, self.m, self.program
        o, delay, axes = program.observer, program.horizon.delay, program.servo
        nd = program.d.numel()
        sizes = [n, n if o is not None else 0, nd, delay * m, (delay + 1) * m if axes else 0]
        ends = np.cumsum([0, *sizes])
        unit = np.eye(ends[-1])
        state, hat, d, past, sent = (unit[a:b] for a, b in pairwise(ends.tolist()))
        advance = self._derivatives(program.advance, 0, speeds)
        if o is None:
            hat = state
        else:
            missed = o.slope @ (state - hat)
            hat, d = hat + o.x @ missed, (d + o.d @ missed) if nd else d
        shift = d if nd else np.zeros((m, len(unit)))
        queue = [past[j * m : (j + 1) * m] for j in range(delay)]
        way = [sent[j * m : (j + 1) * m] for j in range(delay + 1)] if axes else []

        def advanced(x: Any, v: Any, k: int) -> Any:
            total = advance[0] @ x + advance[1] @ v + (advance[2] @ d if nd else 0.0)
            return total + (advance[4] @ np.vstack(way[k : k + 2]) if axes else 0.0)

        ahead: np.ndarray = hat
        for k, v in enumerate(queue):
            ahead = advanced(ahead, v, k)
        queue.append(-self.gain @ ahead - shift)
        if axes:
            command = self._derivatives(program.command, 3, speeds)
            way.append(
                command[0] @ ahead + command[1] @ queue[-1] + (command[2] @ d if nd else 0.0) + command[4] @ way[-1]
            )
        rows = [*([advanced(hat, queue[0], 0)] if o is not None else []), d, *queue[1:], *way[1:]]
        if axes is None or servo is None:
            return _radius([advance[0] @ state + advance[1] @ queue[0], *rows])
        kp, kd = servo.gains(m)
        F, by_force, by_rate = axes.motion(kp, kd)
        du = (way[1] - way[0]) / program.horizon.period * float(speeds)
        force, rate = kp[:, None] * way[1] + kd[:, None] * du, kp[:, None] * du
        return _radius([F @ state + by_force @ force + by_rate @ rate, *rows])


def _radius(rows: list[Any]) -> float:
    return float(np.max(np.abs(np.linalg.eigvals(np.vstack(rows)))))
