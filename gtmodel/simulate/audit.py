"""Every equation as a person wrote it, at numbers that a simulation found."""

from __future__ import annotations

import casadi as ca
import numpy as np

from ..compiler.plan import Plan


class Audit:
    """Residuals of the equations before any elimination, at points over `plan.pairs`."""

    def __init__(self, plan: Plan) -> None:
        flat = plan.flat
        pairs = sorted({pair for e in flat.equations for pair in flat.scope.symbols_in(e.residual)})
        place = {pair: n for n, pair in enumerate(plan.pairs)}
        self._sign, self._place = np.zeros(len(pairs)), np.zeros(len(pairs), dtype=int)
        for n, pair in enumerate(pairs):
            sign, kept, order = plan.alias.resolve(*pair)
            self._sign[n], self._place[n] = sign, place[(kept, order)]
        symbols = ca.vertcat(*[flat.scope.symbol(*pair) for pair in pairs])
        residuals = ca.vertcat(*[e.residual for e in flat.equations])
        self._residuals = ca.Function("equations", [symbols, flat.p, flat.scope.time], [residuals])
        self._p = flat.require_values()

    def __call__(self, points: np.ndarray, times: np.ndarray) -> float:
        """Largest |left - right| of any equation at any of the points (rows), in SI units."""
        if not len(times):
            return 0.0
        values = self._sign * points[:, self._place]
        residuals = self._residuals(values.T, self._p, times[None, :]).full()
        return float(np.max(np.abs(residuals), initial=0.0))
