"""What a calibration of a robot together with cameras is asked for."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Literal

from ...results.options import Long, Options, Unit, Within

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
