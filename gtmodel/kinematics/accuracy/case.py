"""One error case on a robot: its results, and cross-checks of its corners with the model's forward kinematics, with
intersecting spheres and with Monte Carlo samples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...compiler.causal import CausalFunction, compile_causal
from ...compiler.rows import map_columns
from ...inference import FALSE_ALARM
from ...lang.source import ModelError
from ...results import ArgumentError, Check, Status, at_least, at_most, listed
from ..mechanism import Mechanism
from ..section import SectionPlane
from .corners import (
    SIGNS,
    SINGULAR,
    Array,
    Ellipsoids,
    ErrorCase,
    ErrorMap,
    Method,
    exact_corners,
    largest,
    parallelepiped,
)
from .options import LinkErrors, MonteCarloDraws


class ForwardWithLengths:
    """Forward kinematics with variable link lengths, from a closed-form CausalFunction with free parameters.

    Args:
        forward: causal(known="q", targets="T") of the model.
        names: parameters that hold the link lengths, such as "L[0]".

    Raises ModelError if a name is not a parameter of the model.
    """

    def __init__(self, forward: CausalFunction, names: Sequence[str]) -> None:
        parameters = forward.parameter_names
        for name in names:
            if name not in parameters:
                raise ModelError(f"'{name}' is not a parameter of the model; its parameters: {', '.join(parameters)}")
        self._function = forward.casadi_parametric
        self._values = np.asarray(forward.flat.require_values(), dtype=float).ravel()
        self._indices = [parameters.index(name) for name in names]

    def __call__(self, q: Array, lengths: Array) -> tuple[Array, Array]:
        """Return T (n, 3) [m] for q (n, m) and lengths (n, 3) [m], and codes (n,): OUT_OF_RANGE if the links cannot
        meet."""
        parameters = np.repeat(self._values[:, None], len(q), axis=1)
        parameters[self._indices] = np.asarray(lengths, dtype=float).T
        position, status, _ = map_columns(self._function, [np.asarray(q, dtype=float).T, parameters])
        T, code = position.T, status[0].astype(int)
        T[code != Status.OK] = np.nan
        return T, code


STEPS = 8
CLOSE = 1e-12  # tolerance of the lengths [m]: rounding, for points a few metres from the origin


def common_point(centres: Array, radii: Array, start: Array) -> tuple[Array, Array]:
    """Intersect three spheres with radii (n, 3) and centres (n, 3, 3) [m] by Newton's method from start (n, 3).

    Returns points (n, 3) [m] and codes (n,) of `Status`: SINGULAR if the three directions are coplanar, NOT_CONVERGED
    if the spheres do not intersect near the start. Rows that are not OK are NaN.

    Three spheres of 1 m; in the second row one sphere is too small to reach the others:

    >>> centres = np.tile(-np.eye(3), (2, 1, 1))
    >>> radii = np.array([[1.0, 1.0, 1.0], [1.0, 1.0, 0.1]])
    >>> points, status = gt.kinematics.accuracy.common_point(centres, radii, np.zeros((2, 3)))
    >>> points.round(6) + 0.0, [gt.Status(code).name for code in status]
    (array([[ 0.,  0.,  0.],
           [nan, nan, nan]]), ['OK', 'NOT_CONVERGED'])
    """
    x = np.array(start, dtype=float)
    status = np.where(np.isfinite(x).all(axis=1) & np.isfinite(centres).all(axis=(1, 2)), Status.OK, Status.NOT_FINITE)
    for step in range(STEPS + 1):
        good = np.flatnonzero(status == Status.OK)
        d = x[good, None] - centres[good]
        distance = np.linalg.norm(d, axis=2)
        gap = radii[good] - distance
        if step == STEPS or not len(good):
            status[good[~(np.abs(gap) < CLOSE).all(axis=1)]] = Status.NOT_CONVERGED
            break
        u = d / distance[..., None]
        singular = ~(np.abs(np.linalg.det(u)) >= SINGULAR)
        status[good[singular]] = Status.SINGULAR
        x[good[~singular]] += np.linalg.solve(u[~singular], gap[~singular][..., None])[..., 0]
    x[status != Status.OK] = np.nan
    return x, status


def length_cloud(a: Array, T: Array, lengths: Array, r: Array, samples: int, seed: int) -> Array:
    """Return positioning errors (samples, 3) [m] at one pose, for link-length errors uniform from -r to r.

    Args:
        a: (3, 3) base points [m]. T: (3,) nominal point [m]. lengths, r: (3,) [m].
        seed: of NumPy's default generator.

    Raises ValueError if a sample has no solution.

    Three links of 1 m at right angles:

    >>> from gtmodel.kinematics.accuracy import length_cloud
    >>> cloud = length_cloud(-np.eye(3), np.zeros(3), np.ones(3), np.full(3, 1e-4), samples=1000, seed=1)
    >>> cloud.shape, (1e3 * np.abs(cloud).max(axis=0)).round(2)  # mm
    ((1000, 3), array([0.1, 0.1, 0.1]))
    """
    errors = np.random.default_rng(seed).uniform(-1.0, 1.0, (samples, 3)) * r
    return _cloud(np.broadcast_to(a, (samples, 3, 3)), T, lengths + errors)


def base_point_cloud(a: Array, T: Array, lengths: Array, ellipsoids: Ellipsoids, samples: int, seed: int) -> Array:
    """Return positioning errors (samples, 3) [m] at one pose, for base points on the surfaces of their ellipsoids.

    Random directions are uniform on the sphere and scaled by the half-axes; see `length_cloud` for the arguments.

    Three links of 1 m at right angles, with base-point errors of 0.1 mm:

    >>> from gtmodel.kinematics.accuracy import Ellipsoids, base_point_cloud
    >>> within = Ellipsoids(np.tile(np.eye(3), (3, 1, 1)), np.full((3, 3), 1e-4))
    >>> cloud = base_point_cloud(-np.eye(3), np.zeros(3), np.ones(3), within, samples=1000, seed=1)
    >>> cloud.shape, (1e3 * np.abs(cloud).max(axis=0)).round(2)  # mm
    ((1000, 3), array([0.1, 0.1, 0.1]))
    """
    directions = np.random.default_rng(seed).standard_normal((samples, 3, 3))
    directions /= np.linalg.norm(directions, axis=2, keepdims=True)
    offsets = np.einsum("nik,ik,ikc->nic", directions, ellipsoids.half, ellipsoids.axes)
    return _cloud(a + offsets, T, np.broadcast_to(lengths, (samples, 3)))


def _cloud(centres: Array, T: Array, radii: Array) -> Array:
    points, status = common_point(centres, radii, np.broadcast_to(T, (len(radii), 3)))
    if np.any(status != 0):
        raise ValueError(
            f"{int(np.sum(status != 0))} of {len(radii)} sampled robots cannot be assembled near the nominal point; "
            "the pose is too close to a singularity for errors of this size"
        )
    return points - T


# relative difference of first-order and exact corners: errors over link lengths, about 1e-4, amplified a few times
EXACT = 1e-3
# difference of closed form and Newton at the same corner [m]: rounding
TWO_WAYS = 1e-9
# a sample exceeds the first-order corners only by second-order terms
ABOVE = 1.001
NEAR = 0.1  # relative distance of the largest sample from the corner; for few samples see nearest()


@dataclass(frozen=True)
class ErrorRegion:
    """A robot, its section, and a grid that covers the rectangle and the reachable area.

    Attributes:
        corners: (3, 2) points where the guideways pierce the section [m].
        low, high: (2,) limits of the evaluated rectangle [m].
        u, v: coordinates of the grid [m]. T: (n, 3) its points [m]. window: (n,) whether a point is in the rectangle.
    """

    robot: Mechanism
    plane: SectionPlane
    corners: Array
    low: Array
    high: Array
    u: Array
    v: Array
    T: Array
    window: Array

    def base_points(self, T: Array) -> tuple[Array, Array]:
        """Return base points (n, 3, 3) [m] and codes (n,) of `Status` for T (n, 3) [m]."""
        poses = self.robot.inverse(T)
        return poses.a, poses.status


@dataclass(frozen=True)
class JudgedCase:
    """One case with its results."""

    errors: ErrorCase
    map: ErrorMap
    values: Mapping[str, Any]
    checks: Mapping[str, Check]


def with_method(cases: list[LinkErrors], method: Method) -> list[LinkErrors]:
    """Return the cases with `method` as their default."""
    return [replace(case, method=case.method or method) for case in cases]


def errors_of(case: LinkErrors, k: int, robot: Mechanism) -> ErrorCase:
    """Return case k for this robot. Raises ArgumentError."""
    argument = f"cases[{k}]"
    keys = [name for name in ("length", "along", "across") if getattr(case, name) is not None]
    if keys and not any(np.any(getattr(case, name)) for name in keys):
        raise ArgumentError("all errors are zero; give at least one positive error", f"{argument}.{keys[0]}")
    if keys == ["length"]:
        return ErrorCase(robot.lengths, radius=np.array(case.length))
    if keys != ["along", "across"]:
        raise ArgumentError("give either length, or both along and across", argument)
    ellipsoids = Ellipsoids.about_guideways(robot.directions, np.array(case.along), np.array(case.across))
    return ErrorCase(robot.lengths, ellipsoids=ellipsoids, method=case.method or "support")


def describe(case: LinkErrors) -> str:
    """Return a description of the errors."""
    if case.length is not None:
        return f"link lengths within {_micrometres(case.length)} um"
    return (
        f"cart joints within ellipsoids of {_micrometres(case.along)} um along and "
        f"{_micrometres(case.across)} um across the guideways, corners from {method_of(case)}"
    )


def _micrometres(lengths: list[float] | None) -> str:
    return listed(1e6 * np.array(lengths))


def method_of(case: LinkErrors) -> str:
    """Return the name of the method that computes the corners."""
    if case.length is not None:
        return "eight corners of U^-1"
    return "iterative projection" if case.method == "projection" else "the support function"


def judged(
    region: ErrorRegion,
    case: LinkErrors,
    word: str,
    errors: ErrorCase,
    mapped: ErrorMap,
    good: Array,
    draws: MonteCarloDraws,
) -> JudgedCase:
    """Return the results of one case, cross-checked with the robot's equations, Newton's method and random samples.

    word: prefix of the names of its checks. good: (n,) whether a point of the rectangle has a result; at least one.
    """
    robot, plane, T = region.robot, region.plane, region.T
    indices = np.flatnonzero(good)
    top, least = indices[np.argmax(mapped.error[good])], indices[np.argmin(mapped.error[good])]
    reached = mapped.error[mapped.status == Status.OK]
    centre = plane.points(((region.low + region.high) / 2)[None])
    poses = robot.inverse(np.concatenate([T[[top]], centre]))
    corners, _ = errors.corners(poses.a, poses.T)
    errors_um = 1e6 * largest(corners)  # at the maximum, and at the centre
    top_uv = plane.coordinates(T[[top]])[0]
    half = errors.half_widths(poses.directions)
    arguments = (poses.a[0], poses.T[0], robot.lengths)
    try:
        if errors.ellipsoids is None:
            cloud = length_cloud(*arguments, half[0], draws.samples, draws.seed)
        else:
            cloud = base_point_cloud(*arguments, errors.ellipsoids, draws.samples, draws.seed)
        sampled = 1e6 * float(np.linalg.norm(cloud, axis=1).max())
    except ValueError:  # too close to a singularity: the check fails
        sampled = np.nan
    shape = parallelepiped(poses.directions[1:], half[1:])
    values = {
        "name": case.name,
        "errors": describe(case),
        "method": method_of(case),
        "min_um": 1e6 * float(mapped.error[least]),
        "min_at_m": plane.coordinates(T[[least]])[0].tolist(),
        "max_um": 1e6 * float(mapped.error[top]),
        "max_at_m": top_uv.tolist(),
        "nearest_guideway": 1 + int(np.argmin(np.linalg.norm(region.corners - top_uv, axis=1))),
        "centre_um": float(errors_um[1]),
        "reached_min_um": 1e6 * float(reached.min()),
        "reached_max_um": 1e6 * float(reached.max()),
        "monte_carlo_um": sampled,
        "corner_um": float(errors_um[0]),
        "shape": {
            "link_angles_deg": np.degrees(shape.link_angles[0]).tolist(),
            "pyramid_angles_deg": np.degrees(shape.pyramid_angles[0]).tolist(),
            "faces_um2": (1e12 * shape.faces[0]).tolist(),
            "longest_diagonal_um": 1e6 * float(shape.longest[0]),
        },
    }
    checks = _checks(region, errors, mapped, good, sampled / float(errors_um[0]), draws.samples)
    return JudgedCase(errors, mapped, values, {f"{word}_{name}": check for name, check in checks.items()})


def _checks(
    region: ErrorRegion, errors: ErrorCase, mapped: ErrorMap, good: Array, sampled: float, samples: int
) -> dict[str, Check]:
    robot = region.robot
    forward = ForwardWithLengths(compile_causal(robot.model, known="q", targets="T"), robot.length_names)
    poses = robot.inverse(region.T[good])
    half = errors.half_widths(poses.directions)
    exact, status = exact_corners(forward, poses.q, poses.a, robot.lengths, half)
    newton, newton_status = common_point(
        np.repeat(poses.a, 8, axis=0),
        (robot.lengths + half[:, None] * SIGNS).reshape(-1, 3),
        np.repeat(poses.T, 8, axis=0),
    )
    checks = {}
    solved = not status.any() and not newton_status.any()
    difference = float(np.max(np.abs(exact - newton.reshape(exact.shape)))) if solved else np.inf
    checks["closed_form_against_newton_m"] = at_most(difference, TWO_WAYS)
    if errors.ellipsoids is None or errors.method == "support":
        greatest = largest(exact - poses.T[:, None])
        difference = float(np.max(np.abs(mapped.error[good] / greatest - 1.0))) if solved else np.inf
        checks["first_order_against_exact"] = at_most(
            difference,
            EXACT,
            "the errors are too large for a first-order analysis, or the rectangle is too close to a singularity",
        )
        least = 1 - max(NEAR, nearest(samples))
        within = at_most(sampled, ABOVE)
        checks["monte_carlo_to_corner"] = at_least(sampled, least, "increase samples") if sampled < least else within
    return checks


def nearest(samples: int) -> float:
    """Return a bound on the relative distance between the largest sample and the corner, except for a false alarm.

    The error of each link is uniform from -r to r. If the three links contribute equally, a sample is within the
    relative distance d of one of the two opposite corners with the probability 2 (3 d)^3 / 48.
    """
    return float(np.cbrt(24 * -np.log(FALSE_ALARM) / samples) / 3)
