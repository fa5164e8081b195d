"""The keys of kind "calibration_plan"."""

from __future__ import annotations

from dataclasses import fields
from typing import Annotated, Literal

from pydantic import Field

from gtmodel.calibrate.options import Fit
from gtmodel.calibrate.plan import options
from gtmodel.calibrate.plan.task import Task
from gtmodel.problem_files.from_options import Made, made_from
from gtmodel.problem_files.robot_keys import RobotProblem

RESULT = "gtmodel.calibrate.PlanStudy"

MOVED = ("free", "fixed", "tied", "unit_quaternions", "sizes")


@made_from(options.Tracker)
class TrackerSection(Made):
    """A laser tracker, which measures a distance and two angles."""

    kind: Literal["laser_tracker"] = Field(description="which device")


@made_from(options.PatternCamera)
class CameraSection(Made):
    """A fixed camera that sees a pattern on the plate."""

    kind: Literal["camera"] = Field(description="which device")


@made_from(options.Wire)
class WireSection(Made):
    """A wire sensor, a bar or an interferometer: the distance of the tool centre point from one point."""

    kind: Literal["distance"] = Field(description="which device")


@made_from(options.Gauge)
class GaugeSection(Made):
    """A dial gauge over a plane, or one coordinate: the height of the tool centre point above a known plane."""

    kind: Literal["plane"] = Field(description="which device")


@made_from(Fit, *(f.name for f in fields(Fit) if f.name not in MOVED))
class _Moved(RobotProblem, Made):
    """Which parameters are to be calibrated."""

    device: Annotated[
        TrackerSection | CameraSection | WireSection | GaugeSection,
        Field(discriminator="kind", description="what measures"),
    ]


@made_from(Task, "robot", "device", "choice", "title")
class Schema(_Moved):
    """A calibration planned before anything is measured (Dressler 2012, Fig. 5.21)."""
