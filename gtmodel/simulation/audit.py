"""Every equation as a person wrote it, at numbers that a simulation found."""

from __future__ import annotations

import casadi as ca
import numpy as np

from ..compiler.plan import CausalPlan
from .over_rows import OverRows

# an equation left by more than this part of its largest term was not solved; round-off of stiff forces stays below
BROKEN = 1e-6
# residuals below this, in SI units, are not looked at any closer
SMALL = 1e-9


class OriginalEquations:
    """The equations before any elimination, over `plan.pairs`; `fold` has numbers for the parameters, and symbols for
    those at `places`, which vary."""

    def __init__(self, plan: CausalPlan, fold: ca.SX, places: list[int]) -> None:
        flat = self.flat = plan.flat
        pairs = self.pairs = sorted({pair for e in flat.equations for pair in flat.scope.symbols_in(e.residual)})
        place = {pair: n for n, pair in enumerate(plan.pairs)}
        self._sign, self._place = np.zeros(len(pairs)), np.zeros(len(pairs), dtype=int)
        for n, pair in enumerate(pairs):
            sign, kept, order = plan.alias.resolve(*pair)
            self._sign[n], self._place[n] = sign, place[(kept, order)]
        symbols = ca.vertcat(*[flat.scope.symbol(*pair) for pair in pairs])
        residuals = ca.densify(ca.vertcat(*[e.residual for e in flat.equations]))
        self.arguments = [symbols, flat.p, flat.scope.time]
        written = ca.Function("equations", self.arguments, [residuals])
        self._places = places
        values, time, varied = ca.SX.sym("values", len(pairs)), ca.SX.sym("time"), ca.SX(fold[places])
        self._residuals = OverRows(ca.Function("equations", [values, time, varied], [written(values, fold, time)]))

    def __call__(self, points: np.ndarray, times: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Values of `pairs` and residuals, one row for each point; p: values of the parameters."""
        values = self._sign * points[:, self._place]
        return values, self._residuals(values, times[:, None], p[self._places])[0]


class Audit:
    """Residuals of the equations before any elimination, at points over the plan's pairs.

    `residual` is the largest |left - right| so far, of any equation at any point, in SI units.
    """

    def __init__(self, equations: OriginalEquations, p: np.ndarray) -> None:
        self._equations, self._p = equations, p
        self.residual = 0.0
        self._worst: tuple[np.ndarray, float, int] | None = None

    def __call__(self, points: np.ndarray, times: np.ndarray) -> None:
        """Look at points (rows)."""
        if not len(times) or not self._equations.flat.equations:
            return
        values, residuals = self._equations(points, times, self._p)
        residuals = np.abs(residuals)
        point, equation = np.unravel_index(int(np.argmax(residuals)), residuals.shape)
        if residuals[point, equation] > self.residual:
            self.residual = float(residuals[point, equation])
            self._worst = values[point], float(times[point]), int(equation)

    def verdict(self) -> str | None:
        """A sentence if the worst equation does not hold, measured by its largest term; else None."""
        if self._worst is None or self.residual <= SMALL:
            return None
        values, time, row = self._worst
        flat, arguments = self._equations.flat, self._equations.arguments
        e = flat.equations[row]
        gradient = ca.Function("gradient", arguments, [ca.densify(ca.jacobian(e.residual, arguments[0]))])
        nominal = np.array([flat.variables[i].nominal for i, _ in self._equations.pairs])
        terms = np.abs(gradient(values, self._p, time).full().reshape(-1)) * np.maximum(np.abs(values), nominal)
        if self.residual <= BROKEN * np.max(terms, initial=0.0):
            return None
        return (
            f"{e.label} ({e.where}) does not hold at {time:.6g} s: a residual of {self.residual:.3g} is left; use a "
            "smaller tolerance or step"
        )
