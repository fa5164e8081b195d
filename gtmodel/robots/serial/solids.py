"""Volumes and moments of inertia of solids of uniform density, by the sizes of MJCF."""

from __future__ import annotations

from typing import Any

import numpy as np

Array = np.ndarray


def _sphere(a: float) -> tuple[float, Array]:
    return 4 / 3 * np.pi * a**3, np.full(3, 0.4 * a**2)


def _box(a: float, b: float, c: float) -> tuple[float, Array]:
    return 8 * a * b * c, np.array([b**2 + c**2, a**2 + c**2, a**2 + b**2]) / 3


def _ellipsoid(a: float, b: float, c: float) -> tuple[float, Array]:
    return 4 / 3 * np.pi * a * b * c, np.array([b**2 + c**2, a**2 + c**2, a**2 + b**2]) / 5


def _cylinder(radius: float, half: float) -> tuple[float, Array]:
    across = radius**2 / 4 + half**2 / 3
    return 2 * np.pi * radius**2 * half, np.array([across, across, radius**2 / 2])


def _capsule(radius: float, half: float) -> tuple[float, Array]:
    """A cylinder with two half balls, whose centres of mass are 3/8 of the radius beyond its ends."""
    tube, ball = 2 * np.pi * radius**2 * half, 4 / 3 * np.pi * radius**3
    across = tube * (radius**2 / 4 + half**2 / 3)
    across += ball * (0.4 * radius**2 - (3 / 8 * radius) ** 2 + (half + 3 / 8 * radius) ** 2)
    along = tube * radius**2 / 2 + ball * 0.4 * radius**2
    return tube + ball, np.array([across, across, along]) / (tube + ball)


# volume and principal moments per mass from the half sizes
SOLIDS: dict[str, Any] = {
    "sphere": _sphere, "box": _box, "ellipsoid": _ellipsoid, "cylinder": _cylinder, "capsule": _capsule,
}  # fmt: skip
SIZES = {"sphere": 1, "box": 3, "ellipsoid": 3, "cylinder": 2, "capsule": 2}
