"""The equations of a problem as an ordinary differential equation, independent of the formulation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from ...compiler.matrices import called
from .dynamic import DynamicProblem

STEPS = 20
NEWTON_DONE = 1e-12  # relative size of a correction that counts as converged


@dataclass(eq=False)
class RateSystem:
    """The equations as an ordinary differential equation with `count` unknowns without a closed form (`pairs`).

    values: (x, given inputs, unknowns, P, t) -> rates, point variables; residual: same arguments -> r, dr/dunknowns.
    """

    values: ca.Function
    residual: ca.Function
    slope: ca.Function
    pairs: list[tuple[int, int]]

    @property
    def count(self) -> int:
        return len(self.pairs)

    @classmethod
    def of(cls, problem: DynamicProblem) -> RateSystem:
        """Return the system of a problem, built once. Raises ModelError if the model has no explicit form."""
        if "system" not in problem.cache:
            problem.cache["system"] = cls._build(problem)
        return problem.cache["system"]

    @classmethod
    def _build(cls, problem: DynamicProblem) -> RateSystem:
        form = problem.builder.explicit()
        rates = list(form.rates)
        extra = [r for r in problem.rates[len(rates) :] if r is not None]
        # rates of cost states may contain unknowns that the formulation left unsolved
        old = ca.vertcat(problem.xd[: len(rates)], *[problem.flat.scope.symbol(*p) for p in problem.z_pairs])
        new = ca.vertcat(*rates, *form.point)
        if extra and old.numel():
            extra = ca.substitute(extra, [old], [new])
        unknowns = ca.vertcat(*form.unknowns) if form.unknowns else ca.SX(0, 1)
        residual = ca.vertcat(*form.residuals) if form.residuals else ca.SX(0, 1)
        arguments = [problem.x, problem.builder.given, unknowns, problem.P, problem.t]
        rates = ca.vertcat(*rates, *extra)
        values = ca.Function("values", arguments, [rates, ca.vertcat(*form.point) if form.point else ca.SX(0, 1)])
        jacobian = ca.Function("residual", arguments, [residual, ca.densify(ca.jacobian(residual, unknowns))])
        jacobians = [ca.densify(ca.jacobian(e, problem.x)) for e in (rates, residual)]
        slope = ca.Function("slope", arguments, [*jacobians, ca.densify(ca.jacobian(rates, unknowns))], {"cse": True})
        pairs = [p for p in map(problem.flat.scope.owner, form.unknowns) if p is not None]
        return cls(values, jacobian, slope, pairs)

    def near(self, problem: DynamicProblem, inputs: np.ndarray, rates: np.ndarray) -> np.ndarray:
        """Return start values (n, count) of the unknowns from rows of all inputs and state rates; 0 for others."""
        place = {p: (inputs, n) for n, p in enumerate(problem.input_pairs)}
        place |= {(i, k + 1): (rates, n) for n, (i, k) in enumerate(problem.state_pairs)}
        z = np.zeros((len(inputs), self.count))
        for n, pair in enumerate(self.pairs):
            if pair in place:
                rows, column = place[pair]
                z[:, n] = rows[:, column]
        return z

    def jacobian(self, x: np.ndarray, given: np.ndarray, z: np.ndarray, P: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Return the total Jacobian (n, nx, nx) of the rates with respect to the states; NaN if it is singular."""
        n, nx = x.shape
        direct, by_states, through = on_rows(self.slope, (x, given, z), P, t)
        jacobian = _stacked(direct, n, nx)
        if self.count:
            matrix = _stacked(on_rows(self.residual, (x, given, z), P, t)[1], n, self.count)
            try:
                response = np.linalg.solve(matrix, _stacked(by_states, n, nx))
            except np.linalg.LinAlgError:
                return np.full(jacobian.shape, np.nan)
            jacobian = jacobian - _stacked(through, n, self.count) @ response
        return jacobian

    def solved(self, x: np.ndarray, given: np.ndarray, z: np.ndarray, P: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Solve for the unknowns without a closed form (n, count) by Newton's method from z; NaN if it diverges."""
        n = len(t)
        if not self.count:
            return z
        done = np.zeros(n, bool)
        for _ in range(STEPS):
            r, jacobians = on_rows(self.residual, (x, given, z), P, t)
            jacobian = _stacked(jacobians, n, self.count)
            finite = np.all(np.isfinite(jacobian), axis=(1, 2)) & np.all(np.isfinite(r), axis=0)
            step = np.full(z.shape, np.nan)
            try:
                step[finite] = np.linalg.solve(jacobian[finite], -r.T[finite, :, None])[..., 0]
            except np.linalg.LinAlgError:
                for k in np.flatnonzero(finite):
                    step[k] = np.linalg.lstsq(jacobian[k], -r[:, k], rcond=None)[0]
            z = z + step
            done = np.max(np.abs(step), axis=1) <= NEWTON_DONE * (1 + np.max(np.abs(z), axis=1))
            if np.all(done | ~finite):
                break
        return np.where(done[:, None], z, np.nan)

    def at(
        self, x: np.ndarray, given: np.ndarray, z: np.ndarray, P: np.ndarray, t: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return rates and all inputs (n, ...) for rows."""
        rates, point = on_rows(self.values, (x, given, z), P, t)
        return rates.T, np.hstack([given, point.T])


def _stacked(side_by_side: np.ndarray, n: int, width: int) -> np.ndarray:
    """Reshape matrices (r, n * width) to (n, r, width)."""
    return side_by_side.reshape(len(side_by_side), n, width).transpose(1, 0, 2)


def on_rows(
    f: ca.Function, rows: Sequence[np.ndarray], P: np.ndarray, times: np.ndarray, *more: np.ndarray
) -> list[np.ndarray]:
    """Evaluate f at n instants, results (r, n); `rows` and `more` (n, ...) precede and follow the arguments P and t."""
    n = len(times)
    whole = f.map(n)
    values = called(whole, *rows, np.tile(P, (n, 1)), times, *more)
    shapes = [(f.size2_out(k) * n, f.size1_out(k)) for k in range(f.n_out())]
    if all(f.sparsity_out(k).is_dense() for k in range(f.n_out())):
        return [v.reshape(shape).T for v, shape in zip(values, shapes, strict=True)]
    return [ca.DM(whole.sparsity_out(k), v).full() for k, v in enumerate(values)]
