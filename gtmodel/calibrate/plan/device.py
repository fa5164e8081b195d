"""The device of a calibration plan: its field of view, the model with its variable, and its simulated measurements."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ...compiler.causal import compile_causal
from ...kinematics.workspace import Limit, Poses
from ...lang import Model, ModelError
from ...motion.reference import orientation
from ...results import ArgumentError
from ..devices import Camera, LaserTracker, LineOfSight, sampled, seen_by_distance, seen_by_plane
from ..measurements import Measurements
from ..problem import CalibrationProblem, prepare
from ..sensitivity import moved
from .options import Gauge, PatternCamera, Task, Tracker, Wire

Array = np.ndarray


@dataclass(frozen=True)
class Span:
    """Range of a partial device, low to high; `read` gives its value at tool centre points (n, 3) [m]."""

    read: Any
    low: float
    high: float
    name: str
    unit: str = "m"
    assumes: str = ""
    parts: Sequence[str] = ("least reading", "greatest reading")

    def margins(self, poses: Poses) -> Array:
        """(n, 2) [m]."""
        value = self.read(poses.T)
        return np.stack([value - self.low, self.high - value], axis=1)


@dataclass(frozen=True, eq=False)
class Measuring:
    """A planning task with its device. `model`: robot and the device's variable; `latent`: unmeasured variables.

    `limits`: where the device sees. `at`: its position, None for a plane. `earlier`: the problem once it is prepared.
    """

    task: Task
    model: Model
    signal: str
    latent: tuple[str, ...]
    limits: tuple[Limit, ...]
    at: Array | None
    device: Any
    earlier: list[CalibrationProblem] = field(default_factory=list)

    def readings(self, T: Array) -> dict[str, Array]:
        """Noise-free measurements at commanded poses. Raises ArgumentError if one cannot be reached."""
        q, e, status = self.placed(T)
        if np.any(status != 0):
            raise ArgumentError("a pose of the plan cannot be reached by the robot's inverse kinematics", "room")
        T = T[:, :3]
        values = {"q": q, self.signal: T if self.signal == "T" else self.device(T)}
        return values | ({} if e is None or "e" in self.latent else {"e": e})

    def placed(self, T: Array) -> tuple[Array, Array | None, Array]:
        """Actuators, quaternions of a plate that turns, and status of commanded poses (n, 3) [m].

        For an F1 (n, 7): T, then the quaternion."""
        known = {"T": T[:, :3]} | ({"e": T[:, 3:]} if T.shape[1] == 7 else {})
        targets = ["q", *(n for n in orientation(self.task.robot) if n not in known)]
        q, *e, status = compile_causal(self.task.robot, known=list(known), targets=targets)(*known.values())
        return q, e[0] if e else known.get("e"), status

    def noise(self, T: Array) -> dict[str, Any]:
        """Standard deviations and covariances of the readings."""
        task, device = self.task, self.task.device
        sizes: dict[str, Any] = {}
        if isinstance(device, (Tracker, PatternCamera)):
            sizes["T"] = self.device.covariance(T[:, :3])
        else:
            sizes[self.signal] = device.noise
        if isinstance(device, Tracker) and device.orientation_noise is not None and orientation(task.robot):
            sizes["e"] = device.orientation_noise
        if task.actuator_noise > 0:
            rotary = 3 if T.shape[1] == 7 else 0
            sizes["q"] = np.array([task.actuator_noise] * 3 + [task.axis_noise] * rotary)
        return sizes

    def measurements(self, T: Array) -> Measurements:
        """Noise-free measurements of commanded poses, with their stated noise."""
        return Measurements(self.readings(T), self.noise(T))

    def prepared(self, T: Array) -> CalibrationProblem:
        """The calibration problem at these points. Raises ArgumentError."""
        if self.earlier:  # the same equations with other poses
            return self.earlier[0].on(self.measurements(T))
        base = self.task.choice
        known = {"device_at", "plane_normal", "plane_point"} & set(type(self.model)._declared)
        choice = replace(base, fixed=[*base.fixed, *sorted(known)])
        try:
            problem = prepare(self.model, self.measurements(T), choice, latent=self.latent)
        except ModelError as error:
            raise ArgumentError(str(error), "choice") from error
        self.earlier.append(problem)
        return problem

    def whole(self, T: Array) -> CalibrationProblem:
        """The robot's closure equations at these points with the whole pose known, for positioning errors."""
        q, e, status = self.placed(T)
        good = status == 0
        values = {"q": q[good], "T": T[good, :3]} | ({} if e is None else {"e": e[good]})
        return prepare(self.task.robot, Measurements(values), self.task.choice)

    def noisy(self, m: Measurements, rng: np.random.Generator) -> Measurements:
        """Synthetic: the measurements with normal noise added."""
        values = {n: np.asarray(a) for n, a in m.values.items()}
        for name in sorted(m.noise):
            size = 3 if name == "e" else values[name].shape[1]
            C = np.broadcast_to(m.covariance(name, size), (len(m), size, size))
            noise = sampled(C, rng)
            values[name] = moved(values[name], noise)
        return Measurements(values, m.noise)


def measuring(task: Task) -> Measuring:
    """Set up the device of a task. Raises ArgumentError."""
    robot, spec, latent = task.robot, task.device, orientation(task.robot)
    try:
        if isinstance(spec, Wire | Gauge):
            signal, model, at, span = _distance(robot, spec) if isinstance(spec, Wire) else _height(robot, spec)
            return Measuring(task, model, signal, ("T", *latent), (span,), at, span.read)
        at = np.array(spec.at)
        if isinstance(spec, Tracker):
            device = LaserTracker(
                at, spec.range_noise, spec.range_noise_per_metre, spec.angle_noise, 0.0, spec.nearest,
                spec.farthest, spec.elevation,
            )  # fmt: skip
            latent = latent if spec.orientation_noise is None else []
            if spec.target_axis is not None and not np.linalg.norm(spec.target_axis) > 0:
                raise ArgumentError("is zero and has no direction", "device.target_axis")
        else:
            device = Camera(
                at, np.array(spec.looks_at), spec.focal_pixel, spec.width_pixel, spec.height_pixel, spec.pattern,
                spec.marks, spec.pixel_noise, distortion=spec.distortion,
            )  # fmt: skip
            _ = device.axes  # refuses a wrong direction
        return Measuring(task, robot, "T", tuple(latent), (device, *_sight(task, at)), at, device)
    except ModelError as error:
        raise ArgumentError(str(error), "device") from error


def _distance(robot: Model, spec: Wire) -> tuple[str, Model, Array, Span]:
    at = np.array(spec.at)
    span = Span(lambda T: np.linalg.norm(T - at, axis=1), spec.nearest, spec.farthest, "range of the distance")
    return "distance", seen_by_distance(robot, at), at, span


def _height(robot: Model, spec: Gauge) -> tuple[str, Model, None, Span]:
    model, point = seen_by_plane(robot, spec.normal, spec.point), np.array(spec.point)
    normal = np.array(spec.normal) / np.linalg.norm(spec.normal)
    return "height", model, None, Span(lambda T: (T - point) @ normal, spec.low, spec.high, "range of the height")


def _sight(task: Task, at: Array) -> list[Limit]:
    boxes = task.obstacles
    if not boxes:
        return []
    low, high = (np.array([getattr(box, end) for box in boxes]) for end in ("low", "high"))
    return [LineOfSight(at, low, high, [box.name or f"box {k + 1}" for k, box in enumerate(boxes)])]
