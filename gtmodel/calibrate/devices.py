"""Measuring devices: where they see a target and how well, and robots with a variable for the measured quantity."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from ..geometry.distances import segment_to_box
from ..geometry.pinhole import pixel_jacobian, project
from ..geometry.quaternions import quaternion_matrix
from ..kinematics.workspace import Limit, Poses
from ..lang import Model, dot, parameter, part, variable
from ..lang.source import ModelError

Array = np.ndarray


class Device(Limit, Protocol):
    """A limit that says where the device sees, with the covariance of its measurements."""

    def covariance(self, T: Array) -> Array:
        """Return the covariance (n, 3, 3) [m2] of the measured position at T (n, 3) [m], in the robot's frame."""
        ...


@dataclass(frozen=True)
class LaserTracker:
    """A laser tracker: distance and two angles of a reflector.

    `at` (3,): its centre [m]. Standard deviations: `range_noise` [m] plus `range_per_m` of the distance, `angle_noise`
    [rad] of each angle, `fixed_noise` [m] of the reflector in all directions. It sees from `nearest` to `farthest` [m]
    and up to `elevation` [rad] above and below the plane normal to its `axis`.

    >>> tracker = gt.calibrate.LaserTracker(at=np.zeros(3))
    >>> C = tracker.covariance(np.array([[10.0, 0.0, 0.0]]))[0]
    >>> 1e6 * np.sqrt(np.diag(C))  # um at 10 m: along the ray, and across it
    array([10., 70., 70.])
    """

    at: Array
    range_noise: float = 10e-6
    range_per_m: float = 0.0
    angle_noise: float = 7e-6
    fixed_noise: float = 0.0
    nearest: float = 0.5
    farthest: float = 30.0
    elevation: float = np.radians(60.0)
    axis: Array = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    name: str = "range of the laser tracker"
    unit: str = "m"
    assumes: str = ""

    @property
    def parts(self) -> Sequence[str]:
        """Names of the margins, in their order."""
        return ["nearest distance", "farthest distance", "elevation"]

    def margins(self, poses: Poses) -> Array:
        """Return the margins (n, 3) [m]; that of the elevation is the distance from the surface of the cone."""
        ray = poses.T - np.asarray(self.at, float)
        r = np.linalg.norm(ray, axis=1)
        up = np.asarray(self.axis, float) / np.linalg.norm(self.axis)
        angle = np.arctan2(np.abs(ray @ up), np.linalg.norm(np.cross(ray, up), axis=1))
        return np.stack([r - self.nearest, self.farthest - r, r * np.sin(self.elevation - angle)], axis=1)

    def covariance(self, T: Array) -> Array:
        """Return the covariance (n, 3, 3) [m2] of the measured position at T (n, 3) [m], in the robot's frame."""
        ray = np.asarray(T, float) - np.asarray(self.at, float)
        r = np.linalg.norm(ray, axis=1)
        u = ray / r[:, None]
        along = np.einsum("ni,nj->nij", u, u)
        distance = self.range_noise**2 + (self.range_per_m * r) ** 2
        across = (self.angle_noise * r) ** 2
        return (
            distance[:, None, None] * along
            + across[:, None, None] * (np.eye(3) - along)
            + (self.fixed_noise**2 * np.eye(3))
        )


@dataclass(frozen=True)
class Camera:
    """A fixed camera that sees a flat pattern of points on the plate (Dressler 2012, section 5.6).

    `at` (3,) [m]: position; `looks_at` (3,) [m]: point it is aimed at; `up` (3,): up direction of the image. `focal`,
    `width`, `height` [pixel]. The pattern is a square of `side` [m] with `points` by `points` marks, centred at the
    tool centre point, and it faces the camera. `pixel_noise`: standard deviation of a mark's coordinates [pixel].
    `distortion` (5,): k1, k2, p1, p2, k3 of the lens, as in `gtmodel.vision`. The covariance is that of the position if
    position and orientation of the pattern are estimated together. The camera must see the whole pattern.
    """

    at: Array
    looks_at: Array
    focal: float = 1500.0
    width: float = 1600.0
    height: float = 1200.0
    side: float = 0.2
    points: int = 7
    pixel_noise: float = 0.1
    up: Array = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    name: str = "picture of the camera"
    unit: str = "pixel"
    assumes: str = "at every pose the pattern faces the camera as it does in the centre of the image"
    distortion: Sequence[float] = (0.0, 0.0, 0.0, 0.0, 0.0)

    @property
    def lens(self) -> Array:
        """(9,) fx, fy, cx, cy, k1, k2, p1, p2, k3, with pixels counted from the centre of the image."""
        return np.array([self.focal, self.focal, 0.0, 0.0, *self.distortion], float)

    @property
    def parts(self) -> Sequence[str]:
        """Names of the margins, in their order."""
        return ["in front of the camera", "across the picture", "up the picture"]

    @property
    def axes(self) -> Array:
        """(3, 3) rows: right and down in the image, and forward."""
        forward = np.asarray(self.looks_at, float) - np.asarray(self.at, float)
        right = np.cross(forward, np.asarray(self.up, float))
        if not np.linalg.norm(right) > 1e-9 * np.linalg.norm(forward):
            raise ModelError("the camera looks along its own 'up'; choose another 'up'")
        rows = np.stack([right, np.cross(forward, right), forward])
        return rows / np.linalg.norm(rows, axis=1, keepdims=True)

    def margins(self, poses: Poses) -> Array:
        """Return (n, 2) [pixel]: in front of the camera, and inside the image; negative if the pattern is not seen."""
        p = self._marks(poses.T)
        pixels, status = project(p.reshape(-1, 3), self.lens)
        limits = np.array([self.width, self.height]) / 2
        # marks behind the camera or beyond the field of the lens are outside
        off = np.where(status[:, None] == 0, np.abs(pixels), 2 * limits).reshape(*p.shape[:2], 2)
        inside = np.min(limits - off, axis=1)
        front = self.focal * np.min(p[..., 2], axis=1)
        return np.column_stack([front, inside])

    def covariance(self, T: Array) -> Array:
        """Return the covariance (n, 3, 3) [m2] of the measured position at T (n, 3) [m], in the robot's frame."""
        p = self._marks(T)
        centre = p.mean(axis=1, keepdims=True)
        by_point = pixel_jacobian(p.reshape(-1, 3), self.lens).reshape(*p.shape[:2], 2, 3)
        # a turn w moves a mark by w x (p - centre)
        d = p - centre
        skew = np.zeros((*d.shape, 3))
        skew[..., 0, 1], skew[..., 0, 2], skew[..., 1, 2] = d[..., 2], -d[..., 1], d[..., 0]
        skew = skew - skew.swapaxes(-1, -2)
        J = np.concatenate([by_point, by_point @ skew], axis=3).reshape(len(p), -1, 6)
        C = self.pixel_noise**2 * np.linalg.inv(J.transpose(0, 2, 1) @ J)[:, :3, :3]
        return self.axes.T @ C @ self.axes

    def _marks(self, T: Array) -> Array:
        """Marks (n, marks, 3) [m] in the camera's axes."""
        line = self.side * np.linspace(-0.5, 0.5, self.points)
        flat = np.stack(np.meshgrid(line, line, indexing="ij"), axis=-1).reshape(-1, 2)
        pattern = np.column_stack([flat, np.zeros(len(flat))])
        middle = (np.asarray(T, float) - np.asarray(self.at, float)) @ self.axes.T
        return middle[:, None] + pattern


@dataclass(frozen=True)
class LineOfSight:
    """A limit: no obstacle between a device at `at` (3,) [m] and the tool centre point.

    Boxes with sides along the axes, corners `low`, `high` (k, 3) [m], keep a distance of `clearance` [m] from the line.
    """

    at: Array
    low: Array
    high: Array
    names: Sequence[str] = ()
    clearance: float = 1e-6
    name: str = "line of sight"
    unit: str = "m"
    assumes: str = ""

    @property
    def parts(self) -> Sequence[str]:
        """Names of the margins, in their order."""
        return [f"behind {name}" for name in self.names or [f"box {k + 1}" for k in range(len(self.low))]]

    def margins(self, poses: Poses) -> Array:
        """Return (n, boxes) [m]: distance of the line from each box less the clearance; negative behind a box."""
        start = np.broadcast_to(np.asarray(self.at, float), poses.T.shape)
        low, high = np.asarray(self.low, float), np.asarray(self.high, float)
        boxes = zip((low + high) / 2, (high - low) / 2, strict=True)
        gaps = [segment_to_box(start - center, poses.T - center, half)[0] for center, half in boxes]
        return np.stack(gaps, axis=1) - self.clearance


def sampled(covariance: Array, rng: np.random.Generator) -> Array:
    """Sample normal noise (n, k) with covariances (n, k, k), for synthetic measurements."""
    values, vectors = np.linalg.eigh(covariance)
    white = rng.standard_normal(values.shape) * np.sqrt(np.maximum(values, 0.0))
    return np.einsum("nij,nj->ni", vectors, white)


class SeenByDistance(Model):
    """Adds `distance` [m] of T from `device_at` (3,) [m], as a wire sensor or an interferometer measures it."""

    device_at = parameter(shape=3, unit="m")
    distance = variable(unit="m", start=1.0)

    def equations(self) -> Iterator[Any]:
        yield from super().equations()
        d = self.T - self.device_at  # type: ignore[attr-defined]  # of the robot
        yield dot(d, d) == self.distance**2


class SeenByPlane(Model):
    """Adds `height` [m] of T above the plane through `plane_point` (3,) [m] with unit normal `plane_normal` (3,).

    For a dial gauge, a touched plate (height 0), or one coordinate."""

    plane_normal = parameter(shape=3)
    plane_point = parameter(shape=3, unit="m")
    height = variable(unit="m")

    def equations(self) -> Iterator[Any]:
        yield from super().equations()
        yield self.height == dot(self.plane_normal, self.T - self.plane_point)  # type: ignore[attr-defined]


class QuaternionOfMatrix(Model):
    """The unit quaternion e (4,), scalar first, of a rotation R.

    Its residual is the sine of the angle between them, along the axis: in m, the shift of a point at 1 m."""

    R = variable((3, 3), unit="1")
    e = variable(4, unit="1", start=[1.0, 0.0, 0.0, 0.0], prefer=-5)

    def equations(self) -> Iterator[Any]:
        yield dot(self.e, self.e) == 1.0
        R, Q = self.R, quaternion_matrix(self.e)
        for i, j in ((2, 1), (0, 2), (1, 0)):  # R'Q is symmetric if R and Q are equal
            yield 0.5 * sum(R[k, i] * Q[k, j] - R[k, j] * Q[k, i] for k in range(3)) == 0.0


class SeenWithQuaternion(Model):
    """Adds the unit quaternion `e` (4,), scalar first, of R."""

    e = variable(4, unit="1", start=[1.0, 0.0, 0.0, 0.0], prefer=-5)
    orientation_at_1_m = part(QuaternionOfMatrix)  # the name labels its errors

    def equations(self) -> Iterator[Any]:
        yield from super().equations()
        yield self.orientation_at_1_m.R == self.R  # type: ignore[attr-defined]  # of the robot
        yield self.orientation_at_1_m.e == self.e


def seen_with_quaternion(robot: Model) -> Model:
    """Return the robot with the variable `e` (4,), the unit quaternion of its rotation R, scalar first.

    For measured full poses. Raises ModelError if the robot has no rotation R, or has an `e` already.

    >>> arm = gt.robots.serial_arm(a=[0.1, 0.5, 0.0], alpha=[np.pi / 2, 0.0, np.pi / 2], d=[0.4, 0.0, 0.0])
    >>> gt.calibrate.closure_equations(gt.calibrate.seen_with_quaternion(arm), known=["q", "T", "e"]).residuals.shape
    (6, 1)
    """
    declared = type(robot)._declared
    if "R" not in declared or "e" in declared:
        reason = "has an 'e' already" if "e" in declared else "declares no rotation 'R'"
        raise ModelError(f"{type(robot).__name__} {reason}")
    return _extended(SeenWithQuaternion, robot)


def seen_by_distance(robot: Model, at: ArrayLike) -> Model:
    """Return the robot with the variable `distance` [m] of T from a device at (3,) [m].

    Raises ModelError if the robot has no position T.

    >>> robot = gt.calibrate.seen_by_distance(gt.robots.gantry_tau("l1_tape"), at=[0.0, 0.0, 3.0])
    >>> distance, status = robot.causal(known="T", targets="distance")(np.array([0.5, -0.6, 0.5]))
    >>> round(float(distance), 4)
    2.6192
    """
    return _extended(SeenByDistance, robot, device_at=np.asarray(at, float))


def seen_by_plane(robot: Model, normal: ArrayLike, point: ArrayLike = (0.0, 0.0, 0.0)) -> Model:
    """Return the robot with the variable `height` [m] of T over a plane, positive along the normal.

    normal (3,): of any length. point (3,) [m]: a point of the plane. Raises ModelError for a zero normal, or if the
    robot has no position T.

    >>> robot = gt.calibrate.seen_by_plane(gt.robots.gantry_tau("l1_tape"), normal=[0, 0, 1], point=[0, 0, 0.1])
    >>> height, status = robot.causal(known="T", targets="height")(np.array([0.5, -0.6, 0.5]))
    >>> round(float(height), 4)
    0.4
    """
    n = np.asarray(normal, float)
    length = float(np.linalg.norm(n))
    if not length > 0:
        raise ModelError("the normal of the plane is zero; give a direction")
    return _extended(SeenByPlane, robot, plane_normal=n / length, plane_point=np.asarray(point, float))


def _extended(device: type[Model], robot: Model, **parameters: np.ndarray) -> Model:
    if "T" not in type(robot)._declared:
        raise ModelError(f"{type(robot).__name__} declares no position 'T' for the device to measure")
    cls = type(f"{type(robot).__name__}{device.__name__}", (device, type(robot)), {})
    return cls(**robot._modifiers, **parameters)
