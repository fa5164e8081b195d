"""Kind "wrench_calibration": readings of a force sensor without contact, to subtract them from contact forces."""

from __future__ import annotations

from pydantic import Field, PositiveFloat

from gtmodel.control import lead_through
from gtmodel.control.lead_through.options import Drift, SyntheticReadings, WrenchAlarm
from gtmodel.control.lead_through.scenes import SyntheticSensor
from gtmodel.lang.units import UnitError
from gtmodel.measurements import RowJoin
from gtmodel.measurements.orientations import VECTOR, WORDS
from gtmodel.problem_files.base import Call, Context, FileSection, InputError, Problem
from gtmodel.problem_files.from_options import Made, made_from, options_of
from gtmodel.problem_files.keys import LogReading, RecordedSignalSection
from gtmodel.results import ArgumentError, Trajectory
from gtmodel.results.refusal import naming

RESULT = "gtmodel.control.lead_through.WrenchStudy"


@made_from(SyntheticReadings, "sensor")
class SyntheticWrenches(Made):
    """Synthetic readings of a sensor with known errors."""

    sensor: Made[SyntheticSensor] = Made[SyntheticSensor].left_out()


class SensorOrientation(RecordedSignalSection):
    """Columns of the orientation of the sensor's axes in the world frame."""

    representation: str = Field(default=VECTOR, description=WORDS)


class WrenchSignals(FileSection):
    """Columns of the signals; a signal that is left out has the column of its default and the unit of the header."""

    orientation: SensorOrientation | None = Field(
        default=None, description="orientation of the sensor's axes in the world frame; column turn if left out"
    )
    force: RecordedSignalSection | None = Field(default=None, description="three forces; column force if left out")
    moment: RecordedSignalSection | None = Field(default=None, description="three moments; column moment if left out")
    temperature: RecordedSignalSection | None = Field(default=None, description="temperature of the sensor, if known")


@made_from(RowJoin)
class PosesSection(Made[RowJoin]):
    """Orientations in files of their own, in the same format as the readings."""

    file: str = Field(description="orientations of the readings at rest")
    pushes: str | None = Field(default=None, description="orientations of the readings during pushes")


class ReadingsSection(LogReading):
    """Measured readings, a row for each pose, in a text, MATLAB or Parquet file or a bag."""

    file: str = Field(description="readings at rest without contact, a row for each pose")
    pushes: str | None = Field(
        default=None, description="readings during pushes of a fixed point against the contact point of the tool"
    )
    poses: PosesSection | None = Field(default=None, description="orientations in another file")
    signals: WrenchSignals = WrenchSignals.left_out()
    session: str | None = Field(default=None, description="column whose number distinguishes the recordings")
    force_noise_N: PositiveFloat | None = Field(
        default=None, description="standard deviation of a force reading; from the residuals if left out"
    )
    moment_noise_Nm: PositiveFloat | None = Field(default=None, description="standard deviation of a moment reading")
    drift: bool | Drift | list[Drift] = Field(
        default="none",
        description="drifts of the biases to estimate, one or several: linear in time, by session, with temperature; "
        "random_walk, of a size that is estimated, or blocks, for an irregular drift; true is linear, false none",
    )
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
    "session": "readings.session", "temperature": "readings.signals.temperature",
}  # fmt: skip
READ = {
    "representation": "readings.signals.orientation.representation", "time": "readings.time.column",
    "turn": "readings.signals.orientation", "join.tolerance": "readings.poses.tolerance_s",
    "join.number": "readings.poses.number",
    **{name: f"readings.signals.{name}" for name in ("force", "moment", "temperature")},
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
    apart = measured.poses
    readings = _read(measured, measured.file, None if apart is None else apart.file, "", context)
    pushes = None
    if measured.pushes is not None:
        if apart is not None and apart.pushes is None:
            raise InputError("is missing; name the orientations during the pushes", "readings.poses.pushes")
        pushes = _read(measured, measured.pushes, None if apart is None else apart.pushes, "pushes", context)
    return Call(
        lead_through.wrench_study, readings, pushes, force_noise=measured.force_noise_N,
        moment_noise=measured.moment_noise_Nm, drift=measured.drift, accept=measured.accept, title=problem.title,
    )  # fmt: skip


def _read(keys: ReadingsSection, name: str, poses: str | None, part: str, context: Context) -> Trajectory:
    """Return the readings of the poses at rest, or of the pushes (part). Raises InputError."""
    key = f"readings.{part or 'file'}"
    linear = keys.drift is True or keys.drift == "linear" or (isinstance(keys.drift, list) and "linear" in keys.drift)
    if linear and not keys.time.column and keys.sample_time_s is None:
        raise InputError("is missing; a drift in time needs it without a time column", "readings.sample_time_s")
    path = context.file(name, key, "readings" if not part else key, source=keys.source)
    place = f"readings.poses.{part or 'file'}"
    other = None if poses is None else context.file(poses, place, place, source=keys.source)
    with naming(READ | {"": key}, ArgumentError, UnitError, refusal=InputError):
        return lead_through.read_wrenches(
            path, _form(keys, part), other, None if keys.poses is None else keys.poses.options()
        )


def _form(keys: ReadingsSection, part: str) -> lead_through.WrenchForm:
    signals = keys.signals
    declared = {"turn": signals.orientation, "force": signals.force, "moment": signals.moment}
    declared |= {} if part else {"temperature": signals.temperature}
    time = keys.time.declared()
    return lead_through.WrenchForm(
        {name: section.recorded() for name, section in declared.items() if section is not None},
        VECTOR if signals.orientation is None else signals.orientation.representation,
        time if "time" in keys.model_fields_set else "header", None if part else keys.session, keys.sample_time_s,
        keys.late_rows, keys.empty_rows, keys.form(),
    )  # fmt: skip


def explain(problem: Schema, context: Context) -> str:
    """Describe the readings."""
    lines = [f"{problem.heading}: bias, mass and centre of mass of a force sensor's load"]
    if problem.synthetic is not None:
        s = problem.synthetic.given()
        lines.append(f"  {s['poses']} poses at rest and {s['pushes']} pushes, synthetic, seed {s['seed']}")
    if problem.readings is not None:
        lines.append(f"  readings from {problem.readings.file}")
    return "\n".join(lines)
