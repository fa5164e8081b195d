"""The device of a calibration plan: what it sees, the model with its variable, and measurements it would make."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from gtmodel.calibrate import (
    Camera,
    Choice,
    LaserTracker,
    LineOfSight,
    Measurements,
    Problem,
    prepare,
    seen_by_distance,
    seen_by_plane,
)
from gtmodel.calibrate.devices import sampled
from gtmodel.calibrate.true_poses import moved
from gtmodel.compiler.causal import compile_causal, flat_of
from gtmodel.kinematics.workspace import Limit, Poses
from gtmodel.lang import Model, ModelError
from gtmodel.problem_files.base import InputError

from .calibration_plan_keys import CameraKeys, DistanceKeys, PlaneKeys, Schema, TrackerKeys

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
    """A robot and a device. `model`: of the robot with what the device adds; `latent`: what nobody measures.

    `limits`: what the device sees. `at`: where it stands, None for a plane. `earlier`: the problem once it is made.
    """

    problem: Schema
    robot: Model
    model: Model
    signal: str
    latent: tuple[str, ...]
    limits: tuple[Limit, ...]
    at: Array | None
    device: Any
    earlier: list[Problem] = field(default_factory=list)

    def readings(self, T: Array) -> dict[str, Array]:
        """Noise-free measurements at commanded poses. Raises InputError for what cannot be reached."""
        q, e, status = self.placed(T)
        if np.any(status != 0):
            raise InputError("a pose of the plan cannot be reached by the robot's inverse kinematics", "room")
        T = T[:, :3]
        found = {"q": q, self.signal: T if self.signal == "T" else self.device(T)}
        return found | ({} if e is None or "e" in self.latent else {"e": e})

    def placed(self, T: Array) -> tuple[Array, Array | None, Array]:
        """Actuators, quaternions of a plate that turns, and status of commanded poses: rows of T [m], of an F1 with
        its quaternion behind."""
        if T.shape[1] == 7:
            q, status = compile_causal(self.robot, known=["T", "e"], targets=["q"])(T[:, :3], T[:, 3:])
            return q, T[:, 3:], status
        q, *e, status = compile_causal(self.robot, known=["T"], targets=["q", *self.turns])(T)
        return q, e[0] if e else None, status

    @property
    def turns(self) -> list[str]:
        """The orientation, where the robot's plate has one."""
        return ["e"] if "e" in flat_of(self.robot).groups else []

    def noise(self, T: Array) -> dict[str, Any]:
        """Standard deviations and covariances of these."""
        keys = self.problem.device
        found: dict[str, Any] = {}
        if isinstance(keys, (TrackerKeys, CameraKeys)):
            found["T"] = self.device.covariance(T[:, :3])
        else:
            found[self.signal] = 1e-6 * keys.noise_um
        if isinstance(keys, TrackerKeys) and keys.orientation_noise_urad is not None and self.turns:
            found["e"] = 1e-6 * keys.orientation_noise_urad
        if self.problem.actuator_noise_um > 0:
            rotary = 3 if T.shape[1] == 7 else 0
            axes = [self.problem.axis_noise_urad] * rotary
            found["q"] = 1e-6 * np.array([self.problem.actuator_noise_um] * 3 + axes)
        return found

    def measurements(self, T: Array) -> Measurements:
        """Of commanded poses, without noise but with its size."""
        return Measurements(self.readings(T), self.noise(T))

    def prepared(self, T: Array) -> Problem:
        """The calibration from these points. Raises InputError."""
        p = self.problem
        if self.earlier:  # the same equations with other poses
            return self.earlier[0].on(self.measurements(T))
        known = {"device_at", "plane_normal", "plane_point"} & set(type(self.model)._declared)
        choice = Choice(p.free, [*p.fixed, *sorted(known)], p.tied, p.unit_quaternions, sizes=p.sizes)
        try:
            found = prepare(self.model, self.measurements(T), choice, latent=self.latent)
        except ModelError as error:
            raise InputError(str(error)) from error
        self.earlier.append(found)
        return found

    def whole(self, T: Array) -> Problem:
        """The robot's own closure equations at these points, all of its pose known: for positioning errors."""
        p = self.problem
        q, e, status = self.placed(T)
        good = status == 0
        values = {"q": q[good], "T": T[good, :3]} | ({} if e is None else {"e": e[good]})
        return prepare(
            self.robot, Measurements(values), Choice(p.free, p.fixed, p.tied, p.unit_quaternions, sizes=p.sizes)
        )

    def noisy(self, m: Measurements, rng: np.random.Generator) -> Measurements:
        """Synthetic: the measurements with normal noise of their size."""
        values = {n: np.asarray(a) for n, a in m.values.items()}
        for name in sorted(m.noise):
            size = 3 if name == "e" else values[name].shape[1]
            C = np.broadcast_to(m.covariance(name, size), (len(m), size, size))
            by = sampled(C, rng)
            values[name] = moved(values[name], by)
        return Measurements(values, m.noise)


def measuring(problem: Schema, robot: Model) -> Measuring:
    """The device of the file. Raises InputError."""
    keys = problem.device
    turns = ["e"] if "e" in flat_of(robot).groups else []
    try:
        if isinstance(keys, TrackerKeys):
            at = np.array(keys.at_m)
            device = LaserTracker(
                at, 1e-6 * keys.range_noise_um, 1e-6 * keys.range_noise_um_per_m, 1e-6 * keys.angle_noise_urad, 0.0,
                keys.nearest_m, keys.farthest_m, np.radians(keys.elevation_deg),
            )  # fmt: skip
            latent = turns if keys.orientation_noise_urad is None else []
            limits: list[Limit] = [device]
            if keys.target_axis is not None and not np.linalg.norm(keys.target_axis) > 0:
                raise InputError("is zero and looks nowhere", "device.target_axis")
            return Measuring(problem, robot, robot, "T", tuple(latent), (*limits, *_sight(problem, at)), at, device)
        if isinstance(keys, CameraKeys):
            at = np.array(keys.at_m)
            camera = Camera(
                at, np.array(keys.looks_at_m), keys.focal_pixel, keys.width_pixel, keys.height_pixel,
                1e-3 * keys.pattern_mm, keys.marks, keys.pixel_noise,
            )  # fmt: skip
            _ = camera.axes  # a wrong direction is told here
            return Measuring(problem, robot, robot, "T", tuple(turns), (camera, *_sight(problem, at)), at, camera)
        if isinstance(keys, DistanceKeys):
            at = np.array(keys.at_m)

            def distance(T: Array) -> Array:
                return np.linalg.norm(T - at, axis=1)

            span = Span(distance, keys.nearest_m, keys.farthest_m, "range of the distance")
            model = seen_by_distance(robot, at)
            return Measuring(problem, robot, model, "distance", ("T", *turns), (span,), at, distance)
        return _over_plane(problem, keys, robot, turns)
    except ModelError as error:
        raise InputError(str(error), "device") from error


def _over_plane(problem: Schema, keys: PlaneKeys, robot: Model, turns: list[str]) -> Measuring:
    model = seen_by_plane(robot, keys.normal, keys.point_m)
    normal = np.array(keys.normal) / np.linalg.norm(keys.normal)

    def height(T: Array) -> Array:
        return (T - np.array(keys.point_m)) @ normal

    span = Span(height, keys.low_m, keys.high_m, "range of the height")
    return Measuring(problem, robot, model, "height", ("T", *turns), (span,), None, height)


def _sight(problem: Schema, at: Array) -> list[Limit]:
    if not problem.obstacles:
        return []
    low, high = (np.array([getattr(box, key) for box in problem.obstacles]) for key in ("low_m", "high_m"))
    return [LineOfSight(at, low, high, [box.name or f"box {k + 1}" for k, box in enumerate(problem.obstacles)])]
