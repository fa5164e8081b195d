"""The eight corners of the positioning error of three links (Dressler 2012, sections A.2 and A.3).

Link i may be longer or shorter by r_i: an error of its length, or of its base point along the link. The tool centre
point then lies in a body with eight corners, one for each choice of signs; the greatest error is at one of them.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

import numpy as np

from ...results import Status

Array = np.ndarray

# (8, 3) signs of the three links, corner by corner
SIGNS = np.array(list(product((-1.0, 1.0), repeat=3)))
# |det| of three unit vectors: closer to a plane than this, errors are magnified a million times
SINGULAR = 1e-6
# a corner must have the lengths that it was computed for [m]
LENGTH_TOLERANCE = 1e-9


def first_order_corners(u: Array, r: Array) -> tuple[Array, Array]:
    """Errors dT_j = U^-1 (s_j * r), j = 1..8.

    Args:
        u: (n, 3, 3) unit vectors of the links, one row per link: the matrix U. r: (n, 3) or (3,) half-widths [m].

    Returns: errors (n, 8, 3) [m] and codes (n,) of `Status`: SINGULAR where the links lie in a plane, NOT_FINITE for
    rows with NaN; such rows are NaN and harm no other.

    Three links, two at a right angle and one that leans; each may be 0.1 mm too long or too short:

    >>> u = np.array([[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.6, 0.8]]])  # links along the rows
    >>> errors, status = gt.kinematics.accuracy.first_order_corners(u, np.full(3, 1e-4))
    >>> errors.shape, status
    ((1, 8, 3), array([0]))
    >>> (1e3 * gt.kinematics.accuracy.largest(errors)).round(3)  # mm
    array([0.245])
    """
    u = np.asarray(u, dtype=float)
    r = np.broadcast_to(np.asarray(r, dtype=float), (len(u), 3))
    finite = np.asarray(np.isfinite(u).all(axis=(1, 2)) & np.isfinite(r).all(axis=1))
    status = np.where(finite, Status.OK, Status.NOT_FINITE)
    determinant = np.linalg.det(np.where(finite[:, None, None], u, np.eye(3)))
    status = np.where(finite & (np.abs(determinant) < SINGULAR), Status.SINGULAR, status)
    errors = np.full((len(u), 8, 3), np.nan)
    good = status == Status.OK
    errors[good] = np.einsum("nci,ni,ji->njc", np.linalg.inv(u[good]), r[good], SIGNS)
    return errors, status


def exact_corners(
    forward: Callable[[Array, Array], tuple[Array, Array]], q: Array, a: Array, lengths: Array, r: Array
) -> tuple[Array, Array]:
    """Corner positions by the robot's own forward kinematics with link lengths L + s_j * r (section A.3).

    Args:
        forward: called with q (k, m) and lengths (k, 3); returns T (k, 3) and codes (k,) of `Status`.
        q: (n, m) actuator coordinates. a: (n, 3, 3) base points [m]. lengths: (3,) [m]. r: (n, 3) or (3,) [m].

    Returns: corners (n, 8, 3) [m] and codes (n,). Each corner is checked against the lengths it was made for.

    Links of the L1 that may be 0.1 mm too long or too short, at the home pose:

    >>> from gtmodel.kinematics.accuracy import ForwardWithLengths, exact_corners, largest
    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> forward = ForwardWithLengths(robot.causal(known="q", targets="T"), [f"L[{i}]" for i in range(3)])
    >>> q, status = robot.causal(known="T", targets="q")(robot.home)
    >>> a = robot.A + q[:, None] * robot.v
    >>> corners, status = exact_corners(forward, q[None], a[None], robot.L, np.full(3, 1e-4))
    >>> (1e3 * largest(corners - robot.home)).round(3), status  # mm
    (array([0.418]), array([0]))
    """
    n = len(q)
    r = np.broadcast_to(np.asarray(r, dtype=float), (n, 3))
    changed = (np.asarray(lengths, dtype=float) + r[:, None] * SIGNS).reshape(8 * n, 3)
    T, code = forward(np.repeat(q, 8, axis=0), changed)
    distances = np.linalg.norm(T[:, None] - np.repeat(a, 8, axis=0), axis=2)
    with np.errstate(invalid="ignore"):
        wrong = (code == Status.OK) & ~(np.abs(distances - changed) < LENGTH_TOLERANCE).all(axis=1)
    code = np.where(wrong, Status.NOT_CONVERGED, code).reshape(n, 8)
    status = code.max(axis=1)
    corners = T.reshape(n, 8, 3).copy()
    corners[status != Status.OK] = np.nan
    return corners, status


def largest(errors: Array) -> Array:
    """Greatest error [m] (n,) of corners (n, 8, 3) given from the nominal point.

    >>> corners = np.zeros((1, 8, 3))
    >>> corners[0, 5] = [3e-5, 0.0, 4e-5]
    >>> gt.kinematics.accuracy.largest(corners)
    array([5.e-05])
    """
    return np.linalg.norm(errors, axis=2).max(axis=1)
