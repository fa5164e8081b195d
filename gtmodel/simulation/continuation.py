"""Newton unknowns along a motion: never another solution than the one that leads here."""

from __future__ import annotations

import casadi as ca
import numpy as np

from ..compiler.newton import solve_rows
from .reduced import Reduced

CORRECTIONS = 12
# each correction must shrink to a quarter of the last, as in compiler.newton: then no other solution is entered
CONTRACTION = 0.25
# in nominals, or in parts of a larger unknown: so far an unknown goes in one step, so that no narrow bend is missed
REACH = 0.1
# corrections this small are round-off, even of badly scaled equations
ROUND_OFF = 1e-8
CONVERGED = 1e-13
SHORTEST = 1.0 / 4096
MOST_STEPS = 2000


class NewtonContinuation:
    """Follows r(z, a) == 0, where a holds states, time and tables' pieces (x, t, p)."""

    def __init__(self, reduced: Reduced, scale: np.ndarray) -> None:
        self._scale = scale
        r, z = reduced.residuals, reduced.z
        a = ca.vertcat(reduced.x, reduced.t, reduced.p)
        along = ca.SX.sym("along", a.numel())
        jacobian = ca.densify(ca.jacobian(r, z))
        self._newton = ca.Function("newton", [z, a], [r, jacobian])
        self._tangent = ca.Function("tangent", [z, a, along], [ca.densify(ca.jtimes(r, a, along)), jacobian])

    def place(self, x: np.ndarray, time: float, p: np.ndarray) -> np.ndarray:
        return np.concatenate([x, [time], p])

    def apart(self, z: np.ndarray, other: np.ndarray) -> float:
        """Largest distance of two solutions, in nominals or in parts of a larger unknown."""
        return float(np.max(np.abs(z - other) / self._size(z), initial=0.0))

    def tangent(self, z: np.ndarray, a: np.ndarray, along: np.ndarray) -> np.ndarray:
        """How far z goes, to first order, while a goes `along`; NaN where the equations are singular."""
        rate, jacobian = (np.asarray(v.full()) for v in self._tangent(z, a, along))
        return -solve_rows(jacobian[None], rate.T)[0]

    def correct(self, z: np.ndarray, a: np.ndarray) -> np.ndarray | None:
        """The solution right beside z, to round-off; None where Newton does not contract to one."""
        last = REACH
        for n in range(CORRECTIONS):
            r, jacobian = (np.asarray(v.full()) for v in self._newton(z, a))
            step = solve_rows(jacobian[None], -r.T)[0]
            size = self.apart(z, z + step)
            if not size <= max(last * (CONTRACTION if n else 1.0), ROUND_OFF):
                return None
            z = z + step
            if size <= CONVERGED or (size <= ROUND_OFF and size > 0.5 * last):
                return z
            last = size
        return z if last <= ROUND_OFF else None

    def step(self, z: np.ndarray, a: np.ndarray) -> np.ndarray | None:
        """The step of Newton's method from z, at most REACH of each unknown; None where the equations are singular."""
        r, jacobian = (np.asarray(v.full()) for v in self._newton(z, a))
        step = solve_rows(jacobian[None], -r.T)[0]
        if not np.all(np.isfinite(step)):
            return None
        return step * min(1.0, float(np.min(self._size(z) / np.maximum(np.abs(step), 1e-300))))

    def follow(self, z: np.ndarray, begin: np.ndarray, end: np.ndarray) -> np.ndarray | None:
        """The solution at `end` that continues z, which solves at `begin`; None where it leads nowhere."""
        done, step = 0.0, 1.0
        for _ in range(MOST_STEPS):
            part = min(1.0, done + step)
            here, there = (begin + s * (end - begin) for s in (done, part))
            ahead = self.tangent(z, here, there - here)
            near = bool(np.all(np.abs(ahead) <= REACH * self._size(z)))
            corrected = self.correct(z + ahead, there if part < 1.0 else end) if near else None
            if corrected is None:
                step /= 2
                if step < SHORTEST:
                    return None
                continue
            z, done, step = corrected, part, 2 * step
            if done >= 1.0:
                return z
        return None

    def _size(self, z: np.ndarray) -> np.ndarray:
        return np.maximum(self._scale, np.abs(z))
