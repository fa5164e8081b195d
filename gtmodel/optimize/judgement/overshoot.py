"""What a control polynomial does between the points where it is bounded."""

from __future__ import annotations

import numpy as np
from numpy.polynomial import polynomial

from ..control import coefficients, control_basis
from ..nlp import Nlp, placed
from ..solution import horizon


def control_range(nlp: Nlp, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest value (controls,) that the control polynomials take anywhere in their elements.

    A polynomial of K points bounded at its points only overshoots between them, most at an element's ends.
    """
    mesh, u = nlp.mesh, nlp.physical(x)[:, nlp.element.layout.u]  # (elements, coefficients, controls)

    def basis_at(s: np.ndarray) -> np.ndarray:
        return control_basis(mesh.control, mesh.table, s)

    values = basis_at(np.concatenate([[0.0, 1.0], mesh.table.points])) @ u
    low, high = values.min((0, 1), initial=np.inf), values.max((0, 1), initial=-np.inf)
    degree = coefficients(mesh.control, mesh.table) - 1
    if degree > 1 and u.size:
        fitted = np.linspace(0.0, 1.0, degree + 1) if mesh.control != "polynomial" else mesh.table.points
        columns = (basis_at(fitted) @ u).transpose(1, 0, 2).reshape(degree + 1, -1)
        slopes = polynomial.polyder(polynomial.polyfit(fitted, columns, degree))
        turns = [polynomial.polyroots(slope) for slope in slopes.T]
        which = np.repeat(np.arange(len(turns)), [len(own) for own in turns])
        roots = np.concatenate(turns)
        s = np.real(roots)
        inside = np.isreal(roots) & (s > 0) & (s < 1)
        element, control = np.divmod(which[inside], u.shape[2])
        turned = np.sum(basis_at(s[inside]) * u[element, :, control], axis=1)
        np.minimum.at(low, control, turned)
        np.maximum.at(high, control, turned)
    return low, high


def control_curves(nlp: Nlp, x: np.ndarray, per_element: int = 15) -> tuple[np.ndarray, np.ndarray]:
    """Controls on both ends and inside of every element, for drawing: times (n,) [s] and values (n, controls).

    At an edge both neighbours' values stand, one after the other: a control may jump there.
    """
    t0, tf = horizon(nlp, x)
    local = np.linspace(0.0, 1.0, per_element)
    mesh = placed(nlp, x)
    s = (mesh.edges[:-1, None] + mesh.h[:, None] * local).ravel()
    return t0 + s * (tf - t0), np.concatenate(nlp.inputs(x, local)[..., : nlp.element.layout.nu])
