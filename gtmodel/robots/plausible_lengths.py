"""Lengths and motions of a robot file that are far from what their keys say: metres for millimetres, lost signs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from .six_link import ARM, LINKS

# link lengths [m] of a robot that carts carry: shorter or longer ones are in another unit, a thousand times as large or
# small, so that no length is taken in both
SHORTEST, LONGEST = 0.02, 20.0
# points in link lengths: least and greatest size of the farthest one. Cart joints lie about the room, plate and cart
# joints in their own frames within a fraction of a link; a slip of unit is a factor of 1000
SIZES = {
    "A": (0.0, 300.0),
    "A0": (0.01, 300.0),
    "A_bj": (1e-3, 10.0),
    "B": (1e-3, 10.0),
    "B0": (1e-3, 10.0),
    "r3": (1e-3, 10.0),
}
# motion of a cart joint per q: about 1; a slip of unit is a factor of 1000
MOTION = (0.1, 10.0)
ONE_CART = 0.1  # of that motion; links of one cart that move farther apart tear it to pieces

# by the key's unit and whether the numbers are too small for it
_HINTS = {
    ("m", True): "are too short for a robot; give metres",
    ("m", False): "look like millimetres; give metres",
    ("mm", True): "look like metres; give millimetres",
    ("mm", False): "look like micrometres; give millimetres",
}


def implausible_length(table: Mapping[str, Any]) -> tuple[str, str] | None:
    """The first key whose numbers are far from what the unit in its name allows, and what is wrong with it; or None.

    Points that are all zero are no slip of a unit.
    """
    key = next(key for key in ("L_m", "L_mm") if key in table)
    unit, factor = ("m", 1.0) if key == "L_m" else ("mm", 1e-3)
    L = factor * np.array(table[key])
    if L.min() < SHORTEST or L.max() > LONGEST:
        what = f"link lengths from {L.min() / factor:.6g} to {L.max() / factor:.6g} {unit}"
        return key, f"{what} {_HINTS[unit, bool(L.min() < SHORTEST)]}"
    for stem, (least, greatest) in SIZES.items():
        points = np.array(table.get(f"{stem}_{unit}", [[0.0]]))
        size = factor * float(np.max(np.linalg.norm(points, axis=-1))) / L.max()
        if 0.0 < size < least or size > greatest:
            what = f"coordinates up to {np.max(np.abs(points)):.6g} {unit}"
            return f"{stem}_{unit}", f"{what} {_HINTS[unit, size < least]}"
    motion = _implausible_motion(np.atleast_2d(np.array(table["v"])))
    return None if motion is None else ("v", motion)


def _implausible_motion(v: np.ndarray) -> str | None:
    """What is wrong with guideways that do not move their carts by about q, or the links of one cart not alike."""
    size = np.linalg.norm(v, axis=1)
    wrong = np.flatnonzero((size < MOTION[0]) | (size > MOTION[1]))
    if len(wrong):
        k = int(wrong[0])
        said = f"row {k + 1} moves its cart joint by {size[k]:.6g} m per metre of q, about 1 expected"
        return f"{said}; a guideway direction has the length 1"
    if len(v) != len(ARM):
        return None
    for k, arm in enumerate(ARM):
        first = ARM.index(arm)
        apart = float(np.linalg.norm(v[k] - v[first]) / size[first])
        if apart > ONE_CART:
            return (f"links {LINKS[first]} and {LINKS[k]} stand on one cart, and their rows differ by "
                    f"{100 * apart:.0f} %; a sign or a row is probably wrong here")  # fmt: skip
    return None
