"""The Queensland Gantry-Tau's triangular arm as an option of the six-link robot."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..geometry.quaternions import quaternion_matrix
from .six_link import SixLink, six_link_gantry_tau


def triangular(robot: SixLink) -> dict[str, np.ndarray]:
    """A (6, 3) and L (6) [m] for a triangular arm 3: links 3b and 3c meet in one joint on the cart, midway.

    With their two plate joints they form a triangle, so that the plate turns with the arm, as that of the Queensland
    Gantry-Tau (Dressler 2012, section 2.2): its orientation changes with its position, its cart needs less room. No
    dimensions are printed: which links meet, and where, is OURS, and all lengths are those that close at the robot's
    home pose with the carts of its first links.
    """
    A, v, B, L = (np.array(getattr(robot, name), dtype=float) for name in "AvBL")
    home, R = np.array(robot.home), quaternion_matrix(np.array(robot.home_e))
    joint, along = home + R @ B[3] - A[3], v[3]
    dv, vv = joint @ along, along @ along
    q = (dv - np.sqrt(dv**2 - vv * (joint @ joint - L[3] ** 2))) / vv
    A[4:] = A[4:].mean(axis=0)
    L[4:] = np.linalg.norm(home + B[4:] @ R.T - A[4:] - q * v[4:], axis=1)
    return {"A": A, "L": L}


def queensland_gantry_tau(name: str = "d1_six_link", **modifiers: Any) -> SixLink:
    """The six-link D1 with a triangular arm 3: an EXAMPLE OF OURS for the Queensland Gantry-Tau's structure.

    modifiers: any parameter of SixLink. Raises ModelError for an unknown name.

    How far the plate turns over 0.3 m [degrees]; that of the six-link D1 turns by 0.09 degrees:

    >>> robot = gt.robots.queensland_gantry_tau()
    >>> R, status = robot.causal(known="T", targets="R")([robot.home, robot.home + [0.0, 0.0, 0.3]])
    >>> print(round(np.degrees(np.arccos((np.trace(R[0].T @ R[1]) - 1) / 2)), 2))
    6.1
    """
    robot = six_link_gantry_tau(name)
    return robot.with_(**{**triangular(robot), **modifiers})
