"""Positions by intersection first, then the robot on these: what a calibration of poses alone can take over."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import casadi as ca
import numpy as np

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
    """Cameras from pictures alone, residuals [pixel], middles of the target [m] and their conditional covariance."""

    fit: BundleFit
    residuals: np.ndarray
    centres: np.ndarray
    covariance: np.ndarray


@dataclass(frozen=True, eq=False)
class TwoStepFit:
    """`cameras`: the bundle of pictures alone, `residuals` (n, 2) [pixel] there. `centres` (N, 3) [m] of the target and
    their `covariance` (N, 3, 3) with the cameras held fixed: conditional on them, and so smaller than the truth.
    `calibration`: of the robot on these. `factor`: by which lengths were multiplied at the end, where the actuators
    give the scale.
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
        own = self.calibration.values
        return {n: own[n] * self.factor for n in self.side.unknowns.names if n in own}

    def positions(self, q: np.ndarray) -> np.ndarray:
        """Tool centre points (n, 3) [m] of actuators by the calibrated robot; NaN where it does not close."""
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
    """Cameras and target positions from the pictures alone, then the robot on these positions.

    With the scale "target" the position of the known target is free at each pose and its turn is one for all. With
    "actuators" every corner is free at every pose, as in Dressler 2012, section 5.5: pictures give the relative
    orientation of two cameras and positions up to a factor, which the displacement of the held actuator gives at the
    end. Raises ArgumentError for one camera with free corners, cameras on the plate, and robots whose plate turns.

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
        raise ArgumentError("two steps are for a robot that stands; calibrate jointly", "late")
    if setting.mounted != "fixed":
        raise ArgumentError("positions are intersected by fixed cameras; calibrate jointly", "mounted")
    if free_corners and len(pictures.cameras) < 2:
        raise ArgumentError("one camera intersects nothing; take the target's scale, or two cameras", "scale")
    if free_corners and (family_of(robot) != "three_link" or setting.hold is not None):
        raise ArgumentError("in two steps actuators give the scale of three guideways, by the last one", "scale")
    # the base frame alone is held: the last guideway keeps its direction, and its unit shows the scale
    hold, _ = held_by_default(robot, replace(setting, scale="target") if free_corners else setting)
    ready = Prepared.of(robot, pictures, cameras, replace(setting, hold=hold, scale="target"))
    if ready.side.turns:
        raise ArgumentError("two steps are for robots whose plate does not turn; calibrate jointly", "robot")
    step = _free_corners if free_corners else _free_poses
    rough, rest, centres, covariance = step(ready, pictures, stop)
    measured = Measurements(
        {"q": pictures.actuators, "T": centres}, noise={"q": setting.actuator_noise, "T": covariance},
        poses=[Pose("T", device=True)],
    )  # fmt: skip
    c = calibrate(robot, measured, Choice(fixed=[*hold, *setting.fixed]), cost="orthogonal", stop=stop)
    factor = 1.0
    if free_corners:
        factor = float(ready.side.unknowns.named(ready.side.unknowns.start).get("v[2,0]", 1.0)) / c.values["v[2,0]"]
    return TwoStepFit(rough, rest, centres, covariance, c, ready.side, factor)


def _free_poses(ready: Prepared, p: RobotPictures, stop: Callable[[], bool] | None) -> Intersected:
    """The position of the known target is free at every pose; its turn is one for all, as the plate never turns."""
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
    """Every corner at every pose is a point of its own; the baseline is held."""
    c, z, d = ca.SX.sym("c", 16), ca.SX.sym("z", 3), ca.SX.sym("d", 2)
    uv, margin = seen(c, z)
    f = ca.Function("corners", [c, z, d], [uv - d, margin])
    key, point = np.unique(p.pose * len(p.marks) + p.mark, return_inverse=True)
    if np.any(np.bincount(point) < 2):
        raise ArgumentError("a corner is seen by one camera alone; leave it out to intersect", "corners")
    own = quaternion_matrix(ready.start["target"][0, :4])
    start = ready.start["pose"][key // len(p.marks), :3] + p.target[key % len(p.marks)] @ own.T
    block = ResidualBlock("corners", f, [("camera", p.camera), ("point", point)], p.uv, sigma=p.sigma)
    labels = [f"point {k}" for k in range(len(start))]
    points = UnknownGroup("point", start, POSE, labels, local=True)
    fit = _with_cameras(ready, [points], block, stop, baseline=True)
    still = _cameras_held(ready, fit, [points], block)
    pose = key // len(p.marks)
    count = np.bincount(pose, minlength=len(p.poses))
    if np.any(count < len(p.marks)):
        raise ArgumentError("a pose lacks some of its corners; the middle of the others is another point", "corners")
    centres = np.stack([np.bincount(pose, fit.values["point"][:, j]) / count for j in range(3)], axis=1)
    C = np.zeros((len(count), 3, 3))
    np.add.at(C, pose, still.local_covariance)
    return Intersected(fit, fit.residuals["corners"], centres, C / count[:, None, None] ** 2)


def _with_cameras(ready: Prepared, others: list[UnknownGroup], block: ResidualBlock, stop: Callable[[], bool] | None,
                  baseline: bool = False) -> BundleFit:  # fmt: skip
    fixed = ready.camera_fixed.copy()
    fixed[0, 9:] = True  # the first camera's place defines the frame
    if baseline:
        apart = np.abs(ready.start["camera"][1, 13:] - ready.start["camera"][0, 13:])
        fixed[1, 12 + int(np.argmax(apart))] = True
    start = ready.start["camera"]
    cameras = UnknownGroup("camera", start, CAMERA, ready.names, turn=TURN, fixed=fixed, units=CAMERA_UNITS)
    fit = bundle_fit([cameras, *others], [block], stop=stop)
    if not fit.status.ok:
        raise ArgumentError(
            f"the pictures alone do not give the cameras ({fit.message}): a target that never tilts leaves focal "
            "length and distance to each other; hold what is known of the cameras, or calibrate jointly",
            "corners",
        )
    return fit


def _cameras_held(ready: Prepared, fit: BundleFit, others: list[UnknownGroup], block: ResidualBlock) -> BundleFit:
    """The same with the cameras, and the target's turn, fixed where they ended."""
    cameras = UnknownGroup("camera", fit.values["camera"], CAMERA, ready.names, turn=TURN, fixed=np.ones(15, bool))
    ended = [replace(g, start=fit.values[g.name], fixed=None if g.local else np.ones(g.moves, bool)) for g in others]
    return bundle_fit([cameras, *ended], [block])
