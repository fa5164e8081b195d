"""One error case of a robot: its values, and cross-checks of its corners with the forward kinematics of the model, with
intersections of spheres, and with random draws."""

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
    """T from q and link lengths, with a closed-form CausalFunction and variable parameters.

    Args:
        forward: causal(known="q", targets="T") of the model.
        names: parameters with the link lengths, such as "L[0]".

    Raises ModelError if a name is not a parameter of the model.
    """

    def __init__(self, forward: CausalFunction, names: Sequence[str]) -> None:
        known = forward.parameter_names
        for name in names:
            if name not in known:
                raise ModelError(f"'{name}' is not a parameter of the model; there are {', '.join(known)}")
        self._function = forward.casadi_parametric
        self._values = np.asarray(forward.flat.require_values(), dtype=float).ravel()
        self._places = [known.index(name) for name in names]

    def __call__(self, q: Array, lengths: Array) -> tuple[Array, Array]:
        """Return T (n, 3) [m] and codes (n,) for q (n, m), lengths (n, 3) [m]; OUT_OF_RANGE if links do not meet."""
        parameters = np.repeat(self._values[:, None], len(q), axis=1)
        parameters[self._places] = np.asarray(lengths, dtype=float).T
        position, status, _ = map_columns(self._function, [np.asarray(q, dtype=float).T, parameters])
        T, code = position.T, status[0].astype(int)
        T[code != Status.OK] = np.nan
        return T, code


STEPS = 8
CLOSE = 1e-12  # residual of the lengths at convergence [m]


def common_point(centres: Array, radii: Array, start: Array) -> tuple[Array, Array]:
    """Compute points (n, 3) [m] at distances radii (n, 3) from centres (n, 3, 3), with Newton from nearby start points.

    Returns the points and codes (n,) of `Status`: SINGULAR if the three directions lie in a plane, NOT_CONVERGED if the
    spheres do not meet near the start. Rows that are not OK are NaN.

    Spheres of 1 m, and one that is too small to meet the others:

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
    """Return errors (samples, 3) [m] at one pose for link-length errors with uniform distribution from -r to r.

    Args:
        a: (3, 3) base points [m]. T: (3,) nominal point [m]. lengths, r: (3,) [m].
        seed: of NumPy's default generator.

    Raises ValueError if a draw has no solution.

    Three links of 1 m at right angles:

    >>> from gtmodel.kinematics.accuracy import length_cloud
    >>> cloud = length_cloud(-np.eye(3), np.zeros(3), np.ones(3), np.full(3, 1e-4), samples=1000, seed=1)
    >>> cloud.shape, (1e3 * np.abs(cloud).max(axis=0)).round(2)  # mm
    ((1000, 3), array([0.1, 0.1, 0.1]))
    """
    drawn = np.random.default_rng(seed).uniform(-1.0, 1.0, (samples, 3)) * r
    return _cloud(np.broadcast_to(a, (samples, 3, 3)), T, lengths + drawn)


def base_point_cloud(a: Array, T: Array, lengths: Array, ellipsoids: Ellipsoids, samples: int, seed: int) -> Array:
    """Return errors (samples, 3) [m] at one pose for base points drawn from the surfaces of their ellipsoids.

    Uniformly distributed directions are scaled with the half-axes; see `length_cloud` for the arguments.

    Three links of 1 m at right angles, base points 0.1 mm off:

    >>> from gtmodel.kinematics.accuracy import Ellipsoids, base_point_cloud
    >>> within = Ellipsoids(np.tile(np.eye(3), (3, 1, 1)), np.full((3, 3), 1e-4))
    >>> cloud = base_point_cloud(-np.eye(3), np.zeros(3), np.ones(3), within, samples=1000, seed=1)
    >>> cloud.shape, (1e3 * np.abs(cloud).max(axis=0)).round(2)  # mm
    ((1000, 3), array([0.1, 0.1, 0.1]))
    """
    drawn = np.random.default_rng(seed).standard_normal((samples, 3, 3))
    drawn /= np.linalg.norm(drawn, axis=2, keepdims=True)
    moved = np.einsum("nik,ik,ikc->nic", drawn, ellipsoids.half, ellipsoids.axes)
    return _cloud(a + moved, T, np.broadcast_to(lengths, (samples, 3)))


def _cloud(centres: Array, T: Array, radii: Array) -> Array:
    points, status = common_point(centres, radii, np.broadcast_to(T, (len(radii), 3)))
    if np.any(status != 0):
        raise ValueError(
            f"{int(np.sum(status != 0))} of {len(radii)} drawn robots cannot be assembled near the nominal point; "
            "the pose is too close to a singularity for errors of this size"
        )
    return points - T


# relative difference of first-order and exact corners: errors over link lengths, about 1e-4, with some magnification
EXACT = 1e-3
# difference of closed form and Newton for one corner [m]: rounding
TWO_WAYS = 1e-9
# a draw exceeds the first-order corners at most by second-order terms
ABOVE = 1.001
NEAR = 0.1  # share of the corner's error that the largest of many draws may lack; for few draws see nearest()


@dataclass(frozen=True)
class ErrorRegion:
    """A robot, its section, and a grid over the rectangle and the reachable part of the section.

    Attributes:
        corners: (3, 2) intersections of the guideways with the section [m].
        low, high: (2,) bounds of the rectangle [m].
        u, v: coordinates of the grid [m]. T: (n, 3) its points [m]. window: (n,) whether they lie in the rectangle.
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
        """Return the base points (n, 3, 3) [m] and codes (n,) of `Status` for T (n, 3) [m]."""
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
    """Return the cases, with the default method filled in."""
    return [replace(case, method=case.method or method) for case in cases]


def errors_of(case: LinkErrors, k: int, robot: Mechanism) -> ErrorCase:
    """Return case number k for this robot. Raises ArgumentError."""
    argument = f"cases[{k}]"
    names = [name for name in ("length", "along", "across") if getattr(case, name) is not None]
    if names and not any(np.any(getattr(case, name)) for name in names):
        raise ArgumentError("all errors are zero; at least one must be positive", f"{argument}.{names[0]}")
    if names == ["length"]:
        return ErrorCase(robot.lengths, radius=np.array(case.length))
    if names != ["along", "across"]:
        raise ArgumentError("set either length, or along and across", argument)
    ellipsoids = Ellipsoids.about_guideways(robot.directions, np.array(case.along), np.array(case.across))
    return ErrorCase(robot.lengths, ellipsoids=ellipsoids, method=case.method or "support")


def describe(case: LinkErrors) -> str:
    """Return the errors in words."""
    if case.length is not None:
        return f"link lengths within {_micrometres(case.length)} um"
    return (
        f"cart joints within ellipsoids of {_micrometres(case.along)} um along and "
        f"{_micrometres(case.across)} um across the guideways, corners from {method_of(case)}"
    )


def _micrometres(lengths: list[float] | None) -> str:
    return listed(1e6 * np.array(lengths))


def method_of(case: LinkErrors) -> str:
    """Return the method for the corners in words."""
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
    """Return the values of one case, and cross-checks of its corners.

    word: prefix of the names of its checks. good: (n,) whether a point lies in the rectangle and has an error.
    """
    robot, plane, T = region.robot, region.plane, region.T
    where = np.flatnonzero(good)
    top, least = where[np.argmax(mapped.error[good])], where[np.argmin(mapped.error[good])]
    reached = mapped.error[mapped.status == Status.OK]
    centre = plane.points(((region.low + region.high) / 2)[None])
    poses = robot.inverse(np.concatenate([T[[top]], centre]))
    corners, _ = errors.corners(poses.a, poses.T)
    greatest = largest(corners)
    top_uv = plane.coordinates(T[[top]])[0]
    half = errors.half_widths(poses.directions)
    arguments = (poses.a[0], poses.T[0], robot.lengths)
    try:
        if errors.ellipsoids is None:
            cloud = length_cloud(*arguments, half[0], draws.samples, draws.seed)
        else:
            cloud = base_point_cloud(*arguments, errors.ellipsoids, draws.samples, draws.seed)
        drawn = float(np.linalg.norm(cloud, axis=1).max())
    except ValueError:  # too close to a singularity: the check fails
        drawn = np.nan
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
        "centre_um": 1e6 * float(greatest[1]),
        "reached_min_um": 1e6 * float(reached.min()),
        "reached_max_um": 1e6 * float(reached.max()),
        "monte_carlo_um": 1e6 * drawn,
        "corner_um": 1e6 * float(greatest[0]),
        "shape": {
            "link_angles_deg": np.degrees(shape.link_angles[0]).tolist(),
            "pyramid_angles_deg": np.degrees(shape.pyramid_angles[0]).tolist(),
            "faces_um2": (1e12 * shape.faces[0]).tolist(),
            "longest_diagonal_um": 1e6 * float(shape.longest[0]),
        },
    }
    checks = _checks(region, errors, mapped, good, drawn / float(greatest[0]), draws.samples)
    named = {f"{word}_{name}": check for name, check in checks.items()}
    return JudgedCase(errors, mapped, values, named)


def _checks(
    region: ErrorRegion, errors: ErrorCase, mapped: ErrorMap, good: Array, drawn: float, samples: int
) -> dict[str, Check]:
    robot = region.robot
    forward = ForwardWithLengths(compile_causal(robot.model, known="q", targets="T"), robot.length_names)
    poses = robot.inverse(region.T[good])
    half = errors.half_widths(poses.directions)
    exact, status = exact_corners(forward, poses.q, poses.a, robot.lengths, half)
    newton, met = common_point(
        np.repeat(poses.a, 8, axis=0),
        (robot.lengths + half[:, None] * SIGNS).reshape(-1, 3),
        np.repeat(poses.T, 8, axis=0),
    )
    checks = {}
    solved = not status.any() and not met.any()
    apart = float(np.max(np.abs(exact - newton.reshape(exact.shape)))) if solved else np.inf
    checks["closed_form_against_newton_m"] = at_most(apart, TWO_WAYS)
    if errors.ellipsoids is None or errors.method == "support":
        greatest = largest(exact - poses.T[:, None])
        difference = float(np.max(np.abs(mapped.error[good] / greatest - 1.0))) if solved else np.inf
        checks["first_order_against_exact"] = at_most(
            difference,
            EXACT,
            "the errors are too large for a first-order analysis, or the rectangle is too close to a singular pose",
        )
        least = 1 - max(NEAR, nearest(samples))
        within = at_most(drawn, ABOVE)
        checks["monte_carlo_to_corner"] = at_least(drawn, least, "raise samples") if drawn < least else within
    return checks


def nearest(samples: int) -> float:
    """Return the share of the corner's error that the largest draw lacks at most, except for false alarms.

    The error of each arm is uniform from -r to r. If the three arms contribute equally, a draw is within the share d of
    one of the two opposite corners with the probability 2 (3 d)^3 / 48.
    """
    return float(np.cbrt(24 * -np.log(FALSE_ALARM) / samples) / 3)
