"""Closed-loop validation: the identified model, simulated from the reference, against the measured motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..lang import Model, ModelError
from ..measurements import Session, derivative
from ..results import ArgumentError, Check, Row, Trajectory, TrajectoryError, Work, at_most, naming
from ..simulation import simulate
from .options import ClosedLoop


@dataclass(frozen=True)
class ClosedLoopRun:
    """One recording: the signals "measured" and "simulated" are the position at the same instants.

    The loop corrects the position, so compare the efforts too: "measured_effort" and "simulated_effort".
    """

    name: str
    trajectory: Trajectory

    @property
    def errors(self) -> np.ndarray:
        """Simulated minus measured position (n, ...) [its unit]."""
        return self.trajectory["simulated"] - self.trajectory["measured"]

    @property
    def rms(self) -> float:
        """Root mean square of the errors [unit of the position]."""
        return float(np.sqrt(np.mean(self.errors**2)))

    @property
    def maximum(self) -> float:
        """Largest absolute error [unit of the position]."""
        return float(np.max(np.abs(self.errors)))

    @property
    def relative(self) -> float:
        """rms error over the standard deviation of the measured position."""
        return self.rms / float(np.std(self.trajectory["measured"]))

    @property
    def effort(self) -> float:
        """rms error of the effort over the rms of the measured one."""
        errors = self.trajectory["simulated_effort"] - self.trajectory["measured_effort"]
        return float(np.linalg.norm(errors) / np.linalg.norm(self.trajectory["measured_effort"]))


def follow(
    loop: ClosedLoop,
    parameters: Mapping[str, float],
    sessions: Sequence[Session],
    position: str,
    effort: str,
    work: Work,
) -> list[ClosedLoopRun]:
    """Simulate every recording from its first row, starting at the measured position and velocity.

    sessions: corrected, with the position, the effort and the inputs of the loop. Raises ArgumentError if the
    simulation fails.
    """
    values = _gathered(parameters)
    with naming("closed_loop.model", ModelError):
        model = loop.model.with_(**values) if isinstance(loop.model, Model) else loop.model(**values)
    runs = []
    for n, session in enumerate(sessions):
        raw = session.trajectory
        rows = slice(None, None, loop.every)
        time = raw.time[rows] - raw.time[0]
        inputs = {}
        for name in loop.inputs:
            signal = Trajectory(time, {name: raw[name][rows]}, {name: raw.unit(name)})
            inputs[name] = (signal, "cubic")
        start = {position: raw[position][0], f"der({position})": _first_rate(raw[position], session.sample_time)}

        def progress(instant: float, n: int = n, end: float = float(time[-1])) -> bool:
            work.progress("simulating in closed loop", (n + instant / end) / len(sessions), {"time_s": instant})
            return work.interrupted()

        with naming("closed_loop", ModelError, TrajectoryError):
            simulation = simulate(
                model,
                float(time[-1]),
                inputs=inputs,
                start=start,
                step=float(time[-1]) / (len(time) - 1),
                tolerance=loop.tolerance,
                outputs=[effort],
                progress=progress,
                throw=False,
            )
        count = len(simulation.trajectory)
        if not simulation.status.ok and count < 2:
            raise ArgumentError(f"the closed loop could not be simulated: {simulation.message}", "closed_loop")
        signals = {
            "measured": raw[position][rows][:count],
            "simulated": simulation.trajectory[position],
            "measured_effort": raw[effort][rows][:count],
            "simulated_effort": simulation.trajectory[effort],
        }
        units = dict(zip(signals, [raw.unit(position)] * 2 + [raw.unit(effort)] * 2, strict=True))
        runs.append(ClosedLoopRun(session.name, Trajectory(time[:count], signals, units, synthetic=raw.synthetic)))
    return runs


def rows_of(runs: Sequence[ClosedLoopRun]) -> list[Row]:
    """Rows of the table."""
    rows = []
    for run in runs:
        unit = run.trajectory.unit("measured")
        label = "closed loop, simulated from the reference" + (f", {run.name}" if len(runs) > 1 else "")
        rows += [Row(f"{label}: error rms", run.rms, unit), Row("largest", run.maximum, unit)]
        rows += [Row("of the motion", 100 * run.relative, "%"), Row("error of its effort", 100 * run.effort, "%")]
    return rows


def within_bound(loop: ClosedLoop | None, runs: Sequence[ClosedLoopRun]) -> dict[str, Check]:
    """Check of the largest rms error against the bound of the loop, if it has one."""
    if loop is None or loop.bound is None or not runs:
        return {}
    return {"closed_loop_error": at_most(max(run.rms for run in runs), loop.bound)}


def _first_rate(position: np.ndarray, sample_time: float) -> np.ndarray | float:
    """Velocity at the first row, from a parabola through the first rows."""
    return derivative(position[:3], sample_time)[0]


def _gathered(parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Entries "m_c[0]", "m_c[1]" as one list "m_c"."""
    arrays: dict[str, Any] = {}
    for name, value in parameters.items():
        base, bracket, _ = name.partition("[")
        if bracket:
            arrays.setdefault(base, []).append(value)
        else:
            arrays[name] = value
    return arrays
