"""The size of an objective, by which it is scaled up for the solver where its units make it tiny.

IPOPT ends where derivatives are below its tolerance: an objective in micrometres squared would be optimal everywhere.
"""

from __future__ import annotations

from collections.abc import Iterable

import casadi as ca
import numpy as np

from ..lang.scope import Misfit
from .watch import Program

SMALL = 1e-4  # derivatives per nominal below this are scaled up; IPOPT itself scales down those above LARGE
LARGE = 100.0
MOST = 1e20  # more says that the objective is none
SEED, TRIALS = 0, 2


def objective_scale(program: Program, x0: np.ndarray, misfits: Iterable[Misfit]) -> float:
    """What the objective is to be multiplied by: 1, or more where all its derivatives are small about a nominal
    away from the guess, or where it holds measured values of unknown noise and these scatter little."""
    slope = program.functions["grad_f"]

    def largest(x: np.ndarray) -> float:
        gradient = np.abs(np.asarray(slope(x, [])[1]).reshape(-1))[program.lbx < program.ubx]
        return float(np.max(gradient, initial=0.0)) if np.all(np.isfinite(gradient)) else np.inf

    rng = np.random.default_rng(SEED)
    away = [np.clip(x0 + rng.choice([-1.0, 1.0], len(x0)), program.lbx, program.ubx) for _ in range(TRIALS)]
    here = largest(x0)
    size = max(here, *map(largest, away))
    scatter = _scatter(misfits)
    if 0 < scatter < size:
        size = max(scatter, here / LARGE)
    return 1.0 if not 0 < size < SMALL else min(1.0 / size, MOST)


def _scatter(misfits: Iterable[Misfit]) -> float:
    """Sum of squares of measured values about their mean, where their noise is unknown; 0 where it is known."""
    total = 0.0
    for m in misfits:
        if m.known:
            return 0.0
        symbols = ca.symvar(m.residual)
        data = np.asarray(ca.Function("data", symbols, [m.residual])(*[0.0] * len(symbols))).reshape(-1)
        spread = float(np.sum((data - data.mean()) ** 2)) or float(data @ data)
        total += spread if np.isfinite(spread) else 0.0
    return total
