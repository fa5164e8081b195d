"""The keys of kind "wrench_calibration"."""

from __future__ import annotations

from pydantic import Field, PositiveFloat

from gtmodel.control.lead_through.options import SyntheticReadings, WrenchAlarm
from gtmodel.control.lead_through.synthetic_sensor import SyntheticSensor
from gtmodel.problem_files.base import FileSection, Problem
from gtmodel.problem_files.from_options import Made, made_from

RESULT = "gtmodel.control.lead_through.WrenchStudy"


@made_from(SyntheticReadings, "sensor")
class SyntheticWrenches(Made):
    """Synthetic readings, with the sensor as it truly is."""

    sensor: Made[SyntheticSensor] = Made[SyntheticSensor].left_out()


class ReadingsSection(FileSection):
    """Measured readings: CSV files with the columns time, turn[0..2] (rotation vector of the sensor's axes in the world
    frame), force[0..2] and moment[0..2], each with its unit."""

    file: str = Field(description="readings at rest and free of contact, a row for each pose")
    pushes: str | None = Field(default=None, description="readings while a fixed point presses where forces are to act")
    force_noise_N: PositiveFloat | None = Field(
        default=None, description="standard deviation of a reading; the residuals give it if left out"
    )
    moment_noise_Nm: PositiveFloat | None = Field(default=None, description="standard deviation of a reading")
    drift: bool = Field(default=False, description="estimate a linear drift of the biases over the recording too")
    accept: list[WrenchAlarm] = Field(
        default_factory=list, description="alarms about the readings that are notes and fail nothing"
    )


class Schema(Problem):
    """Bias, mass and centre of what a force sensor carries, from readings at rest in several poses, with intervals, and
    the lever arm to where forces act."""

    readings: ReadingsSection | None = Field(default=None, description="measured; in place of [synthetic]")
    synthetic: SyntheticWrenches | None = Field(default=None, description="in place of [readings]")
