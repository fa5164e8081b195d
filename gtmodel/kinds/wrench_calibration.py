"""Kind "wrench_calibration": readings of a force sensor without contact, to subtract them from contact forces."""

from __future__ import annotations

from pydantic import Field, PositiveFloat

from gtmodel.control import lead_through
from gtmodel.control.lead_through.options import SyntheticReadings, WrenchAlarm
from gtmodel.control.lead_through.scenes import SyntheticSensor
from gtmodel.problem_files.base import Call, Context, FileSection, InputError, Problem
from gtmodel.problem_files.from_options import Made, made_from, options_of
from gtmodel.results import Trajectory, TrajectoryError

RESULT = "gtmodel.control.lead_through.WrenchStudy"


@made_from(SyntheticReadings, "sensor")
class SyntheticWrenches(Made):
    """Synthetic readings of a sensor with known errors."""

    sensor: Made[SyntheticSensor] = Made[SyntheticSensor].left_out()


class ReadingsSection(FileSection):
    """Measured readings: CSV files with the columns time, turn[0..2] (rotation vector of the sensor's axes in the world
    frame), force[0..2] and moment[0..2], each with its unit."""

    file: str = Field(description="readings at rest without contact, a row for each pose")
    pushes: str | None = Field(
        default=None, description="readings during pushes of a fixed point against the contact point of the tool"
    )
    force_noise_N: PositiveFloat | None = Field(
        default=None, description="standard deviation of a force reading; from the residuals if left out"
    )
    moment_noise_Nm: PositiveFloat | None = Field(default=None, description="standard deviation of a moment reading")
    drift: bool = Field(default=False, description="also estimate a linear drift of the biases over the recording")
    accept: list[WrenchAlarm] = Field(
        default_factory=list, description="alarms about the readings that become notes instead of errors"
    )


class Schema(Problem):
    """Bias, mass and centre of mass of the load on a force sensor, from readings at rest in several poses, with
    intervals, and the lever arm to the contact point."""

    readings: ReadingsSection | None = Field(default=None, description="measured readings")
    synthetic: SyntheticWrenches | None = Field(default=None, description="synthetic readings")


ARGUMENTS = {
    "readings": "readings.file", "pushes": "readings.pushes", "force_noise": "readings.force_noise_N",
    "moment_noise": "readings.moment_noise_Nm", "turns": "readings.file", "forces": "readings.file",
    "moments": "readings.file", "drift": "readings.drift", "accept": "readings.accept", "time": "readings.file",
}  # fmt: skip


def call(problem: Schema, context: Context) -> Call:
    """Return the call of the study of measured or synthetic readings."""
    if context.start is not None:
        raise InputError("--start: this kind does not use an earlier result; leave it out")
    measured, synthetic = problem.readings, problem.synthetic
    if (measured is None) == (synthetic is None):
        present = "both" if measured is not None else "neither"
        raise InputError(f"expected one of [readings] and [synthetic]; found {present}", "readings")
    if synthetic is not None:
        sensor = options_of(synthetic, "sensor")["sensor"]
        return Call(
            lead_through.wrench_study, SyntheticReadings(**synthetic.given(), sensor=sensor), title=problem.title
        )
    assert measured is not None
    readings = _read(measured.file, "readings.file", context)
    pushes = None if measured.pushes is None else _read(measured.pushes, "readings.pushes", context)
    return Call(
        lead_through.wrench_study, readings, pushes, force_noise=measured.force_noise_N,
        moment_noise=measured.moment_noise_Nm, drift=measured.drift, accept=measured.accept, title=problem.title,
    )  # fmt: skip


def _read(name: str, key: str, context: Context) -> Trajectory:
    try:
        return Trajectory.from_csv(context.file(name, key, "readings"))
    except TrajectoryError as error:
        raise InputError(str(error), key) from error


def explain(problem: Schema, context: Context) -> str:
    """Describe the readings."""
    lines = [f"{problem.heading}: bias, mass and centre of mass of a force sensor's load"]
    if problem.synthetic is not None:
        s = problem.synthetic.given()
        lines.append(f"  {s['poses']} poses at rest and {s['pushes']} pushes, synthetic, seed {s['seed']}")
    if problem.readings is not None:
        lines.append(f"  readings from {problem.readings.file}")
    return "\n".join(lines)
