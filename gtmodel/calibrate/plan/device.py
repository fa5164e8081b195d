"""The device of a calibration plan: what it sees, the model with its variable, and measurements it would make."""

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
    """A partial device reads values between low and high: `read` of tool centre points (n, 3) [m]."""

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
    """The robot and the device of a task. `model`: with what the device adds; `latent`: what nobody measures.

    `limits`: what the device sees. `at`: where it stands, None for a plane. `earlier`: the problem once it is made.
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
        """Noise-free measurements at commanded poses. Raises ArgumentError for what cannot be reached."""
        q, e, status = self.placed(T)
        if np.any(status != 0):
            raise ArgumentError("a pose of the plan cannot be reached by the robot's inverse kinematics", "room")
        T = T[:, :3]
        values = {"q": q, self.signal: T if self.signal == "T" else self.device(T)}
        return values | ({} if e is None or "e" in self.latent else {"e": e})

    def placed(self, T: Array) -> tuple[Array, Array | None, Array]:
        """Actuators, quaternions of a plate that turns, and status of commanded poses: rows of T [m], of an F1 with
        its quaternion behind."""
        known = {"T": T[:, :3]} | ({"e": T[:, 3:]} if T.shape[1] == 7 else {})
        targets = ["q", *(n for n in orientation(self.task.robot) if n not in known)]
        q, *e, status = compile_causal(self.task.robot, known=list(known), targets=targets)(*known.values())
        return q, e[0] if e else known.get("e"), status

    def noise(self, T: Array) -> dict[str, Any]:
        """Standard deviations and covariances of these."""
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
        """Of commanded poses, without noise but with its size."""
        return Measurements(self.readings(T), self.noise(T))

    def prepared(self, T: Array) -> CalibrationProblem:
        """The calibration from these points. Raises ArgumentError."""
        if self.earlier:  # the same equations with other poses
            return self.earlier[0].on(self.measurements(T))
        given = self.task.choice
        known = {"device_at", "plane_normal", "plane_point"} & set(type(self.model)._declared)
        choice = replace(given, fixed=[*given.fixed, *sorted(known)])
        try:
            problem = prepare(self.model, self.measurements(T), choice, latent=self.latent)
        except ModelError as error:
            raise ArgumentError(str(error), "choice") from error
        self.earlier.append(problem)
        return problem

    def whole(self, T: Array) -> CalibrationProblem:
        """The robot's own closure equations at these points, all of its pose known: for positioning errors."""
        q, e, status = self.placed(T)
        good = status == 0
        values = {"q": q[good], "T": T[good, :3]} | ({} if e is None else {"e": e[good]})
        return prepare(self.task.robot, Measurements(values), self.task.choice)

    def noisy(self, m: Measurements, rng: np.random.Generator) -> Measurements:
        """Synthetic: the measurements with normal noise of their size."""
        values = {n: np.asarray(a) for n, a in m.values.items()}
        for name in sorted(m.noise):
            size = 3 if name == "e" else values[name].shape[1]
            C = np.broadcast_to(m.covariance(name, size), (len(m), size, size))
            by = sampled(C, rng)
            values[name] = moved(values[name], by)
        return Measurements(values, m.noise)


def measuring(task: Task) -> Measuring:
    """The device of a task. Raises ArgumentError."""
    robot, asked, latent = task.robot, task.device, orientation(task.robot)
    try:
        if isinstance(asked, Wire | Gauge):
            signal, model, at, span = _distance(robot, asked) if isinstance(asked, Wire) else _height(robot, asked)
            return Measuring(task, model, signal, ("T", *latent), (span,), at, span.read)
        at = np.array(asked.at)
        if isinstance(asked, Tracker):
            device = LaserTracker(
                at, asked.range_noise, asked.range_noise_per_metre, asked.angle_noise, 0.0, asked.nearest,
                asked.farthest, asked.elevation,
            )  # fmt: skip
            latent = latent if asked.orientation_noise is None else []
            if asked.target_axis is not None and not np.linalg.norm(asked.target_axis) > 0:
                raise ArgumentError("is zero and looks nowhere", "device.target_axis")
        else:
            device = Camera(
                at, np.array(asked.looks_at), asked.focal_pixel, asked.width_pixel, asked.height_pixel, asked.pattern,
                asked.marks, asked.pixel_noise, distortion=asked.distortion,
            )  # fmt: skip
            _ = device.axes  # a wrong direction is refused here
        return Measuring(task, robot, "T", tuple(latent), (device, *_sight(task, at)), at, device)
    except ModelError as error:
        raise ArgumentError(str(error), "device") from error


def _distance(robot: Model, asked: Wire) -> tuple[str, Model, Array, Span]:
    at = np.array(asked.at)
    span = Span(lambda T: np.linalg.norm(T - at, axis=1), asked.nearest, asked.farthest, "range of the distance")
    return "distance", seen_by_distance(robot, at), at, span


def _height(robot: Model, asked: Gauge) -> tuple[str, Model, None, Span]:
    model, point = seen_by_plane(robot, asked.normal, asked.point), np.array(asked.point)
    normal = np.array(asked.normal) / np.linalg.norm(asked.normal)
    return "height", model, None, Span(lambda T: (T - point) @ normal, asked.low, asked.high, "range of the height")


def _sight(task: Task, at: Array) -> list[Limit]:
    boxes = task.obstacles
    if not boxes:
        return []
    low, high = (np.array([getattr(box, end) for box in boxes]) for end in ("low", "high"))
    return [LineOfSight(at, low, high, [box.name or f"box {k + 1}" for k, box in enumerate(boxes)])]
