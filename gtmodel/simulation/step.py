"""Integration over any length with CVODES, or IDAS where Newton unknowns ride along."""

from __future__ import annotations

from contextlib import redirect_stderr
from functools import cached_property
from io import StringIO
from typing import Any

import casadi as ca
import numpy as np

from .reduced import Reduced

# equal intervals in one call, at most: the multistep method keeps its order and step size over them. Newton unknowns
# are followed row by row after it, which is lost where they went astray
MOST_ROWS, MOST_FOLLOWED = 500, 50
# of an expensive system fewer, so that it can be stopped on the way: instructions of its rates in all rows together
MOST_WORK = 1_000_000
# integrators that are kept, of one number of intervals each
KEPT = 32
# internal steps in one interval: where that is not enough, the interval is halved
MOST_STEPS = 1000
# a call over fewer intervals than this mostly builds up its order, in many short steps whose errors add up; each may
# err by so much of the tolerance, down to what double precision leaves
FEW, RESTARTED, FINEST = 50, 0.01, 1e-13
# longest internal steps, in intervals, are powers of this
STEP_RATIO = 4.0


class Stepper:
    """Integrates a reduced system over one or several equal intervals; None where it gives up.

    States and unknowns are scaled by their nominals, so that one tolerance fits all of them; the energies
    supplied and dissipated are integrated beside the states, with the same error control. `bounded`: internal steps
    are no longer than one interval.
    """

    def __init__(self, reduced: Reduced, tolerance: float, method: str, bounded: bool = False) -> None:
        self._reduced = r = reduced
        plan, flat = r.plan, r.plan.flat
        self.x_scale = np.array([flat.variables[i].nominal for i, _ in plan.states])
        self.z_scale = np.concatenate([b.scale for b in plan.newton]) if plan.newton else np.zeros(0)
        s, t0, length = ca.SX.sym("s"), ca.SX.sym("t0"), ca.SX.sym("length")
        x, z = ca.SX.sym("x", r.x.numel()), ca.SX.sym("z", r.z.numel())
        old = [r.x, r.z, r.t]
        new = [ca.DM(self.x_scale) * x, ca.DM(self.z_scale) * z, t0 + s * length]
        rates, powers, residuals = ca.substitute([r.rates, r.powers, r.residuals], old, new)
        self._dae = {
            "x": ca.vertcat(x, ca.SX.sym("work", 2)),
            "t": s,
            "p": ca.vertcat(t0, length, r.p),
            "ode": length * ca.vertcat(rates / self.x_scale, powers),
        }
        self._options: dict[str, Any] = {
            "abstol": tolerance,
            "reltol": tolerance,
            "max_num_steps": MOST_STEPS,
            "disable_internal_warnings": True,
            "show_eval_warnings": False,  # a step that leaves the model's range is tried again, shorter
        }
        self._tolerance = tolerance
        self._most = 1.0 if bounded else np.inf  # intervals in one internal step
        if z.numel():
            self._dae |= {"z": z, "alg": residuals}
            self._options["calc_ic"] = True
        else:
            self._options["linear_multistep_method"] = method
        self._integrators: dict[tuple[int, float, bool], ca.Function] = {}

    @cached_property
    def most(self) -> int:
        """Intervals in one call."""
        return (
            MOST_FOLLOWED
            if "z" in self._dae
            else max(MOST_FOLLOWED, min(MOST_ROWS, MOST_WORK // max(1, self._reduced.rate.n_instructions())))
        )

    def _longest(self, intervals: float, count: int) -> float:
        """Longest internal step in intervals, rounded down so that few integrators serve all lengths."""
        longest = min(self._most, intervals)
        return STEP_RATIO ** float(np.floor(np.log(longest) / np.log(STEP_RATIO))) if longest < count else np.inf

    def _integrator(self, count: int, longest: float, few: bool) -> ca.Function:
        key = count, longest, few
        if key not in self._integrators:
            if len(self._integrators) >= KEPT:
                self._integrators.pop(next(iter(self._integrators)))
            grid = list(map(float, range(1, count + 1)))
            plugin = "idas" if "z" in self._dae else "cvodes"
            options = self._options | ({"max_step_size": longest} if longest < count else {})
            if few:
                options["abstol"] = options["reltol"] = min(self._tolerance, max(FINEST, RESTARTED * self._tolerance))
            self._integrators[key] = ca.integrator(f"step{count}", plugin, self._dae, 0.0, grid, options)
        return self._integrators[key]

    def __call__(
        self,
        x: np.ndarray,
        z: np.ndarray,
        time: float,
        length: float,
        p: np.ndarray,
        count: int = 1,
        longest: float = np.inf,
        likely: int = FEW,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        """After each of `count` intervals of `length` seconds: states (count, n), Newton unknowns
        (count, m), and the energies supplied and dissipated since the start of the call (count, 2). `longest`: of its
        internal steps [s]. `likely`: how many of the intervals will be of use."""
        integrator = self._integrator(count, self._longest(longest / length, count), min(count, likely) < FEW)
        start = np.concatenate([x / self.x_scale, [0.0, 0.0]])
        try:
            # SUNDIALS says on the terminal what it returns as well
            with redirect_stderr(StringIO()):
                result = integrator(x0=start, z0=z / self.z_scale, p=np.concatenate([[time, length], p]))
        except RuntimeError:
            return None
        end = np.asarray(result["xf"].full()).T
        unknowns = np.asarray(result["zf"].full()).T if z.size else np.zeros((count, 0))
        if not (np.all(np.isfinite(end)) and np.all(np.isfinite(unknowns))):
            return None
        return end[:, : x.size] * self.x_scale, unknowns * self.z_scale, end[:, x.size :]
