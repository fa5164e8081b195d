"""Kind "wrench_calibration": what a force sensor reads without contact, so that only contact is left."""

from __future__ import annotations

from gtmodel.control.lead_through import SyntheticReadings, wrench_study
from gtmodel.problem_files.base import Context, InputError
from gtmodel.problem_files.call import Call
from gtmodel.problem_files.from_options import options_of
from gtmodel.results import Trajectory, TrajectoryError

from .keys import Schema

NAME = "wrench_calibration"
ARGUMENTS = {
    "readings": "readings.file", "pushes": "readings.pushes", "force_noise": "readings.force_noise_N",
    "moment_noise": "readings.moment_noise_Nm", "turns": "readings.file", "forces": "readings.file",
    "moments": "readings.file", "drift": "readings.drift", "accept": "readings.accept", "time": "readings.file",
}  # fmt: skip


def call(problem: Schema, context: Context) -> Call:
    """The study of measured or synthetic readings."""
    if context.start is not None:
        raise InputError("--start: nothing is solved from a start here; leave it out")
    measured, synthetic = problem.readings, problem.synthetic
    if (measured is None) == (synthetic is None):
        both = "both" if measured is not None else "none of them"
        raise InputError(f"expected one of [readings] and [synthetic]; found {both}", "readings")
    if synthetic is not None:
        sensor = options_of(synthetic, "sensor")["sensor"]
        return Call(wrench_study, SyntheticReadings(**synthetic.given(), sensor=sensor), title=problem.title)
    assert measured is not None
    readings = _read(measured.file, "readings.file", context)
    pushes = None if measured.pushes is None else _read(measured.pushes, "readings.pushes", context)
    return Call(
        wrench_study, readings, pushes, force_noise=measured.force_noise_N, moment_noise=measured.moment_noise_Nm,
        drift=measured.drift, accept=measured.accept, title=problem.title,
    )  # fmt: skip


def _read(name: str, key: str, context: Context) -> Trajectory:
    try:
        return Trajectory.from_csv(context.file(name, key, "readings"))
    except TrajectoryError as error:
        raise InputError(str(error), key) from error


def explain(problem: Schema, context: Context) -> str:
    """What is read, and what is asked."""
    lines = [f"{problem.title or NAME}: bias, mass and centre of a force sensor's load"]
    if problem.synthetic is not None:
        given = problem.synthetic.given()
        lines.append(f"  {given['poses']} poses at rest and {given['pushes']} pushes, synthetic, seed {given['seed']}")
    if problem.readings is not None:
        lines.append(f"  readings of {problem.readings.file}")
    return "\n".join(lines)
