"""What a rule on an element passes over: a function of time that moves in less than the distance of its points.

Bounds of the function tell where it moves. There the model's rates along the solution are integrated between the
places where it bends, and the difference to the rule is what the rule did not see.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import casadi as ca
import numpy as np

from ...compiler.analysis.bounds import edges_of
from ..formulation.system import RateSystem
from ..tables import CollocationTable

# of an element: a straight stretch that is shorter lies between two points of the rule
NARROW = 0.1
# stretches in all: more are a ripple, of which a part tells enough
MOST = 20_000
# Gauss points of each stretch
NODES, WEIGHTS = np.polynomial.legendre.leggauss(3)

# (element, places in it (n,)) -> rates (n, nx) and integrands (n, q)
Along = Callable[[int, np.ndarray], tuple[np.ndarray, np.ndarray]]


def bends(
    system: RateSystem, integrands: ca.Function, P: np.ndarray, edges: np.ndarray, t0: float, duration: float
) -> dict[int, np.ndarray]:
    """Elements on which a function of time has stretches shorter than NARROW of them, with the places (0 to 1) where
    it bends. integrands: (x, rates, u, P, t) -> those of the objective; edges: (N + 1,) of the elements, 0 to 1."""
    functions = [(f, f.n_in() - 2, f.n_in() - 1) for f in (system.values, integrands)]
    functions = [(f, p, t) for f, p, t in functions if any(f.jac_sparsity(k, t).nnz() for k in range(f.n_out()))]
    if not functions:
        return {}
    columns, time = [], ca.SX.sym("t")
    for f, p, _ in functions:
        arguments = [*f.sx_in()[:p], ca.SX(ca.DM(P)), time]
        columns += f.call(arguments)
    times = edges_of(ca.vertcat(*columns), time, t0, t0 + duration)
    if times.size > MOST:
        times = times[:MOST]
    places: dict[int, np.ndarray] = {}
    for k, (left, right) in enumerate(pairwise(edges.tolist())):
        inner = ((times - t0) / duration - left) / (right - left)
        inner = inner[(inner > 0) & (inner < 1)]
        if inner.size and np.min(np.diff(np.concatenate([[0.0], inner, [1.0]]))) < NARROW:
            places[k] = inner
    return places


def passed_over(
    places: np.ndarray, fine: CollocationTable, length: float, at_nodes: np.ndarray, element: int, along: Along
) -> tuple[np.ndarray, np.ndarray]:
    """Errors (M, nx) of the states at the nodes of a rule on one element, and (q,) of the integrals, by what the rule
    does not see. at_nodes: (M, nx) rates there; places: where functions of time bend; length: of the element [s]."""
    cuts = np.unique(np.concatenate([[0.0], places, fine.points, [1.0]]))
    half = 0.5 * np.diff(cuts)
    rates, integrands = along(element, (cuts[:-1, None] + half[:, None] * (1 + NODES)).ravel())
    weights = length * half[:, None] * WEIGHTS

    def sums(values: np.ndarray) -> np.ndarray:
        return np.einsum("ic,icx->ix", weights, values.reshape(*weights.shape, values.shape[-1]))

    reached = np.cumsum(sums(rates), axis=0)[np.searchsorted(cuts, fine.points) - 1]
    seen = np.linalg.solve(fine.derivative[1:].T, length * at_nodes)
    return reached - seen, sums(integrands).sum(axis=0)
