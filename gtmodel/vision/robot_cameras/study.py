"""The study of a robot with cameras: joint and two-step calibration, errors on held-out poses, and tests of the
residuals."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, Unpack

import numpy as np

from ... import view
from ...calibrate.measured.column_checks import aligned
from ...geometry.quaternions import quaternion_matrix
from ...lang.model import Model
from ...results import Check, SolveStatus, Work, at_least, at_most
from ...results.disk import MadeFiles
from ...results.options import Within
from ...results.refusal import ArgumentError
from ...results.suspicion import RUN_LEVEL, suspicion_checks
from ...results.work import WorkOptions, study_function
from ...view.bodies import COLOURS
from ..detection.marks import corners_csv
from ..residuals import LEAST, ROUNDING, PictureTest, gross_errors, picture_test, shifted_pictures
from .joint import JointFit, held_out_pixels, joint_fit
from .options import CameraPlaces, CameraStart, RobotCameras, RobotCamerasStudy, SyntheticRobotCameras
from .pictures import RobotPictures
from .predicted import camera_places, predicted_positions
from .projection import CAMERA
from .reading import corner_rows
from .robust import suspicions
from .synthetic import made_pictures
from .two_step import TwoStepFit, two_step_fit


def aligned_errors(positions: np.ndarray, truth: np.ndarray, scale: bool = False) -> np.ndarray:
    """Return |error| (n,) [m] of `positions` (n, 3) [m] from `truth` (n, 3) [m] after the best fit of rotation and
    translation, and of a scale factor if `scale`.

    Rows of `positions` that are not finite give NaN.

    >>> truth = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    >>> shifted = truth + [0.3, 0.2, 0.1]
    >>> bool(gt.vision.robot_cameras.aligned_errors(shifted, truth).max() < 1e-12)
    True
    """
    good = np.all(np.isfinite(positions), axis=1)
    a, b = positions[good], truth[good]
    _, R, _ = aligned(a, b)
    da, db = (a - a.mean(axis=0)) @ R.T, b - b.mean(axis=0)
    s = float(np.vdot(da, db) / np.vdot(da, da)) if scale else 1.0
    out = np.full(len(positions), np.nan)
    out[good] = np.linalg.norm(s * da - db, axis=1)
    return out


@dataclass(frozen=True, eq=False)
class PictureMap:
    """p-values (K,) of the residuals of each camera having no pattern over the picture.

    `radius`: tests whether the radial component follows a cubic polynomial of the radius. `quadratic`: tests whether
    both components follow quadratic polynomials of u and v, with `coefficients` (K, 6, 2) [pixel] of 1, u, v, u^2, uv,
    v^2, where u and v range from -1 to 1 over the corners. A wrong principal point lowers the p-value `quadratic`, but
    not always `radius`.
    """

    cameras: tuple[str, ...]
    radius: np.ndarray
    quadratic: np.ndarray
    coefficients: np.ndarray

    def fires(self, quiet: float = 1e-3) -> tuple[str, ...]:
        """Return the cameras with a significant quadratic map, with this probability of a false alarm over all."""
        return tuple(n for n, p in zip(self.cameras, self.quadratic, strict=True) if p < quiet / len(self.cameras))


def picture_map(pictures: RobotPictures, residuals: np.ndarray) -> PictureMap:
    """Test with `gt.vision.picture_test` whether residuals (n, 2) [pixel] depend on the place in each camera's picture.

    Residuals are taken in units of their sigma. The picture is the area covered by the corners, and the radius is
    measured from their mean. The fit has already absorbed a part of possible patterns, so both tests fire a little less
    often than stated. Raises ArgumentError for fewer than 30 corners of a camera.

    >>> V = gt.vision.robot_cameras
    >>> pictures = V.made_pictures(V.SyntheticRobotCameras(counts=[3, 3, 3])).pictures
    >>> rng = np.random.default_rng(1)
    >>> noise = 0.1 * rng.standard_normal(pictures.uv.shape)
    >>> V.picture_map(pictures, noise).fires(), V.picture_map(pictures, noise + 1e-6 * pictures.uv**2).fires()
    ((), ('left', 'right'))
    """
    tests, sigma = list[PictureTest](), list[float]()
    for k, name in enumerate(pictures.cameras):
        rows = pictures.camera == k
        if rows.sum() < LEAST:
            raise ArgumentError(f"{name} has {int(rows.sum())} corners; expected at least {LEAST}", "corners")
        uv = pictures.uv[rows] - pictures.uv[rows].min(axis=0)
        width, height = np.ptp(uv, axis=0) + 1.0
        size = float(width), float(height)
        sigma.append(float(np.mean(pictures.sigma[rows])))
        e, least = residuals[rows] / pictures.sigma[rows, None], ROUNDING / sigma[-1]
        tests.append(picture_test(uv, e, size, uv.mean(axis=0), least=least))
    return PictureMap(
        tuple(pictures.cameras), np.array([t.radius for t in tests]), np.array([t.quadratic for t in tests]),
        np.array([s * t.coefficients for s, t in zip(sigma, tests, strict=True)]),
    )  # fmt: skip


FRAME_AXIS = "v[2,0]"  # length of the direction vector of the last guideway, the x-axis of the base
UNIT = 5e-3  # largest relative scale error of a guideway; scales and screws have a hundredth of that


@study_function
def study(
    robot: Model,
    pictures: RobotPictures | SyntheticRobotCameras,
    cameras: Sequence[CameraStart] = (),
    setting: RobotCameras | None = None,
    *,
    held_out: Annotated[int, Within(least=2)] = 2,
    two_steps: bool = False,
    accuracy: Annotated[float | None, Within(above=0.0)] = None,
    **work_options: Unpack[WorkOptions],
) -> RobotCamerasStudy:
    """Calibrate a robot together with its cameras, and evaluate both on held-out poses.

    Args:
        robot: with its uncalibrated parameters.
        pictures: corners and actuator readings, or options for synthetic ones.
        cameras: as known beforehand, one for each name in the pictures; if left out for synthetic pictures, only their
            size is known.
        setting: estimated parameters, and source of the scale.
        held_out: every how many-th pose is held out.
        two_steps: also calibrate in two steps with intersected positions, for comparison.
        accuracy: largest acceptable mean error [m] of held-out positions; only for synthetic pictures.
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    A check fails if the residuals of a camera contain a quadratic map of its picture: the camera model is then wrong.
    Further checks fail if residuals are larger than the stated noise, or if the pictures of a camera drift from pose
    to pose. Raises ArgumentError with a remedy if the pictures do not determine all unknowns.

    >>> V = gt.vision.robot_cameras
    >>> s = V.study(gt.robots.gantry_tau("l1_tape"), V.SyntheticRobotCameras(counts=[4, 4, 4]))
    >>> s.status.ok, s.held_out["mean"] < 0.5e-3
    (True, True)
    """
    work = Work(**work_options)
    setting = setting or RobotCameras()
    if isinstance(pictures, SyntheticRobotCameras):
        work.progress("making synthetic pictures", 0.1)
        synthetic = made_pictures(pictures, robot)
        pictures, cameras = synthetic.pictures, list(cameras) or synthetic.cameras
    title = work.title or "robot and cameras"
    if pictures.synthetic and "synthetic" not in title.lower():
        title += " (synthetic)"
    rows = np.arange(len(pictures.poses))
    judging = rows % held_out == held_out - 1
    fitted, unseen = pictures.part(rows[~judging]), pictures.part(rows[judging])
    work.progress("fitting robot and cameras", 0.3)
    joint = joint_fit(robot, fitted, list(cameras), setting, stop=work.interrupted)
    if not joint.fit.status.ok:
        return RobotCamerasStudy(status=joint.fit.status, message=joint.fit.message, title=title,
                                 synthetic=pictures.synthetic or None)  # fmt: skip
    work.progress("judging", 0.7)
    test = picture_map(joint.pictures, joint.residuals)
    q = unseen.actuators if unseen.rates is None else unseen.actuators + joint.delay * unseen.rates
    positions = joint.positions(q)
    errors = None if unseen.truth is None else aligned_errors(positions, unseen.truth)
    two = two_step_fit(robot, fitted, list(cameras), setting, stop=work.interrupted) if two_steps else None
    return _study(joint, test, fitted, unseen, errors, two, setting, accuracy, title, robot)


def _study(
    joint: JointFit, test: PictureMap, fitted: RobotPictures, unseen: RobotPictures, errors: np.ndarray | None,
    two: TwoStepFit | None, setting: RobotCameras, accuracy: float | None, title: str, robot: Model,
) -> RobotCamerasStudy:  # fmt: skip
    pixels = held_out_pixels(joint, unseen)
    least = min(test.quadratic.tolist())
    checks: dict[str, Check] = {
        "residuals_over_picture": at_least(least, setting.quiet / len(test.cameras), "estimate the held parameters of "
            f"the cameras: residuals of {' and '.join(test.fires(setting.quiet)) or 'no camera'} depend on the place"),
    }  # fmt: skip
    doubts, warnings = suspicion_checks(suspicions(joint))
    checks |= doubts
    if accuracy is not None:
        if errors is None:
            raise ArgumentError("measured pictures have no true positions to compare with; leave it out", "accuracy")
        checks["held_out_mean_m"] = at_most(float(np.nanmean(errors)), accuracy, "take more pictures")
    predicted = predicted_positions(joint, unseen.actuators)
    mean = f"; mean error of held-out positions {1e3 * float(np.nanmean(errors)):.3g} mm" if errors is not None else ""
    p = joint.pictures
    seen = partial(_in_space, robot, joint, predicted.positions, predicted.covariance, title)
    return RobotCamerasStudy(
        status=SolveStatus.SOLVED,
        message=f"{joint.fit.message}{mean}",
        title=title,
        estimate=joint.estimate,
        objective=joint.fit.cost,
        iterations=joint.fit.iterations,
        checks=checks,
        notes=[*_notes(joint, test, two, setting), *warnings, *_held_out_notes(joint, unseen, pixels)],
        figures=_figures(joint, predicted.positions, predicted.covariance, title),
        scenes={"cameras": seen},
        machine_files=("parameters.csv",),
        files=MadeFiles({"parameters.csv": partial(_table, joint), "corners.csv": partial(_corners, p)}),
        unknowns=_unknowns(joint),
        cameras=_cameras(joint),
        poses={
            "fitted": len(fitted.poses),
            "held_out": len(unseen.poses),
            "corners": len(p),
            "corners_given": joint.first,
        },
        removed_pictures=joint.wrong_pictures,
        removed_poses=joint.wrong_poses,
        removed_corners=joint.wrong_corners,
        held_out_pixel=float(1.4826 * np.nanmedian(np.abs(pixels))),
        held_out=_sizes(errors),
        two_step=_two_step(two, fitted, unseen),
        delay=_delay(joint),
        predicted=predicted.rms,
        picture_radius=dict(zip(test.cameras, test.radius.tolist(), strict=True)),
        picture_quadratic=dict(zip(test.cameras, test.quadratic.tolist(), strict=True)),
        synthetic=p.synthetic or None,
    )


@study_function
def places_study(
    robot: Model,
    scene: SyntheticRobotCameras,
    places: CameraPlaces | None = None,
    setting: RobotCameras | None = None,
    *,
    accuracy: Annotated[float | None, Within(above=0.0)] = None,
    **work_options: Unpack[WorkOptions],
) -> RobotCamerasStudy:
    """Compare placements of two cameras by the predicted error over the volume after a calibration.

    Args:
        robot: with its uncalibrated parameters.
        scene: volume, target and noise.
        places: baselines and distances to compare.
        setting: parameters to be estimated.
        accuracy: largest acceptable rms error [m] of the best placement.
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    Raises ArgumentError if no placement sees the target at every pose.

    >>> V = gt.vision.robot_cameras
    >>> scene, places = V.SyntheticRobotCameras(counts=[3, 3, 3]), V.CameraPlaces(baselines=[0.5, 1.5], distances=[3.2])
    >>> V.places_study(gt.robots.gantry_tau("l1_tape"), scene, places).places[0]["baseline_m"]
    1.5
    """
    work = Work(**work_options)
    work.progress("comparing placements", 0.3)
    compared = camera_places(robot, scene, places or CameraPlaces(), setting)
    best = compared[0]
    assert best.predicted is not None and best.joint is not None
    seen = partial(_in_space, robot, best.joint, best.predicted.positions, best.predicted.covariance)
    checks = {} if accuracy is None else {"best_rms_m": at_most(best.predicted.rms, accuracy, "take more poses")}
    rows = [
        {
            "baseline_m": r.baseline, "distance_m": r.distance,
            "rms_mm": None if r.predicted is None else 1e3 * r.predicted.rms,
            "max_mm": None if r.predicted is None else 1e3 * r.predicted.greatest,
            "focal_std_pixel": None if r.predicted is None else r.focal_deviation, "why": r.why,
        }
        for r in compared
    ]  # fmt: skip
    message = (
        f"best placement: baseline {best.baseline:g} m, distance {best.distance:g} m; predicted rms error "
        f"{1e3 * best.predicted.rms:.3g} mm"
    )
    title = work.title or "placement of two cameras"
    return RobotCamerasStudy(
        status=SolveStatus.SOLVED, message=message, title=title, checks=checks, places=rows,
        figures={"workspace": partial(_ellipsoids, best.predicted.positions, best.predicted.covariance, title),
                 "places": partial(_places, rows, title)},
        scenes={"cameras": partial(seen, f"{title}: baseline {best.baseline:g} m, distance {best.distance:g} m")},
        notes=["predicted from noise alone; model errors, such as bent guideways or a wrong lens model, add to it"],
    )  # fmt: skip


def _notes(joint: JointFit, test: PictureMap, two: TwoStepFit | None, setting: RobotCameras) -> list[str]:
    notes = [f"removed: {name}, wrong as a whole" for name in joint.wrong_pictures]
    notes += [
        f"removed: pose {name}, whose pictures all contradict the actuator readings: rows or cameras exchanged, or the "
        "robot was still moving"
        for name in joint.wrong_poses
    ]
    if joint.wrong_corners:
        some = ", ".join(joint.wrong_corners[:3]) + (" and others" if len(joint.wrong_corners) > 3 else "")
        notes.append(f"removed: {len(joint.wrong_corners)} corners with gross errors: {some}")
    fired = test.fires(setting.quiet)
    if fired:
        notes.append(
            f"residuals of {' and '.join(fired)} contain a quadratic map of the picture, as a wrong principal point "
            "causes it; a test of the radial component alone may miss it"
        )
    length = joint.parameters.get(FRAME_AXIS, 1.0)
    if setting.scale == "target" and abs(abs(length) - 1) > UNIT:
        notes.append(
            f"according to the target, the last guideway moves {abs(length):.4f} m per metre of its actuator: the "
            "stated size of the target or the unit of the actuator is wrong; measure the target again"
        )
    if two is not None:
        notes.append(
            "in two steps the standard deviations ignore the errors of the cameras, which are held in the second step; "
            "repeated experiments scatter more"
        )
    return notes


def _held_out_notes(joint: JointFit, unseen: RobotPictures, pixels: np.ndarray) -> list[str]:
    """Return a note on held-out pictures that the calibrated robot predicts far worse than the others."""
    closed = np.flatnonzero(np.all(np.isfinite(pixels), axis=1))
    predicted, pixels = unseen.corners(closed), pixels[closed]
    if not len(predicted):
        return []
    bad = gross_errors(predicted, pixels, joint.setting.removal)  # a single corner does not make a wrong picture
    rest = np.flatnonzero(~bad.corners)
    shifted, numbers = shifted_pictures(predicted.corners(rest), pixels[rest])
    wrong = [*bad.pictures, *(int(numbers[k]) for k in shifted.beyond(RUN_LEVEL))]
    if not wrong:
        return []
    some = ", ".join(predicted.picture_name(k) for k in wrong[:3]) + (" and others" if len(wrong) > 3 else "")
    return [f"held-out pictures, or their actuator readings, are outliers: {some}; the held-out errors include them"]


def _delay(joint: JointFit) -> dict[str, float] | None:
    if "clock.delay" not in joint.estimate.names:
        return None
    e = joint.estimate
    return {"value": e.value("clock.delay"), "std": float(e.std[e.names.index("clock.delay")])}


def _sizes(errors: np.ndarray | None) -> dict[str, float] | None:
    if errors is None:
        return None
    return {
        "mean": float(np.nanmean(errors)),
        "rms": float(np.sqrt(np.nanmean(errors**2))),
        "max": float(np.nanmax(errors)),
    }


def _two_step(two: TwoStepFit | None, fitted: RobotPictures, unseen: RobotPictures) -> dict[str, float] | None:
    if two is None or fitted.truth is None or unseen.truth is None:
        return None
    predicted = two.positions(unseen.actuators)
    return {
        "centres": float(np.mean(aligned_errors(two.centres, fitted.truth))),
        "centres_scaled": float(np.mean(aligned_errors(two.centres, fitted.truth, scale=True))),
        "held_out": float(np.nanmean(aligned_errors(predicted, unseen.truth))),
        "held_out_scaled": float(np.nanmean(aligned_errors(predicted, unseen.truth, scale=True))),
    }


def _unknowns(joint: JointFit) -> list[dict[str, Any]]:
    u, e = joint.side.unknowns, joint.estimate
    rows = []
    for name, unit, start in zip(u.names, u.units, u.start.tolist(), strict=True):
        key = f"robot.{name}"
        low, high = e.interval(key)
        std = float(e.std[e.names.index(key)])
        rows.append({"name": name, "unit": unit, "start": start, "value": e.value(key), "std": std,
                     "interval_95": [low, high]})  # fmt: skip
    return rows


def _cameras(joint: JointFit) -> list[dict[str, Any]]:
    e, rows = joint.estimate, []
    names = list(e.names)
    for k, camera in enumerate(joint.pictures.cameras):
        values = joint.camera_of(camera)
        corners = joint.pictures.camera == k
        residuals = joint.residuals[corners]
        row: dict[str, Any] = {"name": camera}
        for name in CAMERA:
            key = f"{camera}.{name}"
            row[name] = {"value": values[name], "std": float(e.std[names.index(key)]) if key in names else None}
        row["rms_pixel"] = float(np.sqrt(np.mean(residuals**2)))
        row["noise_ratio"] = float(np.sqrt(np.mean((residuals / joint.pictures.sigma[corners, None]) ** 2)))
        rows.append(row)
    return rows


def _table(joint: JointFit) -> str:
    """Return all parameters with their standard deviations as CSV text; "held" for those not estimated."""
    lines = ["# calibrated parameters; metres, pixels, quaternions scalar first, from camera to base", "name,value,std"]
    if joint.pictures.synthetic:
        lines.insert(0, f"# {joint.pictures.synthetic}")
    lines += [f'"{u["name"]}",{u["value"]:.10g},{u["std"]:.4g}' for u in _unknowns(joint)]
    for row in _cameras(joint):
        for name in CAMERA:
            std = row[name]["std"]
            lines.append(f"{row['name']}.{name},{row[name]['value']:.10g},{'held' if std is None else f'{std:.4g}'}")
    return "\n".join([*lines, ""])


def _corners(p: RobotPictures) -> str:
    return corners_csv(corner_rows(p), p.synthetic.removeprefix("synthetic, "))


def _figures(
    joint: JointFit, positions: np.ndarray, covariance: np.ndarray, title: str
) -> Mapping[str, Callable[[], Any]]:
    return {
        "residuals": partial(_residuals, joint, title),
        "workspace": partial(_ellipsoids, positions, covariance, title),
    }


def _in_space(
    robot: Model, joint: JointFit, positions: np.ndarray, covariance: np.ndarray, title: str
) -> view.RobotScene:  # fmt: skip
    """Cameras with the part of their pictures that shows the target, fitted poses by the cameras that see them, and
    predicted errors of held-out positions."""
    p = joint.pictures
    T = joint.positions(p.actuators)
    sees = [np.unique(p.pose[p.camera == k]) for k in range(len(p.cameras))]
    labels = [" and ".join(n for n, poses in zip(p.cameras, sees, strict=True) if k in poses) for k in range(len(T))]
    shown = [k for k in range(len(T)) if labels[k] and np.isfinite(T[k]).all()]
    bodies = view.groups(T[shown], [f"seen by {labels[k]}" for k in shown])
    for k, name in enumerate(p.cameras):
        c, uv = joint.camera_of(name), p.uv[p.camera == k]
        (left, top), (right, bottom) = uv.min(axis=0), uv.max(axis=0)
        corners = [(left, top), (right, top), (right, bottom), (left, bottom)]
        rays = [((u - c["cx"]) / c["fx"], (v - c["cy"]) / c["fy"], 1.0) for u, v in corners]  # without distortion
        R = quaternion_matrix(np.array([c[f"q{n}"] for n in "wxyz"]))
        centre = np.array([c[n] for n in "xyz"])
        depth = float(np.median((T[sees[k]] - centre) @ R[:, 2]))
        bodies += [view.frustum(rays, R, centre, depth, name=name, colour=COLOURS[k % len(COLOURS)]),
                   view.dots(centre[None], marker="square", name=f"camera {name}", colour="#000000")]  # fmt: skip
    drawn, note = view.ellipsoids(positions, covariance)
    note = f"{note} Pyramids: what the cameras see of the target. The robot is drawn before calibration."
    return view.around(robot, [*bodies, *drawn], title=title, note=note.strip())


def _residuals(joint: JointFit, title: str) -> Any:
    from ...plot.cameras import residuals_figure

    p = joint.pictures
    drawn = {name: (p.uv[p.camera == k], joint.residuals[p.camera == k]) for k, name in enumerate(p.cameras)}
    return residuals_figure(drawn, title=f"{title}: residuals over the picture")


def _ellipsoids(positions: np.ndarray, covariance: np.ndarray, title: str) -> Any:
    from ...plot.cameras import ellipsoids_figure

    return ellipsoids_figure(positions, covariance, title=f"{title}: predicted errors")


def _places(rows: list[dict[str, Any]], title: str) -> Any:
    from ...plot.cameras import places_figure

    return places_figure(rows, title=title)
