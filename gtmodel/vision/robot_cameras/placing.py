"""Where to put two cameras: the error over the workspace for each place, before anything is measured."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...lang.model import Model
from ...results.refusal import ArgumentError
from .joint import joint_fit
from .options import CameraPlaces, RobotCameras, SyntheticRobotCameras
from .predicted import PredictedPositions, predicted_positions
from .synthetic import made_pictures


@dataclass(frozen=True, eq=False)
class PlacedCameras:
    """One place: what the calibration there will be worth; `why` says why it is none where `predicted` is None."""

    baseline: float
    distance: float
    predicted: PredictedPositions | None
    focal_deviation: float = np.nan
    why: str = ""


def camera_places(
    robot: Model, scene: SyntheticRobotCameras, places: CameraPlaces, setting: RobotCameras | None = None
) -> list[PlacedCameras]:
    """Predicted errors for each baseline and distance, the least first; places where the target leaves a picture last.

    The robot is the one known before, pictures have no error but their noise counts: the covariance is that of the
    calibration to come, to first order. Raises ArgumentError where no place sees the target everywhere.

    >>> V = gt.vision.robot_cameras
    >>> robot, scene = gt.robots.gantry_tau("l1_tape"), V.SyntheticRobotCameras(counts=[3, 3, 3])
    >>> best, worst = V.camera_places(robot, scene, V.CameraPlaces(baselines=[0.5, 1.5], distances=[3.2]))
    >>> best.baseline, bool(best.predicted.rms < worst.predicted.rms)
    (1.5, True)
    """
    rows = [_placed(robot, scene, b, d, setting or RobotCameras()) for d in places.distances for b in places.baselines]
    if all(r.predicted is None for r in rows):
        raise ArgumentError(f"no place sees the target at every pose: {rows[0].why}", "distances")
    return sorted(rows, key=lambda r: np.inf if r.predicted is None else r.predicted.rms)


def _placed(
    robot: Model, scene: SyntheticRobotCameras, baseline: float, distance: float, setting: RobotCameras
) -> PlacedCameras:
    still = replace(scene, baseline=baseline, distance=distance, robot_error=0.0, pixel_noise=0.0, actuator_noise=0.0,
                    turned_pictures=[], wrong_corners=0.0)  # fmt: skip
    try:
        made = made_pictures(still, robot)
    except ArgumentError as error:
        return PlacedCameras(baseline, distance, None, why=error.message)
    pictures = replace(made.pictures, sigma=np.full(len(made.pictures), scene.pixel_noise))
    joint = joint_fit(made.robot, pictures, made.cameras, replace(setting, removal=0.0))
    if not joint.fit.status.ok:
        return PlacedCameras(baseline, distance, None, why=joint.fit.message)
    names = list(joint.estimate.names)
    focal = f"{pictures.cameras[0]}.fx"
    deviation = float(joint.estimate.std[names.index(focal)]) if focal in names else 0.0
    return PlacedCameras(baseline, distance, predicted_positions(joint, pictures.actuators), deviation)
