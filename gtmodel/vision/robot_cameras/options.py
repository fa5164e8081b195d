"""What a calibration of a robot together with cameras is asked for, and what it gives back."""

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
    """One camera as it is known before.

    >>> camera = gt.vision.robot_cameras.CameraStart("left", width_pixel=1600.0, height_pixel=1200.0)
    >>> camera.start[:4]
    [1600.0, 1600.0, 799.5, 599.5]
    """

    name: Annotated[str, "as the table of corners calls it"]
    width_pixel: Annotated[float, Within(above=0.0), "of the picture"]
    height_pixel: Annotated[float, Within(above=0.0), "of the picture"]
    focal_pixel: Annotated[float | None, Within(above=0.0), "focal length; the width if left out"] = None
    principal_point_pixel: Annotated[list[float] | None, Long(2), "the middle of the picture if left out"] = None
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
    """How a robot and its cameras are calibrated together.

    >>> gt.vision.robot_cameras.RobotCameras(scale="tape")
    Traceback (most recent call last):
    gtmodel...: scale: expected one of target, actuators, second_device; found 'tape'...
    """

    mounted: Annotated[
        Literal["fixed", "plate"], "fixed: cameras look at a target on the tool; plate: they look at one that stands"
    ] = "fixed"
    estimate: Annotated[list[Estimated], "of each camera; what is not named is held as given"] = field(
        default_factory=lambda: ["focal", "principal_point", "distortion"]
    )
    scale: Annotated[
        Literal["target", "actuators", "second_device"],
        "what gives metres: target: its dimensions are known; actuators: their displacement, with the target's size "
        "free; second_device: positions measured at some poses",
    ] = "target"
    hold: Annotated[
        list[str] | None,
        "parameters of the robot that define its base frame, and under the scale actuators its unit; if left out those "
        "of the last guideway of three, and of another robot the first camera stays where it starts",
    ] = None
    late: Annotated[
        bool,
        "pictures of a moving robot come late: they show actuators at reading + delay x rate, and the delay is "
        "estimated; needs rates",
    ] = False
    fixed: Annotated[list[str], "other parameters of the robot that are known"] = field(default_factory=list)
    actuator_noise: Annotated[
        float, Unit("m", written="um"), Within(above=0.0), "standard deviation of an actuator's reading"
    ] = 13e-6
    removal: Annotated[
        float, Within(least=0.0), "corners that are so many standard deviations off are removed and named; 0: none are"
    ] = 5.0
    quiet: Annotated[
        float, Within(above=0.0, below=1.0), "probability of a false alarm of the test of residuals over the picture"
    ] = 1e-3


@dataclass(frozen=True)
class SyntheticRobotCameras(Options):
    """Two cameras (or one) in front of a robot whose tool carries five squares and does not turn. Synthetic.

    The thesis prints neither focal length nor baseline nor distance: cameras and volume are those of our simulations.

    >>> gt.vision.robot_cameras.SyntheticRobotCameras(seed=3).words
    'synthetic, seed 3, noise 0.1 pixel and 13 um, parameters 10 mm off'
    """

    centre: Annotated[list[float], Unit("m"), Long(3), "of the volume"] = field(
        default_factory=lambda: [1.42, -0.44, 0.97]
    )
    size: Annotated[list[float], Unit("m"), Long(3), "of the volume along x, y, z"] = field(
        default_factory=lambda: [1.2, 0.8, 1.0]
    )
    counts: Annotated[list[int], Within(least=2, most=30), Long(3), "grid points along x, y, z"] = field(
        default_factory=lambda: [8, 6, 6]
    )
    poses: Annotated[int | None, Within(least=8), "of the grid, drawn at random; all if left out"] = None
    cameras: Annotated[int, Within(least=1, most=2), "how many"] = 2
    mounted: Annotated[Literal["fixed", "plate"], "fixed cameras and a target on the tool, or the other way"] = "fixed"
    focal_pixel: Annotated[float, Within(above=0.0), "focal length"] = 1400.0
    width_pixel: Annotated[float, Within(above=0.0), "of the picture"] = 1600.0
    height_pixel: Annotated[float, Within(above=0.0), "of the picture"] = 1200.0
    distortion: Annotated[list[float], Long(5), "k1, k2, p1, p2, k3"] = field(
        default_factory=lambda: [-0.1, 0.05, 2e-4, -3e-4, 0.0]
    )
    baseline: Annotated[float, Unit("m"), Within(above=0.0), "distance of the two cameras, along y"] = 1.5
    distance: Annotated[float, Unit("m"), Within(above=0.0), "of the cameras from the middle, along x"] = 3.2
    side: Annotated[float, Unit("m", written="mm"), Within(above=0.0), "of each square"] = 0.04
    pixel_noise: Annotated[float, Within(least=0.0), "standard deviation of a corner's coordinate, pixel"] = 0.1
    actuator_noise: Annotated[float, Unit("m", written="um"), Within(least=0.0), "standard deviation"] = 13e-6
    robot_error: Annotated[
        float, Unit("m", written="mm"), Within(least=0.0),
        "standard deviation of the error of each parameter as it was known before; of directions as much per metre",
    ] = 0.01  # fmt: skip
    turned_pictures: Annotated[
        list[int], "numbers of poses, from 0, whose left picture is counted from the other end"
    ] = field(default_factory=list)
    wrong_corners: Annotated[float, Within(least=0.0, below=0.5), "share of corners that are 2 to 20 pixels off"] = 0.0
    delay: Annotated[float, Unit("s", written="ms"), "of the pictures behind the actuators' readings"] = 0.0
    speed: Annotated[float, Unit("m/s"), Within(least=0.0), "standard deviation of the actuators' rates"] = 0.0
    second_device: Annotated[int, Within(least=0), "poses whose position a second device measures, within 10 um"] = 0
    seed: Annotated[int, Within(least=0), "of robot, grid and noise"] = 1
    noise_seed: Annotated[int | None, Within(least=0), "of the noise alone, for repeated runs of one robot"] = None

    @property
    def words(self) -> str:
        """Seed and noise."""
        return (
            f"synthetic, seed {self.seed}, noise {self.pixel_noise:g} pixel and {1e6 * self.actuator_noise:g} um, "
            f"parameters {1e3 * self.robot_error:g} mm off"
        )


@dataclass(frozen=True)
class CameraPlaces(Options):
    """Places of two cameras that are compared.

    >>> gt.vision.robot_cameras.CameraPlaces(baselines=[1.0, 2.0]).distances
    [2.4, 3.2, 4.0]
    """

    baselines: Annotated[list[float], Unit("m"), Within(above=0.0), "distances of the two cameras"] = field(
        default_factory=lambda: [0.5, 1.0, 1.5, 2.0]
    )
    distances: Annotated[list[float], Unit("m"), Within(above=0.0), "of the cameras from the middle"] = field(
        default_factory=lambda: [2.4, 3.2, 4.0]
    )


Table = Sequence[Mapping[str, Any]] | None
Numbers = Mapping[str, float] | None


@to_inherit
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class RobotCamerasStudy(Study):
    """Robot and cameras calibrated together, errors on poses that no fit saw, and whether the pictures fit; or the
    places of cameras that were compared."""

    unknowns: Annotated[Table, Quantity("",
        "for each free parameter of the robot: name, unit, start, value, std and interval_95, in SI units",
    )] = None  # fmt: skip
    cameras: Annotated[Table, Quantity("",
        "for each camera: name, then by parameter its value and std; pixels, metres, quaternion scalar first, from "
        "camera to base; rms_pixel of its residuals and noise_ratio, these over the stated sigma",
    )] = None  # fmt: skip
    poses: Annotated[Numbers, Quantity("", "number of poses fitted and held out, and of corners used and given")] = None
    removed_pictures: Annotated[Sequence[str] | None, "pictures that were wrong as a whole"] = None
    removed_poses: Annotated[
        Sequence[str] | None, "poses none of whose pictures belongs to their row of the actuators"
    ] = None
    removed_corners: Annotated[Sequence[str] | None, "single corners far off"] = None
    held_out_pixel: Annotated[float | None, Quantity("",
        "1.48 times the median of |residual| of held-out corners, at the poses that the calibrated robot predicts",
    )] = None  # fmt: skip
    held_out: Annotated[Numbers, Quantity("m",
        "mean, rms and max error of held-out positions against the truth of synthetic pictures, once the frame of the "
        "true positions is laid through them", written="mm",
    )] = None  # fmt: skip
    two_step: Annotated[Numbers, Quantity("m",
        "in two steps: mean error of the intersected target (centres) and of held-out positions (held_out), and "
        "both once their scale is fitted to the true positions too (centres_scaled, held_out_scaled)", written="mm",
    )] = None  # fmt: skip
    delay: Annotated[Numbers, Quantity("s",
        "how late pictures are behind the actuators' readings, value and std; null where it was not estimated",
        written="ms",
    )] = None  # fmt: skip
    predicted: Annotated[float | None, Quantity("m",
        "rms error over the held-out positions that noise leaves, predicted from the covariance", written="mm",
    )] = None  # fmt: skip
    picture_radius: Annotated[Numbers, "by camera: probability by chance of residuals along the radius"] = None
    picture_quadratic: Annotated[Numbers, "by camera: likewise of a quadratic map in u and v"] = None
    places: Annotated[Table, Quantity("",
        "of a plan: baseline_m, distance_m, rms_mm and max_mm predicted, focal_std_pixel, and why where there is none; "
        "the best first",
    )] = None  # fmt: skip
    synthetic: Annotated[str | None, "seed and noise of synthetic pictures; null for measured ones"] = None

    @property
    def rows(self) -> list[Row]:
        """The table for people."""
        rows: list[Row] = []
        if self.poses is not None:
            p = self.poses
            rows.append(Row("poses fitted, held out", f"{p['fitted']:g}, {p['held_out']:g}"))
            rows.append(Row("corners used", f"{p['corners']:g} of {p['corners_given']:g}"))
        for c in self.cameras or ():
            f = c["fx"]
            said = f"{f['value']:.2f} +- {f['std']:.2g}" if f["std"] else f"{f['value']:.2f} (held)"
            rows.append(Row(f"focal length of {c['name']}", said, "pixel"))
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
            said = r["why"] or f"{r['rms_mm']:.4g} rms, {r['max_mm']:.4g} at worst"
            rows.append(
                Row(f"baseline {r['baseline_m']:g} m, distance {r['distance_m']:g} m", said, "" if r["why"] else "mm")
            )
        return rows + ([Row("SYNTHETIC", self.synthetic)] if self.synthetic else [])
