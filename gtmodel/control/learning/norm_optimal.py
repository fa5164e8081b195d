"""Norm-optimal laws: u(k+1) minimises e'We + u'Su + du'R du, with bounds as a quadratic program."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy

from ...results import ArgumentError
from .law import DENSE, SOLVED, LearningLaw
from .lifted import Array, Lifted, identity, lifted
from .plants import Plant, stable

LONGEST = 3000  # samples of a run with bounds: three matrices of 72 MB
SOLVERS = ("daqp", "osqp")  # an exact active-set method; if it fails, a first-order method with polishing
OSQP = {"eps_abs": 1e-10, "eps_rel": 1e-10, "max_iter": 50_000, "polish": True, "verbose": False}


def norm_optimal_law(plant: Plant | Lifted, size: int, change: float, effort: float = 0.0) -> LearningLaw:
    """Return the law that minimises |e|^2 + effort |u|^2 + change |u(k+1) - u(k)|^2.

    With scalar weights R = change and S = effort: Q = (T'T + S + R)^-1 (T'T + R), L = (T'T + R)^-1 T'. The input
    contracts by sigma = R / (R + S + s_min(T)^2). With a delay sigma is 1 for S = 0, because the last inputs do not
    reach the output within the run.

    Args:
        plant: with one input and one output, or its lifted map. size: samples of a run.

    Raises ArgumentError if a weight is not positive (effort may be 0), or if the plant has a pole on or outside the
    unit circle, which makes its lifted map nearly singular.

    >>> learning = gt.control.learning
    >>> loop = learning.delayed_lag(*learning.ACTUATORS[0], 5)
    >>> law = learning.norm_optimal_law(loop, 200, change=0.1, effort=0.01)
    >>> round(learning.largest_gain(law.map(learning.lifted(loop, 200))), 9)  # 0.1 / 0.11
    0.909090909
    """
    T = _lifted(plant, size)
    _weights(change, effort)
    square, one = T.adjoint @ T, identity(T.size)
    before = square + change * one
    Q = inverse(square + (change + effort) * one) @ before if effort else one
    return LearningLaw(Q, inverse(before) @ T.adjoint)


def model_inverse_law(plant: Plant | Lifted, size: int, regularisation: float, Q: Lifted | None = None) -> LearningLaw:
    """Return a law with your own Q and L = (T'T + regularisation)^-1 T', the regularised inverse of the model.

    regularisation: of the squared gain; 0.01 leaves out frequencies with a gain below 0.1. Q: a map of runs of `size`
    samples; the identity by default. Raises ArgumentError as `norm_optimal_law`.

    >>> learning = gt.control.learning
    >>> axis = learning.flexible_axis(11.5, 0.05)
    >>> law = learning.model_inverse_law(axis.signals["tool"], 300, 0.01)
    >>> law.L.size
    300
    """
    T = _lifted(plant, size)
    _weights(regularisation, 0.0)
    law = norm_optimal_law(T, size, regularisation)
    return LearningLaw(Q or identity(size), law.L)


def inverse(map: Lifted) -> Lifted:
    """Return the inverse of a symmetric positive definite map, by Cholesky factorisation or, for long runs, conjugate
    gradients.

    Raises ArgumentError if the map is not, or only barely, positive definite.

    >>> learning = gt.control.learning
    >>> learning.inverse(learning.weighted([2.0, 4.0]))([1.0, 1.0]).round(12).tolist()
    [0.5, 0.25]
    """
    if map.size <= DENSE:
        M = map.dense()
        try:
            factor = scipy.linalg.cho_factor((M + M.T) / 2)
        except np.linalg.LinAlgError:
            raise ArgumentError("the map is not positive definite; raise the weights", "map") from None
        return Lifted(map.size, *2 * (lambda x: scipy.linalg.cho_solve(factor, x),))
    operator = map.operator()

    def solve(x: Array) -> Array:
        y = np.empty_like(x)
        for k in range(x.shape[1]):
            y[:, k], info = scipy.sparse.linalg.cg(operator, x[:, k], rtol=SOLVED, atol=0.0, maxiter=20 * map.size)
            if info:
                raise ArgumentError("conjugate gradients did not converge: raise the weights or shorten the run", "map")
        return y

    return Lifted(map.size, solve, solve)


def bounded_update(
    plant: Plant | Lifted, u: Any, error: Any, change: float, effort: float = 0.0, *, largest: float | None = None,
    largest_step: float | None = None,
) -> Array:  # fmt: skip
    """Return the next input (N,) of a norm-optimal law with bounds, from a quadratic program solved by CasADi.

    Args:
        plant: as in `norm_optimal_law`. u, error: (N,) of the last run. change, effort: the weights.
        largest: bound on the absolute input. largest_step: bound on its change per sample, from zero before the first.

    Without bounds the result equals the law's update. Raises ArgumentError as `norm_optimal_law`, if a bound is not
    positive, or if no solver converges.

    >>> learning = gt.control.learning
    >>> loop = learning.delayed_lag(0.5, 0.5, delay=1)
    >>> u = learning.bounded_update(loop, np.zeros(20), np.ones(20), change=0.1, largest=0.8, largest_step=0.3)
    >>> bool(np.abs(u).max() < 0.8 + 1e-9), bool(np.abs(np.diff(u)).max() < 0.3 + 1e-9)
    (True, True)
    """
    u, e = np.asarray(u, float), np.asarray(error, float)
    _weights(change, effort)
    M = _dense(plant, len(u))
    target = e + M @ u
    return _least(M, target, change + effort, M.T @ target + change * u, u, largest, largest_step)


def bounded_limit(
    plant: Plant | Lifted, first_error: Any, effort: float, *, largest: float | None = None,
    largest_step: float | None = None,
) -> Array:  # fmt: skip
    """Return the limit (N,) of `bounded_update` on a plant, the input that minimises |e|^2 + effort |u|^2 with bounds.

    Each update is a proximal step towards this input, so the distance contracts by R / (R + S + s_min(T)^2) or better,
    as without bounds (Rockafellar 1976).

    Args:
        first_error: (N,) of the run without input. effort: above 0; the others as in `bounded_update`.

    Raises ArgumentError as `bounded_update`.

    >>> learning = gt.control.learning
    >>> loop = learning.delayed_lag(0.5, 0.5, delay=1)
    >>> u = learning.bounded_limit(loop, np.ones(20), effort=0.1, largest=0.8)
    >>> round(float(np.abs(u).max()), 9)
    0.8
    """
    e = np.asarray(first_error, float)
    if not effort > 0:
        raise ArgumentError(f"must be above 0 with bounds on the input; found {effort:g}", "effort")
    M = _dense(plant, len(e))
    return _least(M, e, effort, M.T @ e, np.zeros(len(e)), largest, largest_step)


def _dense(plant: Plant | Lifted, size: int) -> Array:
    T = _lifted(plant, size)
    if size > LONGEST:
        raise ArgumentError(
            f"a law with bounds on the input solves a dense quadratic program of at most {LONGEST} samples; the run "
            f"has {size}: leave out the bounds, or use a shorter run",
            "largest",
        )
    return T.dense()


def _least(
    M: Array, target: Array, weight: float, right: Array, u: Array, largest: float | None, largest_step: float | None
) -> Array:
    """Minimise x' (M'M + weight) x / 2 - right' x within bounds."""
    import casadi as ca

    for name, bound in (("largest", largest), ("largest_step", largest_step)):
        if bound is not None and not bound > 0:
            raise ArgumentError(f"must be above 0; found {bound:g}", name)
    n = len(target)
    square, linear = M.T @ M + weight * np.eye(n), -right
    scale = max(float(np.abs(target).max()), float(np.abs(u).max()), 1e-300)  # solvers use absolute tolerances
    most = np.inf if largest is None else largest / scale
    step = np.inf if largest_step is None else largest_step / scale
    rows = ca.sparsify(ca.DM(np.eye(n) - np.eye(n, k=-1)))
    for name in SOLVERS:
        solver = ca.conic(
            "update", name, {"h": ca.Sparsity.dense(n, n), "a": rows.sparsity()},
            {"error_on_fail": False, **({"osqp": OSQP} if name == "osqp" else {})},
        )  # fmt: skip
        solution = solver(h=ca.DM(square), g=linear / scale, a=rows, lbx=-most, ubx=most, lba=-step, uba=step)
        if solver.stats()["success"]:
            return np.clip(solution["x"].full()[:, 0] * scale, -most * scale, most * scale)
    raise ArgumentError(f"no solver converged ({', '.join(SOLVERS)}); raise the weights or widen the bounds", "largest")


def _lifted(plant: Plant | Lifted, size: int) -> Lifted:
    if not isinstance(plant, Lifted):
        return lifted(stable(plant), size)
    if plant.size != size:
        raise ArgumentError(f"the map has {plant.size} samples; expected {size}", "plant")
    return plant


def _weights(change: float, effort: float) -> None:
    if not change > 0:
        raise ArgumentError(f"the weight must be above 0; found {change:g}", "change")
    if not effort >= 0:
        raise ArgumentError(f"the weight must not be negative; found {effort:g}", "effort")
