"""Links of a robot by their names in the model: all of them, and those that run on guideways; its family."""

from __future__ import annotations

import re

import numpy as np

from ..compiler.causal import flat_of
from ..lang import Model

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
