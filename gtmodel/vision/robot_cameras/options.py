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
