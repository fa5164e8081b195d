"""The links of a robot: their names in the model, the links on guideways, and the cluster and cart of each."""

from __future__ import annotations

import re

import numpy as np

from ..compiler.causal import flat_of
from ..geometry.quaternions import quaternion_of
from ..geometry.rotations import nearest_rotation
from ..lang import Model

Array = np.ndarray
LINKS = ("1", "2a", "2b", "3a", "3b", "3c")
ROWS = ([0], [1, 2], [3, 4, 5])  # links of each arm


def centred(rows: Array) -> Array:
    """Return the rows minus their mean."""
    return rows - rows.mean(axis=0)


def orientation(cart: Array, plate: Array) -> tuple[Array, float]:
    """Return the rotation R (3, 3) from plate to world that makes clusters closest to parallel, and the misfit [m].

    A Wahba fit of R B_ij to A_ij within each cluster, det R = +1; cart (6, 3) in world, plate (6, 3) in plate
    coordinates. The largest misfit is some millimetres on calibrated geometries, and hundreds of millimetres if a sign
    or a row is wrong.
    """
    a = np.vstack([centred(np.asarray(cart, dtype=float)[rows]) for rows in ROWS])
    b = np.vstack([centred(np.asarray(plate, dtype=float)[rows]) for rows in ROWS])
    R = nearest_rotation(a.T @ b)
    return R, float(np.max(np.linalg.norm(a - b @ R.T, axis=1)))


def attitude(cart: Array, plate: Array) -> tuple[Array, float]:
    """Return `orientation` as a unit quaternion, scalar first, its largest entry positive."""
    R, misfit = orientation(cart, plate)
    return quaternion_of(R, positive="largest"), misfit


_ROD = re.compile(r"(.+)\.a\.r")
_LINK = re.compile(r"(?P<part>\w+)\[(?P<index>\d+)\]\.rod\.a\.r")


def rod_names(robot: Model) -> list[str]:
    """Return the names, such as "link[0].rod", of all parts with ends a and b, a length L and a `tension`."""
    flat = flat_of(robot)
    names = [m[1] for m in map(_ROD.fullmatch, flat.groups) if m]
    return [name for name in names if f"{name}.tension" in flat.groups and f"{name}.L" in flat.bindings]


def link_names(robot: Model) -> list[str]:
    """Return the names of the cart joints of all links whose guideway has its own direction v."""
    flat = flat_of(robot)
    names = [name for name in flat.groups if _LINK.fullmatch(name)]
    return [name for name in names if name.removesuffix("rod.a.r") + "v" in flat.bindings]


def links_of(robot: Model) -> list[tuple[str, int]]:
    """Return part and index of the links that `link_names` finds."""
    return [(m["part"], int(m["index"])) for m in map(_LINK.fullmatch, link_names(robot)) if m]


def family_of(model: Model) -> str:
    """Return three_link, six_link or f1, also for a user's robot with the same parameters; "" for other mechanisms."""
    if hasattr(model, "A0") and hasattr(model, "u1_2"):
        return "f1"
    A, v = (np.shape(getattr(model, n, ())) for n in "Av")
    if A == v == (6, 3) and hasattr(model, "B"):
        return "six_link"
    return "three_link" if A == v == (3, 3) else ""
