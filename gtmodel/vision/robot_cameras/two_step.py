"""Calibration in two steps: intersection of positions from pictures, then calibration of the robot with them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import casadi as ca
import numpy as np

from ..._pickling import Portable
from ...calibrate.calibration import Calibration, calibrate
from ...calibrate.measurements import Measurements, Pose
from ...calibrate.options import Choice
from ...geometry.quaternions import quaternion_matrix
from ...inference.bundle import BundleFit, ResidualBlock, UnknownGroup, bundle_fit
from ...lang.model import Model
from ...results.refusal import ArgumentError
from ...robots.links import family_of
from .joint import CAMERA_UNITS, Prepared, held_by_default
from .options import CameraStart, RobotCameras
from .pictures import RobotPictures
from .projection import CAMERA, TARGET, TURN, RobotLinks, seen

POSE = ("x", "y", "z")


class Intersected(NamedTuple):
    """Cameras from the pictures alone, residuals [pixel], centres of the target [m], their conditional covariance."""

    fit: BundleFit
    residuals: np.ndarray
    centres: np.ndarray
    covariance: np.ndarray


@dataclass(frozen=True, eq=False)
class TwoStepFit(Portable):
    """Result of a calibration in two steps.

    `cameras`: bundle of the pictures alone, with `residuals` (n, 2) [pixel]. `centres` (N, 3) [m]: of the target, with
    their `covariance` (N, 3, 3) for fixed cameras, which is smaller than the actual one. `calibration`: of the robot
    with these positions. `factor`: final scale factor of lengths, if the actuators give the scale.
    """

    cameras: BundleFit
    residuals: np.ndarray
    centres: np.ndarray
    covariance: np.ndarray
    calibration: Calibration
    side: RobotLinks
    factor: float

    @property
    def parameters(self) -> dict[str, float]:
        """The robot's free parameters by name, in metres."""
        values = self.calibration.values
        return {n: values[n] * self.factor for n in self.side.unknowns.names if n in values}

    def positions(self, q: np.ndarray) -> np.ndarray:
        """Return tool centre points (n, 3) [m] of the calibrated robot at actuator readings q; NaN without solution."""
        x = np.array([self.calibration.values[n] for n in self.side.unknowns.names])
        near = self.side.start(q)
        return self.factor * self.side.forward(x, q, near)[:, :3]


def two_step_fit(
    robot: Model,
    pictures: RobotPictures,
    cameras: list[CameraStart],
    setting: RobotCameras | None = None,
    *,
    stop: Callable[[], bool] | None = None,
) -> TwoStepFit:
    """Estimate cameras and target positions from the pictures alone, then calibrate the robot with these positions.

    With the scale "target", the position of the known target is free at each pose, and its rotation is common to all.
    With "actuators", every corner is free at every pose, as in Dressler 2012, section 5.5: the pictures determine the
    relative orientation of two cameras, and positions up to a factor, which finally follows from the displacement of
    the held actuator. Raises ArgumentError for a single camera with free corners, cameras on the plate, and robots
    whose plate rotates.

    >>> V = gt.vision.robot_cameras
    >>> made = V.made_pictures(V.SyntheticRobotCameras(counts=[4, 4, 4], distortion=[0.0] * 5))
    >>> known = [V.CameraStart(n, 1600.0, 1200.0, 1400.0, [800.0, 600.0]) for n in ("left", "right")]
    >>> two = V.two_step_fit(made.robot, made.pictures, known, V.RobotCameras(estimate=[]))
    >>> two.centres.shape, two.calibration.status.ok
    ((64, 3), True)
    """
    setting = setting or RobotCameras()
    free_corners = setting.scale == "actuators"
    if setting.late:
        raise ArgumentError("two steps need a robot at rest; calibrate jointly", "late")
    if setting.mounted != "fixed":
        raise ArgumentError("two steps need fixed cameras; calibrate jointly", "mounted")
    if free_corners and len(pictures.cameras) < 2:
        raise ArgumentError("one camera cannot intersect points; use the scale target, or two cameras", "scale")
    if free_corners and (family_of(robot) != "three_link" or setting.hold is not None):
        raise ArgumentError(
            "in two steps, actuators can give the scale only for robots with three guideways and without hold", "scale"
        )
    # only the base frame is held: the length of the last guideway's direction vector then gives the scale
    hold, _ = held_by_default(robot, replace(setting, scale="target") if free_corners else setting)
    ready = Prepared.of(robot, pictures, cameras, replace(setting, hold=hold, scale="target"))
    if ready.side.turns:
        raise ArgumentError("two steps need a robot whose plate does not rotate; calibrate jointly", "robot")
    step = _free_corners if free_corners else _free_poses
    bundle, residuals, centres, covariance = step(ready, pictures, stop)
    measured = Measurements(
        {"q": pictures.actuators, "T": centres}, noise={"q": setting.actuator_noise, "T": covariance},
        poses=[Pose("T", device=True)],
    )  # fmt: skip
    c = calibrate(robot, measured, Choice(fixed=[*hold, *setting.fixed]), cost="orthogonal", stop=stop)
    factor = 1.0
    if free_corners:
        factor = float(ready.side.unknowns.named(ready.side.unknowns.start).get("v[2,0]", 1.0)) / c.values["v[2,0]"]
    return TwoStepFit(bundle, residuals, centres, covariance, c, ready.side, factor)


def _free_poses(ready: Prepared, p: RobotPictures, stop: Callable[[], bool] | None) -> Intersected:
    """Fit a free position of the known target at every pose, and one rotation, as the plate does not rotate."""
    c, t, z, d = (ca.SX.sym(n, k) for n, k in (("c", 16), ("t", 4), ("z", 3), ("d", 5)))
    uv, margin = seen(c, z + quaternion_matrix(t) @ d[:3])
    f = ca.Function("corners", [c, t, z, d], [uv - d[3:], margin])
    block = ResidualBlock("corners", f, [("camera", p.camera), ("target", 0), ("pose", p.pose)],
                          np.column_stack([p.target[p.mark], p.uv]), sigma=p.sigma)  # fmt: skip
    names = [f"pose {k}" for k in p.poses]
    turn = UnknownGroup("target", ready.start["target"][:, :4], TARGET[:4], turn=0)
    poses = UnknownGroup("pose", ready.start["pose"], POSE, names, local=True)
    fit = _with_cameras(ready, [turn, poses], block, stop)
    still = _cameras_held(ready, fit, [turn, poses], block)
    middle = quaternion_matrix(fit.values["target"][0]) @ p.target.mean(axis=0)
    return Intersected(fit, fit.residuals["corners"], fit.values["pose"] + middle, still.local_covariance)


def _free_corners(ready: Prepared, p: RobotPictures, stop: Callable[[], bool] | None) -> Intersected:
    """Fit every corner at every pose as a separate point; the baseline is held."""
    c, z, d = ca.SX.sym("c", 16), ca.SX.sym("z", 3), ca.SX.sym("d", 2)
    uv, margin = seen(c, z)
    f = ca.Function("corners", [c, z, d], [uv - d, margin])
    key, point = np.unique(p.pose * len(p.marks) + p.mark, return_inverse=True)
    if np.any(np.bincount(point) < 2):
        raise ArgumentError("a corner is seen by only one camera and cannot be intersected; remove it", "corners")
    R = quaternion_matrix(ready.start["target"][0, :4])
    start = ready.start["pose"][key // len(p.marks), :3] + p.target[key % len(p.marks)] @ R.T
    block = ResidualBlock("corners", f, [("camera", p.camera), ("point", point)], p.uv, sigma=p.sigma)
    labels = [f"point {k}" for k in range(len(start))]
    points = UnknownGroup("point", start, POSE, labels, local=True)
    fit = _with_cameras(ready, [points], block, stop, baseline=True)
    still = _cameras_held(ready, fit, [points], block)
    pose = key // len(p.marks)
    count = np.bincount(pose, minlength=len(p.poses))
    if np.any(count < len(p.marks)):
        raise ArgumentError("a pose lacks corners, so its mean corner would be another point; remove it", "corners")
    centres = np.stack([np.bincount(pose, fit.values["point"][:, j]) / count for j in range(3)], axis=1)
    C = np.zeros((len(count), 3, 3))
    np.add.at(C, pose, still.local_covariance)
    return Intersected(fit, fit.residuals["corners"], centres, C / count[:, None, None] ** 2)


def _with_cameras(ready: Prepared, others: list[UnknownGroup], block: ResidualBlock, stop: Callable[[], bool] | None,
                  baseline: bool = False) -> BundleFit:  # fmt: skip
    fixed = ready.camera_fixed.copy()
    fixed[0, 9:] = True  # the first camera's pose defines the frame
    if baseline:
        apart = np.abs(ready.start["camera"][1, 13:] - ready.start["camera"][0, 13:])
        fixed[1, 12 + int(np.argmax(apart))] = True
    start = ready.start["camera"]
    cameras = UnknownGroup("camera", start, CAMERA, ready.names, turn=TURN, fixed=fixed, units=CAMERA_UNITS)
    fit = bundle_fit([cameras, *others], [block], stop=stop)
    if not fit.status.ok:
        raise ArgumentError(
            f"the pictures alone do not determine the cameras ({fit.message}). If the target never tilts, focal length "
            "and distance cannot be separated; hold known camera parameters, or calibrate jointly",
            "corners",
        )
    return fit


def _cameras_held(ready: Prepared, fit: BundleFit, others: list[UnknownGroup], block: ResidualBlock) -> BundleFit:
    """Repeat the fit with the cameras and the rotation of the target held at their estimates."""
    cameras = UnknownGroup("camera", fit.values["camera"], CAMERA, ready.names, turn=TURN, fixed=np.ones(15, bool))
    ended = [replace(g, start=fit.values[g.name], fixed=None if g.local else np.ones(g.moves, bool)) for g in others]
    return bundle_fit([cameras, *ended], [block])
