"""Inertias of links in their two forms: mass, centre of mass and tensor about it, and the ten numbers of forces."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...lang import ModelError

Array = np.ndarray
# of a symmetric tensor: xx, xy, xz, yy, yz, zz
ROWS, COLUMNS = np.array([0, 0, 0, 1, 1, 2]), np.array([0, 1, 2, 1, 2, 2])


def tensor(six: ArrayLike) -> Array:
    """Tensors (..., 3, 3) of xx, xy, xz, yy, yz, zz (..., 6)."""
    six = np.asarray(six, float)
    full = np.zeros((*six.shape[:-1], 3, 3))
    full[..., ROWS, COLUMNS] = six
    full[..., COLUMNS, ROWS] = six
    return full


def six_of(full: ArrayLike) -> Array:
    """xx, xy, xz, yy, yz, zz (..., 6) of tensors (..., 3, 3)."""
    return np.asarray(full, float)[..., ROWS, COLUMNS]


def about_point(m: ArrayLike, r: ArrayLike) -> Array:
    """Inertia (..., 3, 3) of point masses m (...,) [kg] at r (..., 3) [m] about the origin."""
    r = np.asarray(r, float)
    square = np.sum(r**2, axis=-1)[..., None, None] * np.eye(3)
    return np.asarray(m, float)[..., None, None] * (square - r[..., :, None] * r[..., None, :])


def moments(m: ArrayLike, c: ArrayLike | None, I: ArrayLike | None) -> tuple[Array, Array]:
    """mc (n, 3) and J (n, 6) about the frames' origins of masses (n,), centres c (n, 3) and inertias I (n, 3, 3)."""
    m = np.asarray(m, float)
    c = np.zeros((len(m), 3)) if c is None else np.asarray(c, float)
    I = np.zeros((len(m), 3, 3)) if I is None else np.asarray(I, float)
    if c.shape != (len(m), 3) or I.shape != (len(m), 3, 3):
        raise ModelError(f"c takes ({len(m)}, 3) and I ({len(m)}, 3, 3); found {c.shape} and {I.shape}")
    return m[:, None] * c, six_of(I + about_point(m, c))


def central(m: float, mc: ArrayLike, J: ArrayLike) -> tuple[Array, Array]:
    """Centre of mass (3,) [m] and inertia about it (3, 3) of a body with mass; m must not be 0."""
    c = np.asarray(mc, float) / m
    return c, tensor(J) - about_point(m, c)


def moved(R: Array, r: Array, m: float, mc: Array, J: Array) -> tuple[Array, Array]:
    """mc and J of a body in a frame where its own stands at r (3,) turned by R (3, 3)."""
    h = R @ mc
    cross = np.outer(r, h)
    shift = about_point(m, r) + 2 * (r @ h) * np.eye(3) - cross - cross.T
    return h + m * r, six_of(R @ tensor(J) @ R.T + shift)


def with_payload(values: dict[str, Any], payload: float, n: int) -> dict[str, Any]:
    """Modifiers of an arm with a point mass at the tool's origin. Raises ModelError for a payload below 0."""
    if payload < 0:
        raise ModelError(f"a payload is a mass of 0 kg or more; found {payload:g} kg")
    if not payload:
        return values
    point = np.asarray(values.get("tool_xyz", np.zeros(3)), float)
    m, mc, J = (
        np.array(values.get(name, np.zeros(shape)), float) for name, shape in (("m", n), ("mc", (n, 3)), ("J", (n, 6)))
    )
    m[-1] += payload
    mc[-1] += payload * point
    J[-1] += six_of(about_point(payload, point))
    return {**values, "m": m, "mc": mc, "J": J}
