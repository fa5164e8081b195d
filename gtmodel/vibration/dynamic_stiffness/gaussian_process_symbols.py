"""Predictions of Gaussian processes as CasADi expressions: gradients for an optimiser, C for a control loop."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np
import scipy

from .gaussian_process import GaussianProcess

NEAR = 1e-20  # added to a squared distance before its root: the derivative at a training pose is then zero, not NaN


def predictions(processes: Sequence[GaussianProcess], pose: Any, *, std: bool = False) -> tuple[list[Any], list[Any]]:
    """Means and, on request, standard deviations of the fields at a CasADi SX vector (d,).

    Processes with the same training poses and lengths share distances and exponentials.
    """
    shared: dict[tuple[Any, ...], Any] = {}
    means, stds = [], []
    for g in processes:
        key = (g.shape, g.inputs, g.lengths.tobytes(), g.coordinates.tobytes())
        if key not in shared:
            shared[key] = _correlations(g, pose)
        C = shared[key]
        constant = g.mean + g.level**2 * float(g.weights.sum())
        means.append(constant + ca.dot(ca.DM(g.amplitude**2 * g.weights), C))
        if std:
            k = g.level**2 + g.amplitude**2 * C
            inverse = scipy.linalg.solve_triangular(g.factor, np.eye(len(g.y)), lower=True)
            v = ca.mtimes(ca.DM(inverse), k)
            stds.append(g.inflation * ca.sqrt(ca.fmax(g.level**2 + g.amplitude**2 - ca.dot(v, v), 0.0)))
    return means, stds


def _correlations(g: GaussianProcess, pose: Any) -> Any:
    owners = g.inputs.owners
    x = [c / float(g.lengths[o]) for c, o in zip(g.inputs.symbols(pose), owners, strict=True)]
    if g.shape == "squared_exponential":
        # exp(x x_i - x^2/2 - x_i^2/2): two operations fewer per coordinate than with differences
        square = -sum(c * c for c in x) / 2
        constants = -(g.coordinates**2).sum(axis=1) / 2
        return ca.vertcat(*(
            ca.exp(sum((float(v) * c for v, c in zip(row, x, strict=True)), square + float(b)))
            for row, b in zip(g.coordinates, constants, strict=True)
        ))  # fmt: skip
    rows = []
    for row in g.coordinates:
        t = ca.sqrt(5 * sum((c - float(v)) ** 2 for v, c in zip(row, x, strict=True)) + NEAR)
        rows.append((1 + t + t * t / 3) * ca.exp(-t))
    return ca.vertcat(*rows)
