"""Velocity and acceleration maps between two sets of coordinates of a model, and distances of a pose from singular
ones, as lengths [m] and angles [rad]."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from gtmodel.compiler.causal import CausalFunction, compile_causal
from gtmodel.lang import Model, ModelError

from ..geometry.rotations import cross_matrix

Array = np.ndarray


class MotionMaps:
    """Velocity and acceleration maps of a position causality: y' = J x' and y'' = J x'' + b.

    y is `target` as a function of x, `known`; J is its Jacobian, and b(x, x') is quadratic in x'.

    Forward maps of a robot are MotionMaps(robot, "q", "T"), inverse ones MotionMaps(robot, "T", "q") (Dressler 2012,
    eqs. (6.5), (6.6)). J comes from implicit differentiation, b from the twice differentiated equations.

    branches: as for `causal`. Raises ModelError if x alone does not determine y.

    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> J, status = gt.kinematics.MotionMaps(robot, "T", "q").velocity([0.0, -0.9, 0.1])  # carts per tool centre point
    >>> J.round(2)
    array([[ 1.  , -0.71, -1.06],
           [ 1.  ,  0.36, -1.2 ],
           [ 1.  , -0.57,  0.06]])
    """

    def __init__(self, model: Model, known: str, target: str, branches: Mapping[str, int] | None = None) -> None:
        self.position: CausalFunction = compile_causal(model, known, target, branches=branches)
        names = [s.name for s in self.position.inputs]
        if names != [known]:
            raise ModelError(f"'{target}' does not follow from '{known}' alone; it needs {', '.join(names)}")
        self._known = known
        self._second = compile_causal(model, known, f"der({target},2)", branches=branches)

    def velocity(self, x: Any) -> tuple[Array, Any]:
        """Return J (m, n) or (rows, m, n), and the status."""
        return self.position.jacobian(x)

    def acceleration(self, x: Any, rate: Any) -> tuple[Array, Array, Any]:
        """Return J, b (m,) or (rows, m), and the status; `rate` is x'."""
        values = {self._known: x, f"der({self._known})": rate, f"der({self._known},2)": np.zeros_like(np.asarray(rate))}
        bias, status = self._second(*[values[s.name] for s in self._second.inputs])
        J, _ = self.velocity(x)
        return J, bias, status


COLLINEAR = 1e-10  # relative tolerance for joints on one line
TINY = 1e-300


class InverseMeasure(NamedTuple):
    """Per link: component along its guideway [m] and angle to the plane across it [rad]; 0 is singular.

    Both are positive if the platform joint is ahead of the cart.
    """

    along_m: Array
    angle_rad: Array


class ForwardMeasure(NamedTuple):
    """For three links to one point: smallest distance of a link's tip from the plane of the other two [m], and smallest
    angle between a link and that plane [rad]. 0 is singular: the links lie in one plane and cannot hold the point
    perpendicular to it."""

    height_m: Array
    angle_rad: Array


def inverse(d: Any, v: Any) -> InverseMeasure:
    """Return the distance of each link from the inverse singularity d . v = 0, orthogonal to its guideway.

    d: link vectors (n, 3) [m] or (rows, n, 3). v: guideway directions of any length, (n, 3) or as d.

    A link of 2 m inclined by 30 degrees, and one orthogonal to its guideway:

    >>> d = [[1.0, 3**0.5, 0.0], [0.0, 2.0, 0.0]]
    >>> measure = gt.kinematics.singularity.inverse(d, [1.0, 0.0, 0.0])
    >>> measure.along_m, np.degrees(measure.angle_rad).round(3)
    (array([1., 0.]), array([30.,  0.]))
    """
    d, v = np.broadcast_arrays(np.asarray(d, dtype=float), np.asarray(v, dtype=float))
    along = np.sum(d * v, axis=-1) / _sizes(v, "guideway direction")
    return InverseMeasure(along, np.arcsin(np.clip(along / _sizes(d, "link vector"), -1.0, 1.0)))


def forward(d: Any) -> ForwardMeasure:
    """Return the distance of three links d (3, 3) [m] or (rows, 3, 3) from the forward singularity, where they lie in
    one plane. Raises ValueError for another number of links.

    Three links that almost lie in a plane, the third 10 mm out of it:

    >>> measure = gt.kinematics.singularity.forward([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.6, -0.8, 0.01]])
    >>> round(1e3 * float(measure.height_m), 2), round(float(np.degrees(measure.angle_rad)), 2)  # mm, deg
    (10.0, 0.57)
    """
    d = np.asarray(d, dtype=float)
    if d.shape[-2:] != (3, 3):
        raise ValueError(f"forward() takes three links, (3, 3) or (rows, 3, 3); found {d.shape}; see platform()")
    normals = np.stack([np.cross(d[..., (i + 1) % 3, :], d[..., (i + 2) % 3, :]) for i in range(3)], axis=-2)
    sizes = np.linalg.norm(normals, axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        heights = np.where(sizes > 0, np.abs(np.sum(d * normals, axis=-1)) / sizes, 0.0)
    heights = np.where(np.isfinite(d).all(axis=-1), heights, np.nan)
    angles = np.arcsin(np.clip(heights / _sizes(d, "link vector"), 0.0, 1.0))
    return ForwardMeasure(np.min(heights, axis=-1), np.min(angles, axis=-1))


def platform(d: Any, arms: Any) -> Array:
    """Return the smallest angle [rad] of the links of a platform to motions that keep their lengths; 0 is singular.

    Among all small motions of the platform that displace its joints by 1 (RMS), take the one that changes the link
    lengths least; the angle is the arc sine of this change (RMS). It does not depend on frame or units. d (n, 3): link
    vectors; arms (n, 3): vectors from any point of the platform to its joints; world coordinates [m], n >= 6. Both may
    have a leading dimension of rows.

    With six upright links the platform can move sideways; with crossed links it cannot:

    >>> angle = np.radians([0, 60, 120, 180, 240, 300])
    >>> arms = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    >>> upright, crossed = np.tile([0.0, 0.0, 1.0], (6, 1)), arms[[1, 0, 3, 2, 5, 4]] - arms + [0.0, 0.0, 1.0]
    >>> [round(float(np.degrees(gt.kinematics.singularity.platform(d, arms))), 2) for d in (upright, crossed)]
    [0.0, 23.46]
    """
    d, arms = np.asarray(d, dtype=float), np.asarray(arms, dtype=float)
    n = d.shape[-2]
    u = d / _sizes(d, "link vector")[..., None]
    arms = arms - arms.mean(axis=-2, keepdims=True)
    rows = np.concatenate([u, np.cross(arms, u)], axis=-1)  # length rates per twist
    moves = np.concatenate([np.broadcast_to(np.eye(3), (*arms.shape, 3)), -cross_matrix(arms)], axis=-1)
    moves = moves.reshape(*arms.shape[:-2], 3 * n, 6)  # joint velocities per twist
    finite = np.asarray(np.isfinite(rows).all(axis=(-2, -1)))
    result = np.full(finite.shape, np.nan)
    for k in np.ndindex(finite.shape):
        if finite[k]:
            # singular values of the length rates relative to the joint velocities; rotations scaled by platform size
            scale = np.repeat([1.0, 1.0 / max(float(np.linalg.norm(arms[k])), TINY)], 3)
            _, sizes, V = np.linalg.svd(moves[k] * scale, full_matrices=False)
            if sizes[-1] <= COLLINEAR * sizes[0]:
                result[k] = 0.0  # joints on a line: a rotation about it moves none of them
                continue
            s = np.linalg.svd((rows[k] * scale) @ (V.T / sizes), compute_uv=False)
            result[k] = np.arcsin(min(1.0, s[-1]))
    return result


def amplification(f: CausalFunction, *arguments: Any) -> tuple[Array, Array, Any]:
    """Return the largest and smallest singular value of d targets / d inputs, and the status.

    They are the extreme ratios of output motion to input motion, in metres per metre for positions on both sides. The
    largest grows without bound near a singularity of `f`, the smallest vanishes near a singularity of its inverse. NaN
    if the status is not ok.

    From carts to the tool centre point of the L1, in metres per metre:

    >>> forward = gt.robots.gantry_tau("l1_tape").causal(known="q", targets="T")
    >>> largest, smallest, status = gt.kinematics.singularity.amplification(forward, [-0.7, -0.8, -0.6])
    >>> print(largest.round(2), smallest.round(2), status.name)
    2.24 0.53 OK
    """
    J, status = f.jacobian(*arguments)
    s = np.full((*J.shape[:-2], min(J.shape[-2:])), np.nan)
    finite = np.asarray(np.isfinite(J).all(axis=(-2, -1)))
    s[finite] = np.linalg.svd(J[finite], compute_uv=False)
    return s[..., 0], s[..., -1], status


def _sizes(x: Array, name: str) -> Array:
    """Return the lengths of vectors (..., 3). Raises ModelError for a vector of length zero."""
    sizes = np.linalg.norm(x, axis=-1)
    if np.any(sizes == 0.0):
        *row, number = np.argwhere(sizes == 0.0)[0]
        where = f" in row {row[0]} (counted from 0)" if row else ""
        raise ModelError(f"{name} {number + 1}{where} has length zero and no direction; its two ends must differ")
    return sizes
