"""Validation in closed loop: identified numbers, simulated from the reference, beside the measured motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic import Field, PositiveInt

from gtmodel.compiler.causal import flat_of
from gtmodel.lang import Model, ModelError
from gtmodel.measurements import Session, Signal, derivative
from gtmodel.problem_files import python_models
from gtmodel.problem_files.base import Check, Context, InputError, Row, Section, at_most
from gtmodel.problem_files.log_keys import MeasuredSignal
from gtmodel.results import Trajectory, TrajectoryError
from gtmodel.simulation import simulate

VALUES = {
    "closed_loop_rms": "error of the simulated motion, rms by recording, in the unit of the position",
    "closed_loop_maximum": "its largest size, by recording",
    "closed_loop_relative": "its rms over that of the motion itself, mean taken off, by recording",
    "closed_loop_effort": "rms error of the simulated efforts over the rms of the measured ones, unfiltered",
}


class ClosedLoop(Section):
    """Simulation of the controlled model from the measured reference, with the identified parameters."""

    model: str = Field(description="controlled model in Python, file.py:Class; takes [parameters] and what was found")
    inputs: dict[str, MeasuredSignal] = Field(description="its inputs by name, such as the reference")
    every: PositiveInt = Field(default=1, description="every how many-th sample of the inputs is used, cubic between")
    tolerance: float = Field(default=1e-7, ge=1e-14, le=1e-3, description="of the integrator, relative and absolute")
    bound: float | None = Field(default=None, gt=0, description="largest allowed rms error, SI; checked where given")

    def controlled(self, parameters: Mapping[str, Any], context: Context) -> Model:
        """The model with these parameters, arrays by their entries' names. Raises InputError."""
        return python_models.resolve(self.model, context, "closed_loop.model", _gathered(parameters))

    def signals(self, context: Context) -> dict[str, Signal]:
        """The inputs as measured signals, in the units of the model. Raises InputError."""
        flat = flat_of(python_models.resolve(self.model, context, "closed_loop.model"))
        found = {}
        for name, signal in self.inputs.items():
            key = f"closed_loop.inputs.{name}"
            try:
                unit = flat.variables[flat.lookup(name)[1][0]].unit
            except ModelError as error:
                raise InputError(str(error), key) from error
            for what in ("scale", "offset", "delay_s"):
                if getattr(signal, what) == "estimate":
                    raise InputError("the fit does not see this signal; give a number", f"{key}.{what}")
            found[name] = signal.signal(key, unit)
        return found


@dataclass(frozen=True)
class ClosedLoopRun:
    """One recording: the measured motion and the simulated one on the same times, as "measured" and "simulated".

    Position alone says little, for the loop corrects it: the efforts, "measured_effort" and "simulated_effort", are
    what it took.
    """

    name: str
    trajectory: Trajectory

    @property
    def errors(self) -> np.ndarray:
        return self.trajectory["simulated"] - self.trajectory["measured"]

    @property
    def rms(self) -> float:
        return float(np.sqrt(np.mean(self.errors**2)))

    @property
    def maximum(self) -> float:
        return float(np.max(np.abs(self.errors)))

    @property
    def relative(self) -> float:
        return self.rms / float(np.std(self.trajectory["measured"]))

    @property
    def effort(self) -> float:
        off = self.trajectory["simulated_effort"] - self.trajectory["measured_effort"]
        return float(np.linalg.norm(off) / np.linalg.norm(self.trajectory["measured_effort"]))


def follow(
    section: ClosedLoop,
    parameters: Mapping[str, Any],
    sessions: tuple[Session, ...],
    position: str,
    effort: str,
    context: Context,
) -> list[ClosedLoopRun]:
    """Simulate every recording from its first row, where the measured position and its velocity are the start.

    sessions : corrected, with the position, the effort and the inputs of the section. Raises InputError where it cannot
    be simulated.
    """
    model = section.controlled(parameters, context)
    runs = []
    for n, session in enumerate(sessions):
        raw = session.trajectory
        kept = slice(None, None, section.every)
        time = raw.time[kept] - raw.time[0]
        inputs = {}
        for name in section.inputs:
            given = Trajectory(time, {name: raw[name][kept]}, {name: raw.unit(name)})
            inputs[name] = (given, "cubic")
        start = {position: raw[position][0], f"der({position})": _first_rate(raw[position], session.sample_time)}

        def progress(at: float, n: int = n, end: float = float(time[-1])) -> bool:
            context.progress("simulating in closed loop", (n + at / end) / len(sessions), {"time_s": at})
            return context.interrupted()

        try:
            done = simulate(
                model,
                float(time[-1]),
                inputs=inputs,
                start=start,
                step=float(time[-1]) / (len(time) - 1),
                tolerance=section.tolerance,
                outputs=[effort],
                progress=progress,
                throw=False,
            )
        except (ModelError, TrajectoryError) as error:
            raise InputError(str(error), "closed_loop") from error
        rows = len(done.trajectory)
        if not done.status.ok and rows < 2:
            raise InputError(f"the closed loop could not be simulated: {done.message}", "closed_loop")
        found = {
            "measured": raw[position][kept][:rows],
            "simulated": done.trajectory[position],
            "measured_effort": raw[effort][kept][:rows],
            "simulated_effort": done.trajectory[effort],
        }
        units = dict(zip(found, [raw.unit(position)] * 2 + [raw.unit(effort)] * 2, strict=True))
        runs.append(ClosedLoopRun(session.name, Trajectory(time[:rows], found, units, synthetic=raw.synthetic)))
    return runs


def values_of(runs: list[ClosedLoopRun]) -> dict[str, Any]:
    """As `VALUES` announces them."""
    return {
        "closed_loop_rms": [run.rms for run in runs],
        "closed_loop_maximum": [run.maximum for run in runs],
        "closed_loop_relative": [run.relative for run in runs],
        "closed_loop_effort": [run.effort for run in runs],
    }


def rows_of(runs: list[ClosedLoopRun]) -> list[Row]:
    """Rows of the table."""
    rows = []
    for run in runs:
        unit = run.trajectory.unit("measured")
        label = "closed loop, simulated from the reference" + (f", {run.name}" if len(runs) > 1 else "")
        rows += [Row(f"{label}: error rms", run.rms, unit), Row("largest", run.maximum, unit)]
        rows += [Row("of the motion", 100 * run.relative, "%"), Row("error of its effort", 100 * run.effort, "%")]
    return rows


def checks_of(section: ClosedLoop, runs: list[ClosedLoopRun]) -> dict[str, Check]:
    """Against the section's bound, if it has one."""
    if section.bound is None:
        return {}
    worst = max(run.rms for run in runs)
    return {"closed_loop_error": at_most(worst, section.bound)}


def _first_rate(position: np.ndarray, sample_time: float) -> np.ndarray | float:
    """Velocity at the first row, by a parabola through the first rows."""
    return derivative(position[:3], sample_time)[0]


def _gathered(parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Entries "m_c[0]", "m_c[1]" as one list "m_c"."""
    found: dict[str, Any] = {}
    for name, value in parameters.items():
        base, bracket, _ = name.partition("[")
        if bracket:
            found.setdefault(base, []).append(value)
        else:
            found[name] = value
    return found
