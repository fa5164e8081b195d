"""Springs of a parallel robot: links, their ball joints, drives, bearings of the carts, machine frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

Array = np.ndarray
GROUPS = ("links", "joints", "drives", "carts", "frame")


@dataclass(frozen=True, eq=False)
class LinkSprings:
    """Compliances of a parallel robot, zero where something is rigid. Springs at the same place are in series.

    Each is one number, or one for each link, cart or axis. link: rods, L/(E A) [m/N]; joint: one ball joint along its
    link [m/N], of which a link has two; `parallel`: how many rods with joints of their own lie side by side in each
    link of the model, three for arm 3 of the three-link model (Dressler 2012, section 4.3). drive: along the guideway,
    drive train and servo loop [m/N]. axis: rotary axes on the carts [rad/(N.m)]. cart: bearings across the guideway
    [m/N]. frame_along, frame_across: of the machine frame at each cart [m/N]. Raises ValueError for negative numbers.

    >>> gt.compliance.LinkSprings(link=-5e-8)
    Traceback (most recent call last):
    ValueError: link must be a compliance of zero or more; found -5e-08
    """

    link: ArrayLike
    joint: ArrayLike = 0.0
    parallel: ArrayLike = 1
    drive: ArrayLike = 0.0
    axis: ArrayLike = 0.0
    cart: ArrayLike = 0.0
    frame_along: ArrayLike = 0.0
    frame_across: ArrayLike = 0.0

    def __post_init__(self) -> None:
        for name in ("link", "joint", "drive", "axis", "cart", "frame_along", "frame_across"):
            value = np.asarray(getattr(self, name), float)
            if not np.all(np.isfinite(value)) or np.any(value < 0):
                raise ValueError(f"{name} must be a compliance of zero or more; found {getattr(self, name)}")
        if not np.all(np.asarray(self.parallel, float) >= 1) or not np.all(np.isfinite(self.parallel)):
            raise ValueError(f"parallel counts rods side by side, 1 or more; found {self.parallel}")

    def by_group(self, links: int, carts: int, axes: int) -> dict[str, Array]:
        """Compliances (links + 3 carts + axes,) of each group of springs.

        The order is: links, then along, across and across each cart's guideway, then rotary axes. The sum over the
        groups is the compliance of each coordinate.
        """
        sizes = (links, 3 * carts, axes)
        groups = {name: [np.zeros(size) for size in sizes] for name in GROUPS}
        parallel = _each(self.parallel, links, "parallel")
        groups["links"][0] = _each(self.link, links, "link") / parallel
        groups["joints"][0] = 2 * _each(self.joint, links, "joint") / parallel
        groups["drives"][1][0::3] = _each(self.drive, carts, "drive")
        groups["drives"][2] = _each(self.axis, axes, "axis")
        for start, frame in enumerate((self.frame_along, self.frame_across, self.frame_across)):
            groups["frame"][1][start::3] = _each(frame, carts, "frame")
            groups["carts"][1][start::3] = _each(self.cart, carts, "cart") if start else 0.0
        return {name: np.concatenate(parts) for name, parts in groups.items()}


def tube(modulus: float, outer: float, inner: float, length: ArrayLike) -> Array:
    """Compliance L/(E A) [m/N] of a tube along itself: modulus [Pa], diameters [m], lengths [m].

    Raises ValueError for a tube without wall.

    >>> gt.compliance.tube(70e9, outer=0.040, inner=0.036, length=[1.0, 2.0]).round(10)
    array([5.980e-08, 1.197e-07])
    """
    if not (modulus > 0 and 0 <= inner < outer):
        raise ValueError(
            f"a tube needs a modulus above 0 and an outer diameter above the inner; found {outer}, {inner}"
        )
    return np.asarray(length, float) / (modulus * np.pi / 4 * (outer**2 - inner**2))


def _each(value: ArrayLike, count: int, name: str) -> Array:
    array = np.asarray(value, float)
    if array.ndim and array.size != count:
        raise ValueError(f"{name} has {array.size} numbers; expected one, or {count}")
    return np.broadcast_to(array, (count,)).astype(float)
