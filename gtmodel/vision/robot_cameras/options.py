"""Options and result of a joint calibration of a robot and cameras."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

from ...results import Quantity, Row, Study
from ...results.options import Long, Options, Unit, Within
from ...results.study import to_inherit

Estimated = Literal["focal", "principal_point", "distortion"]


@dataclass(frozen=True)
class CameraStart(Options):
    """One camera as known before the calibration.

    >>> camera = gt.vision.robot_cameras.CameraStart("left", width_pixel=1600.0, height_pixel=1200.0)
    >>> camera.start[:4]
    [1600.0, 1600.0, 799.5, 599.5]
    """

    name: Annotated[str, "as in the table of corners"]
    width_pixel: Annotated[float, Within(above=0.0), "of the picture"]
    height_pixel: Annotated[float, Within(above=0.0), "of the picture"]
    focal_pixel: Annotated[float | None, Within(above=0.0), "focal length; the width if left out"] = None
    principal_point_pixel: Annotated[
        list[float] | None, Long(2), "principal point; the middle of the picture if left out"
    ] = None
    distortion: Annotated[list[float], Long(5), "k1, k2, p1, p2, k3 as OpenCV orders them"] = field(
        default_factory=lambda: [0.0] * 5
    )

    @property
    def start(self) -> list[float]:
        """fx, fy, cx, cy, k1, k2, p1, p2, k3."""
        f = self.focal_pixel or self.width_pixel
        middle = [(self.width_pixel - 1) / 2, (self.height_pixel - 1) / 2]
        return [f, f, *(self.principal_point_pixel or middle), *self.distortion]


@dataclass(frozen=True, kw_only=True)
class RobotCameras(Options):
    """Options of the joint calibration of a robot and its cameras.

    >>> gt.vision.robot_cameras.RobotCameras(scale="tape")
    Traceback (most recent call last):
    gtmodel...: scale: expected one of target, actuators, second_device; found 'tape'...
    """

    mounted: Annotated[
        Literal["fixed", "plate"],
        "fixed: fixed cameras observe a target on the tool; plate: cameras on the plate observe a fixed target",
    ] = "fixed"
    estimate: Annotated[list[Estimated], "estimated parameters of each camera; the others are held"] = field(
        default_factory=lambda: ["focal", "principal_point", "distortion"]
    )
    scale: Annotated[
        Literal["target", "actuators", "second_device"],
        "source of the scale: target: its known dimensions; actuators: their displacement, while the size of the "
        "target is free; second_device: positions measured at some poses",
    ] = "target"
    hold: Annotated[
        list[str] | None,
        "held parameters of the robot that define its base frame, and its unit if the actuators give the scale; if "
        "left out, those of the last of three guideways; for other robots the pose of the first camera is held instead",
    ] = None
    late: Annotated[
        bool,
        "estimate the delay of pictures of a moving robot: they show the actuators at reading + delay x rate; needs "
        "rates",
    ] = False
    fixed: Annotated[list[str], "other known parameters of the robot, which are held"] = field(default_factory=list)
    actuator_noise: Annotated[
        float, Unit("m", written="um"), Within(above=0.0), "standard deviation of an actuator's reading"
    ] = 13e-6
    removal: Annotated[
        float, Within(least=0.0), "standard deviations from which a corner is removed and named; 0: never"
    ] = 5.0
    quiet: Annotated[
        float,
        Within(above=0.0, below=1.0),
        "probability of a false alarm of the test for residuals that depend on the place in the picture",
    ] = 1e-3


@dataclass(frozen=True)
class SyntheticRobotCameras(Options):
    """Synthetic pictures by one or two cameras of a robot whose tool carries five squares and does not rotate.

    The thesis does not state focal length, baseline and distance; the default values are examples.

    >>> gt.vision.robot_cameras.SyntheticRobotCameras(seed=3).words
    'synthetic, seed 3, noise 0.1 pixel and 13 um, parameters 10 mm off'
    """

    centre: Annotated[list[float], Unit("m"), Long(3), "of the volume"] = field(
        default_factory=lambda: [1.42, -0.44, 0.97]
    )
    size: Annotated[list[float], Unit("m"), Long(3), "size of the volume along x, y, z"] = field(
        default_factory=lambda: [1.2, 0.8, 1.0]
    )
    counts: Annotated[list[int], Within(least=2, most=30), Long(3), "grid points along x, y, z"] = field(
        default_factory=lambda: [8, 6, 6]
    )
    poses: Annotated[int | None, Within(least=8), "poses of the grid, drawn at random; all if left out"] = None
    cameras: Annotated[int, Within(least=1, most=2), "number of cameras"] = 2
    mounted: Annotated[
        Literal["fixed", "plate"], "fixed: fixed cameras, target on the tool; plate: cameras on the plate, fixed target"
    ] = "fixed"
    focal_pixel: Annotated[float, Within(above=0.0), "focal length"] = 1400.0
    width_pixel: Annotated[float, Within(above=0.0), "of the picture"] = 1600.0
    height_pixel: Annotated[float, Within(above=0.0), "of the picture"] = 1200.0
    distortion: Annotated[list[float], Long(5), "k1, k2, p1, p2, k3"] = field(
        default_factory=lambda: [-0.1, 0.05, 2e-4, -3e-4, 0.0]
    )
    baseline: Annotated[float, Unit("m"), Within(above=0.0), "distance of the two cameras, along y"] = 1.5
    distance: Annotated[float, Unit("m"), Within(above=0.0), "distance of the cameras from the middle, along x"] = 3.2
    side: Annotated[float, Unit("m", written="mm"), Within(above=0.0), "of each square"] = 0.04
    pixel_noise: Annotated[float, Within(least=0.0), "standard deviation of a corner's coordinate, pixel"] = 0.1
    actuator_noise: Annotated[float, Unit("m", written="um"), Within(least=0.0), "standard deviation"] = 13e-6
    robot_error: Annotated[
        float, Unit("m", written="mm"), Within(least=0.0),
        "standard deviation of the error of each uncalibrated parameter; for directions, this error per metre",
    ] = 0.01  # fmt: skip
    turned_pictures: Annotated[
        list[int], "indices of poses, from 0, whose left picture is counted from the other end"
    ] = field(default_factory=list)
    wrong_corners: Annotated[float, Within(least=0.0, below=0.5), "share of corners that are 2 to 20 pixels off"] = 0.0
    delay: Annotated[float, Unit("s", written="ms"), "delay of the pictures relative to the actuator readings"] = 0.0
    speed: Annotated[float, Unit("m/s"), Within(least=0.0), "standard deviation of the actuators' rates"] = 0.0
    second_device: Annotated[
        int, Within(least=0), "number of poses measured by a second device, with a noise of 10 um"
    ] = 0
    seed: Annotated[int, Within(least=0), "of robot, grid and noise"] = 1
    noise_seed: Annotated[
        int | None, Within(least=0), "seed of the noise alone, for repeated runs with the same robot"
    ] = None

    @property
    def words(self) -> str:
        """Seed and noise as text."""
        return (
            f"synthetic, seed {self.seed}, noise {self.pixel_noise:g} pixel and {1e6 * self.actuator_noise:g} um, "
            f"parameters {1e3 * self.robot_error:g} mm off"
        )


@dataclass(frozen=True)
class CameraPlaces(Options):
    """Placements of two cameras to be compared.

    >>> gt.vision.robot_cameras.CameraPlaces(baselines=[1.0, 2.0]).distances
    [2.4, 3.2, 4.0]
    """

    baselines: Annotated[list[float], Unit("m"), Within(above=0.0), "distances of the two cameras"] = field(
        default_factory=lambda: [0.5, 1.0, 1.5, 2.0]
    )
    distances: Annotated[list[float], Unit("m"), Within(above=0.0), "distances of the cameras from the middle"] = field(
        default_factory=lambda: [2.4, 3.2, 4.0]
    )


Table = Sequence[Mapping[str, Any]] | None
Numbers = Mapping[str, float] | None


@to_inherit
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class RobotCamerasStudy(Study):
    """Jointly calibrated robot and cameras, errors on held-out poses, and tests of the residuals; or the compared
    placements of cameras."""

    unknowns: Annotated[Table, Quantity("",
        "for each free parameter of the robot: name, unit, start, value, std and interval_95, in SI units",
    )] = None  # fmt: skip
    cameras: Annotated[Table, Quantity("",
        "for each camera: name, then value and std of each parameter; pixels, metres, quaternion scalar first, from "
        "camera to base; rms_pixel of its residuals, and noise_ratio, their rms relative to the stated sigma",
    )] = None  # fmt: skip
    poses: Annotated[Numbers, Quantity("", "number of poses fitted and held out, and of corners used and in total")] = (
        None
    )
    removed_pictures: Annotated[Sequence[str] | None, "pictures that were wrong as a whole"] = None
    removed_poses: Annotated[Sequence[str] | None, "poses whose pictures all contradict the actuator readings"] = None
    removed_corners: Annotated[Sequence[str] | None, "single corners with gross errors"] = None
    held_out_pixel: Annotated[float | None, Quantity("",
        "1.48 times the median of |residual| of held-out corners, at the poses that the calibrated robot predicts",
    )] = None  # fmt: skip
    held_out: Annotated[Numbers, Quantity("m",
        "mean, rms and max error of held-out positions against the truth of synthetic pictures, after the best fit of "
        "the frame", written="mm",
    )] = None  # fmt: skip
    two_step: Annotated[Numbers, Quantity("m",
        "calibration in two steps: mean error of the intersected target (centres) and of held-out positions "
        "(held_out), and "
        "both after also fitting their scale to the true positions (centres_scaled, held_out_scaled)", written="mm",
    )] = None  # fmt: skip
    delay: Annotated[Numbers, Quantity("s",
        "delay of the pictures relative to the actuator readings, value and std; null if it was not estimated",
        written="ms",
    )] = None  # fmt: skip
    predicted: Annotated[float | None, Quantity("m",
        "rms error over the held-out positions due to noise, predicted from the covariance", written="mm",
    )] = None  # fmt: skip
    picture_radius: Annotated[Numbers, "by camera: p-value of the test for a radial pattern of the residuals"] = None
    picture_quadratic: Annotated[Numbers, "by camera: p-value of the test for a quadratic map in u and v"] = None
    places: Annotated[Table, Quantity("",
        "places of a plan: baseline_m, distance_m, predicted rms_mm and max_mm, focal_std_pixel, and why if "
        "there is no "
        "prediction; the best first",
    )] = None  # fmt: skip
    synthetic: Annotated[str | None, "seed and noise of synthetic pictures; null for measured ones"] = None

    @property
    def rows(self) -> list[Row]:
        """The rows of the printed table."""
        rows: list[Row] = []
        if self.poses is not None:
            p = self.poses
            rows.append(Row("poses fitted, held out", f"{p['fitted']:g}, {p['held_out']:g}"))
            rows.append(Row("corners used", f"{p['corners']:g} of {p['corners_given']:g}"))
        for c in self.cameras or ():
            f = c["fx"]
            text = f"{f['value']:.2f} +- {f['std']:.2g}" if f["std"] else f"{f['value']:.2f} (held)"
            rows.append(Row(f"focal length of {c['name']}", text, "pixel"))
            rows.append(Row(f"residuals of {c['name']}", f"{c['rms_pixel']:.4f}", "pixel rms"))
        if self.held_out_pixel is not None:
            rows.append(Row("held-out corners", f"{self.held_out_pixel:.4f}", "pixel"))
        if self.held_out is not None:
            rows.append(Row("held-out positions", f"{1e3 * self.held_out['mean']:.4g}", "mm mean"))
        if self.delay is not None:
            rows.append(
                Row("delay of the pictures", f"{1e3 * self.delay['value']:.4g} +- {1e3 * self.delay['std']:.2g}", "ms")
            )
        if self.predicted is not None:
            rows.append(Row("predicted from the covariance", f"{1e3 * self.predicted:.4g}", "mm rms"))
        if self.two_step is not None:
            rows.append(Row("in two steps", f"{1e3 * self.two_step['held_out']:.4g}", "mm mean"))
        for r in self.places or ():
            text = r["why"] or f"{r['rms_mm']:.4g} rms, {r['max_mm']:.4g} max"
            rows.append(
                Row(f"baseline {r['baseline_m']:g} m, distance {r['distance_m']:g} m", text, "" if r["why"] else "mm")
            )
        return rows + ([Row("SYNTHETIC", self.synthetic)] if self.synthetic else [])
