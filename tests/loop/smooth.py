"""A smooth motion from rest to rest, as gtmodel solve --out writes its reference."""

from __future__ import annotations

import numpy as np

from gtmodel.results import Trajectory

UNITS = {"T": "m", "der(T)": "m/s", "der(T,2)": "m/s2"}


def smooth(step_s: float = 0.004) -> Trajectory:
    """In 0.8 s by a fifth-order polynomial; with another step between its rows, slower."""
    s = np.arange(201) / 200
    by, duration = np.array([0.3, -0.1, 0.15]), 0.8
    place = (10 * s**3 - 15 * s**4 + 6 * s**5)[:, None] * by + [0.0, -0.9, 0.1]
    rate = (30 * s**2 - 60 * s**3 + 30 * s**4)[:, None] * by / duration
    second = (60 * s - 180 * s**2 + 120 * s**3)[:, None] * by / duration**2
    return Trajectory(step_s * np.arange(201), {"T": place, "der(T)": rate, "der(T,2)": second}, UNITS)
