"""One integration step of any length with CVODES, or IDAS where Newton unknowns ride along."""

from __future__ import annotations

from functools import cached_property

import casadi as ca
import numpy as np

from .reduced import Reduced


CHUNK = 50  # output intervals in one call: the multistep method keeps its order and step size


class Stepper:
    """Integrates a reduced system over one interval, or over a chunk of equal ones; None where it gives up."""

    def __init__(self, reduced: Reduced, tolerance: float, method: str = "bdf") -> None:
        r = reduced
        s, t0, length = ca.SX.sym("s"), ca.SX.sym("t0"), ca.SX.sym("length")
        time = t0 + s * length
        rates, powers, residuals = ca.substitute([r.rates, r.powers, r.residuals], [r.t], [time])
        self.n = r.x.numel()
        self.m = r.z.numel()
        self.dae = {
            "x": ca.vertcat(r.x, ca.SX.sym("work", 2)),
            "t": s,
            "p": ca.vertcat(t0, length, r.p),
            "ode": length * ca.vertcat(rates, powers),
        }
        self.options = {
            "abstol": tolerance,
            "reltol": tolerance,
            "max_num_steps": 100000,
            "disable_internal_warnings": True,
            "show_eval_warnings": False,  # a step that leaves the model's range is tried again, shorter
        }
        if self.m:
            self.dae |= {"z": r.z, "alg": residuals}
            self.options["calc_ic"] = True
        else:
            self.options["linear_multistep_method"] = method

    @cached_property
    def _one(self) -> ca.Function:
        return self._integrator("step", [1.0])

    @cached_property
    def _chunk(self) -> ca.Function:
        return self._integrator("chunk", list(map(float, range(1, CHUNK + 1))))

    def _integrator(self, name: str, grid: list[float]) -> ca.Function:
        return ca.integrator(name, "idas" if self.m else "cvodes", self.dae, 0.0, grid, self.options)

    def __call__(
        self, x: np.ndarray, z: np.ndarray, time: float, length: float, p: np.ndarray, chunk: bool = False
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        """After one interval of `length` seconds, or after each of CHUNK such intervals: states (k, n), Newton
        unknowns (k, m), and the energy supplied and dissipated since the start of the call (k, 2)."""
        k = CHUNK if chunk else 1
        if self.n == 0 and self.m == 0:
            return np.zeros((k, 0)), np.zeros((k, 0)), np.zeros((k, 2))
        integrator = self._chunk if chunk else self._one
        start = np.concatenate([x, [0.0, 0.0]])
        try:
            result = integrator(x0=start, z0=z, p=np.concatenate([[time, length], p]))
        except RuntimeError:
            return None
        end = np.asarray(result["xf"].full()).T
        if not np.all(np.isfinite(end)):
            return None
        found = np.asarray(result["zf"].full()).T if self.m else np.zeros((k, 0))
        return end[:, : self.n], found, end[:, self.n :]
