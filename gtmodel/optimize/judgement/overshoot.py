"""What a control polynomial does between the points where it is bounded."""

from __future__ import annotations

import numpy as np
from numpy.polynomial import Polynomial

from ..control import coefficients
from ..nlp import Nlp, placed
from ..solution import horizon


def control_range(nlp: Nlp, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest value (controls,) that the control polynomials take anywhere in their elements.

    A polynomial of K points bounded at its points only overshoots between them, most at an element's ends.
    """
    layout, mesh = nlp.element.layout, nlp.mesh
    low, high = np.full(layout.nu, np.inf), np.full(layout.nu, -np.inf)
    degree = coefficients(mesh.control, mesh.table) - 1
    fitted = np.linspace(0.0, 1.0, degree + 1) if mesh.control != "polynomial" else mesh.table.points
    for k in range(mesh.elements):
        at_fitted = controls_of(nlp, x, k, fitted)
        for j in range(layout.nu):
            turns = np.zeros(0)
            if degree > 1:
                polynomial = Polynomial.fit(fitted, at_fitted[:, j], degree, domain=[0, 1], window=[0, 1])
                turns = polynomial.deriv().roots()
            turns = turns[np.isreal(turns)].real
            at = np.concatenate([[0.0, 1.0], mesh.table.points, turns[(turns > 0) & (turns < 1)]])
            values = controls_of(nlp, x, k, at)[:, j]
            low[j], high[j] = min(low[j], values.min()), max(high[j], values.max())
    return low, high


def control_curves(nlp: Nlp, x: np.ndarray, per_element: int = 15) -> tuple[np.ndarray, np.ndarray]:
    """Controls on both ends and inside of every element, for drawing: times (n,) [s] and values (n, controls).

    At an edge both neighbours' values stand, one after the other: a control may jump there.
    """
    t0, tf = horizon(nlp, x)
    local = np.linspace(0.0, 1.0, per_element)
    mesh = placed(nlp, x)
    s = np.concatenate([mesh.edges[k] + mesh.h[k] * local for k in range(mesh.elements)])
    return t0 + s * (tf - t0), np.vstack([controls_of(nlp, x, k, local) for k in range(mesh.elements)])


def controls_of(nlp: Nlp, x: np.ndarray, element: int, local: np.ndarray) -> np.ndarray:
    """Controls (len(local), nu) of one element at fractions of it."""
    return nlp.inputs(x, element, local)[:, : nlp.element.layout.nu]
