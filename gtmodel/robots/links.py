"""Links of a robot by their names in the model, those that run on guideways, and which of them form a cluster on which
cart."""

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
    """Rows less their mean."""
    return rows - rows.mean(axis=0)


def orientation(cart: Array, plate: Array) -> tuple[Array, float]:
    """Rotation R (3, 3) from plate to world at which clusters are nearest to parallel, and the worst misfit [m].

    A Wahba fit of R B_ij to A_ij within each cluster, det R = +1; cart (6, 3) in world, plate (6, 3) in plate
    coordinates. The misfit is some millimetres on calibrated sets and hundreds where a sign or a row is wrong.
    """
    a = np.vstack([centred(np.asarray(cart, dtype=float)[rows]) for rows in ROWS])
    b = np.vstack([centred(np.asarray(plate, dtype=float)[rows]) for rows in ROWS])
    R = nearest_rotation(a.T @ b)
    return R, float(np.max(np.linalg.norm(a - b @ R.T, axis=1)))


def attitude(cart: Array, plate: Array) -> tuple[Array, float]:
    """The same rotation as a unit quaternion, scalar first, its largest entry positive."""
    R, misfit = orientation(cart, plate)
    return quaternion_of(R, positive="largest"), misfit


_ROD = re.compile(r"(.+)\.a\.r")
_LINK = re.compile(r"(?P<part>\w+)\[(?P<index>\d+)\]\.rod\.a\.r")


def rod_names(robot: Model) -> list[str]:
    """Names of all parts with ends a and b, a length L and a `tension`, as mechanics.Rod: "link[0].rod"."""
    flat = flat_of(robot)
    names = [m[1] for m in map(_ROD.fullmatch, flat.groups) if m]
    return [name for name in names if f"{name}.tension" in flat.groups and f"{name}.L" in flat.bindings]


def link_names(robot: Model) -> list[str]:
    """Names of the cart joints of all links that run on a guideway of their own direction v."""
    flat = flat_of(robot)
    names = [name for name in flat.groups if _LINK.fullmatch(name)]
    return [name for name in names if name.removesuffix("rod.a.r") + "v" in flat.bindings]


def links_of(robot: Model) -> list[tuple[str, int]]:
    """Part and index of the arms whose links `link_names` names."""
    return [(m["part"], int(m["index"])) for m in map(_LINK.fullmatch, link_names(robot)) if m]


def family_of(model: Model) -> str:
    """three_link, six_link or f1; "" for another mechanism. Robots of a user's own that declare the same are found."""
    if hasattr(model, "A0") and hasattr(model, "u1_2"):
        return "f1"
    A, v = (np.shape(getattr(model, n, ())) for n in "Av")
    if A == v == (6, 3) and hasattr(model, "B"):
        return "six_link"
    return "three_link" if A == v == (3, 3) else ""
