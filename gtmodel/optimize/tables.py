"""Own collocation tables: Radau and Gauss points on (0, 1], any order.

casadi.collocation_coeff drops the node at 0 for one Radau point and returns half the weight: not used.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.polynomial import legendre

SCHEMES = ("radau", "gauss")


@dataclass(frozen=True)
class CollocationTable:
    """Collocation on one element scaled to [0, 1] with K points.

    `points` (K,); `derivative` (K + 1, K): derivative at point c of the state polynomial through node 0 and the
    points; `weights` (K,): quadrature; `end` (K + 1,): value at 1 of that polynomial.
    """

    scheme: str
    points: np.ndarray
    derivative: np.ndarray
    weights: np.ndarray
    end: np.ndarray

    @property
    def nodes(self) -> np.ndarray:
        """Nodes of the state polynomial: 0 and the points."""
        return np.concatenate([[0.0], self.points])


def points(scheme: str, count: int) -> np.ndarray:
    """Radau IIA ("radau", ends at 1) or Gauss-Legendre ("gauss") points on [0, 1]."""
    if count < 1:
        raise ValueError(f"a collocation element needs at least one point; found {count}")
    if scheme == "gauss":
        return (legendre.leggauss(count)[0] + 1) / 2
    if scheme == "radau":
        # roots of P_K - P_(K-1) on [-1, 1] hold 1
        c = np.zeros(count + 1)
        c[count], c[count - 1] = 1.0, -1.0
        roots = np.sort(legendre.legroots(c).real)
        roots[-1] = 1.0
        for _ in range(3):  # Newton polish: companion roots lose digits at high order
            f, df = legendre.legval(roots, c), legendre.legval(roots, legendre.legder(c))
            roots[:-1] -= f[:-1] / df[:-1]
        return (roots + 1) / 2
    raise ValueError(f"there is no collocation scheme '{scheme}'; there are {' and '.join(SCHEMES)}")


@cache
def table(scheme: str, count: int) -> CollocationTable:
    """Points, differentiation matrix, weights and end values; read-only."""
    c = points(scheme, count)
    nodes = np.concatenate([[0.0], c])
    x, w = legendre.leggauss(count + 1)  # exact for the basis, without monomials that lose digits
    weights = (w / 2) @ basis(c, (x + 1) / 2)
    made = CollocationTable(scheme, c, basis_slope(nodes, c).T, weights, basis(nodes, np.array([1.0]))[0])
    for array in (made.points, made.derivative, made.weights, made.end):
        array.setflags(write=False)
    return made


def basis(nodes: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Values (len(at), len(nodes)) of the Lagrange polynomials that are 1 at one node and 0 at the others."""
    at = np.asarray(at, float)
    n = len(nodes)
    values = np.ones((len(at), n))
    for j in range(n):
        for k in range(n):
            if k != j:
                values[:, j] *= (at - nodes[k]) / (nodes[j] - nodes[k])
    return values


def basis_slope(nodes: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Derivatives (len(at), len(nodes)) of the Lagrange polynomials, by the product rule."""
    at = np.asarray(at, float)
    n = len(nodes)
    jacobian = np.zeros((len(at), n))
    for j in range(n):
        for m in range(n):
            if m == j:
                continue
            term = np.full(len(at), 1.0 / (nodes[j] - nodes[m]))
            for k in range(n):
                if k not in (j, m):
                    term *= (at - nodes[k]) / (nodes[j] - nodes[k])
            jacobian[:, j] += term
    return jacobian
