"""Which family of the Gantry-Tau a robot is of, by the parameters that it declares."""

from __future__ import annotations

import numpy as np

from ..lang import Model


def family_of(model: Model) -> str:
    """three_link, six_link or f1; "" for another mechanism. Robots of a user's own that declare the same are found."""
    if hasattr(model, "A0") and hasattr(model, "u1_2"):
        return "f1"
    A, v = (np.shape(getattr(model, n, ())) for n in "Av")
    if A == v == (6, 3) and hasattr(model, "B"):
        return "six_link"
    return "three_link" if A == v == (3, 3) else ""
