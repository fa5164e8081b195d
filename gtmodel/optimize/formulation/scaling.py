"""Scaling of unknowns, rows and the objective from nominals, bounds and derivatives."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import casadi as ca
import numpy as np

from ...compiler.blocks import median
from ...compiler.plan import CausalPlan
from ...lang.scope import Misfit
from ...lang.source import ModelError
from ...results.trajectory import Trajectory
from ..watch import Program
from .horizon import Pair

# rows smaller than this are scaled up, since IPOPT relaxes them by 1e-8; IPOPT scales larger rows itself. For the same
# reason, unknowns whose bounds are this small relative to their nominal are scaled by their bounds
SMALL = 1e-4


def of_trajectory(scaling: Trajectory | None, free: dict[str, float]) -> tuple[tuple[str, float], ...]:
    """Return the largest magnitude of each nonzero scalar in a trajectory, its end as final_time, and free constants.

    Raises ModelError for another type.
    """
    if scaling is None:
        return ()
    if not isinstance(scaling, Trajectory):
        raise ModelError(f"scaling must be a gt.Trajectory or an earlier solution; found {scaling!r}")
    largest = {"final_time": abs(float(scaling.time[-1]))} | {n: abs(v) for n, v in free.items()}
    for name in scaling.names:
        sizes = np.atleast_1d(np.max(np.abs(scaling[name]), axis=0))
        head, comma, order = name.removeprefix("der(").removesuffix(")").partition(",")
        for k, size in enumerate(sizes.tolist()):
            entry = f"{head}[{k}]" if np.ndim(scaling[name]) > 1 else head
            largest[f"der({entry}{comma}{order})" if name.startswith("der(") else entry] = size
    return tuple((n, v) for n, v in sorted(largest.items()) if v > 0)


def within(nominal: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return sizes of unknowns: the nominal, or the larger bound if both bounds are far smaller."""
    reach = np.maximum(np.abs(low), np.abs(high))
    return np.where((reach > 0) & (reach < SMALL * nominal), reach, nominal)


def of_constants(guess: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return sizes of free constants: 1 or a larger guess, or the bounds if these are far smaller.

    With one bound only, the size is the larger of guess and bound if both are far smaller than 1.
    """
    size = within(np.maximum(1.0, np.abs(guess)), low, high)
    bound = np.minimum(np.abs(low), np.abs(high))
    reach = np.maximum(np.abs(guess), bound)
    one_sided = (np.isfinite(low) != np.isfinite(high)) & (guess != 0) & (reach < SMALL)
    return np.where(one_sided, reach, size)


def scale_of(size: float) -> float:
    """Return the divisor of a row of that size."""
    return size if 0 < size < SMALL else 1.0


@dataclass(eq=False)
class Jacobians:
    """Derivatives of expressions with respect to x, xd and u, per nominal, at consistent points of a plan."""

    plan: CausalPlan
    arguments: list[ca.SX]
    pairs: tuple[list[Pair], list[Pair], list[Pair]]
    nominal: np.ndarray
    P: np.ndarray

    def _points(self, count: int | None) -> list[list[np.ndarray]]:
        points = []
        for sample in self.plan.samples[:count]:
            known = dict(zip(self.plan.pairs, sample, strict=True))
            point = [np.array([known.get(p, 0.0) for p in pairs]) for pairs in self.pairs]
            points.append([*point, self.P, np.array(self.plan.sampler.time)])
        return points

    def largest(self, rows: ca.SX, count: int | None = None) -> np.ndarray:
        """Return the largest derivative of each row (samples, rows); 0 if none is finite."""
        f = ca.Function("derivatives", self.arguments, [ca.jacobian(rows, ca.vertcat(*self.arguments[:3]))])
        largest = []
        for point in self._points(count):
            jacobian = np.abs(np.asarray(f(*point).full())) * self.nominal
            largest.append(np.max(np.where(np.isfinite(jacobian), jacobian, 0.0), axis=1, initial=0.0))
        return np.array(largest)

    def typical(self, rows: list[ca.SX]) -> np.ndarray:
        """Return the median over the points of each row's largest derivative; 1 if that is 0."""
        if not rows:
            return np.ones(0)
        size = median(self.largest(ca.vertcat(*rows)))
        return np.where(size > 0, size, 1.0)

    def at_one(self, rows: ca.SX) -> np.ndarray:
        """Return each row's largest derivative at the first point; 1 if that is 0."""
        if not rows.numel():
            return np.ones(0)
        size = self.largest(rows, 1)[0]
        return np.where(size > 0, size, 1.0)

    def of_points(self, rows: list[ca.SX], symbols: ca.SX, values: list[ca.SX], P: ca.SX, p_size: np.ndarray):
        """Return sizes of rows in `symbols`, the `values` at instants: the largest derivative with respect to a value,
        per size of the value, or a constant, at a consistent point and one size away from it."""
        if not rows:
            return np.ones(0)
        size = self.typical(values)
        jacobian = ca.Function("derivatives", [symbols, P], [ca.jacobian(ca.vertcat(*rows), ca.vertcat(symbols, P))])
        value_function = ca.Function("values", self.arguments, [ca.vertcat(*values) if values else ca.SX(0, 1)])
        largest = np.zeros(len(rows))
        for point in self._points(1):
            v = np.asarray(value_function(*point).full()).reshape(-1)
            for v_at in (v, v + size):
                each = np.abs(np.asarray(jacobian(v_at, self.P).full())) * np.concatenate([size, p_size])
                largest = np.maximum(largest, np.max(np.where(np.isfinite(each), each, 0.0), axis=1, initial=0.0))
        return np.where(largest > 0, largest, 1.0)


LARGE = 100.0
MOST = 1e20  # limit of the factor
SEED, TRIALS = 0, 2


def objective_scale(program: Program, x0: np.ndarray, misfits: Iterable[Misfit]) -> float:
    """Return the factor of the objective: above 1 if all its derivatives are small near the guess, or if its misfits
    have unknown noise and the measured values scatter little; else 1."""
    slope = program.functions["grad_f"]

    def largest(x: np.ndarray) -> float:
        gradient = np.abs(np.asarray(slope(x, [])[1]).reshape(-1))[program.lbx < program.ubx]
        return float(np.max(gradient, initial=0.0)) if np.all(np.isfinite(gradient)) else np.inf

    rng = np.random.default_rng(SEED)
    perturbed = [np.clip(x0 + rng.choice([-1.0, 1.0], len(x0)), program.lbx, program.ubx) for _ in range(TRIALS)]
    at_guess = largest(x0)
    size = max(at_guess, *map(largest, perturbed))
    scatter = _scatter(misfits)
    if 0 < scatter < size:
        size = max(scatter, at_guess / LARGE)
    return 1.0 if not 0 < size < SMALL else min(1.0 / size, MOST)


def _scatter(misfits: Iterable[Misfit]) -> float:
    """Return the sum of squares of measured values about their mean; 0 if the noise is known."""
    total = 0.0
    for m in misfits:
        if m.known:
            return 0.0
        symbols = ca.symvar(m.residual)
        data = np.asarray(ca.Function("data", symbols, [m.residual])(*[0.0] * len(symbols))).reshape(-1)
        spread = float(np.sum((data - data.mean()) ** 2)) or float(data @ data)
        total += spread if np.isfinite(spread) else 0.0
    return total
