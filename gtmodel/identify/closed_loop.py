"""Validation in closed loop: identified numbers, simulated from the reference, beside the measured motion."""

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
    """One recording: the measured motion and the simulated one on the same times, as "measured" and "simulated".

    Position alone says little, for the loop corrects it: the efforts, "measured_effort" and "simulated_effort", are
    what it took.
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
        """Largest error by size [unit of the position]."""
        return float(np.max(np.abs(self.errors)))

    @property
    def relative(self) -> float:
        """rms error over the standard deviation of the measured position."""
        return self.rms / float(np.std(self.trajectory["measured"]))

    @property
    def effort(self) -> float:
        """rms error of the effort over the rms of the measured one."""
        off = self.trajectory["simulated_effort"] - self.trajectory["measured_effort"]
        return float(np.linalg.norm(off) / np.linalg.norm(self.trajectory["measured_effort"]))


def follow(
    loop: ClosedLoop,
    parameters: Mapping[str, float],
    sessions: Sequence[Session],
    position: str,
    effort: str,
    work: Work,
) -> list[ClosedLoopRun]:
    """Simulate every recording from its first row, where the measured position and its velocity are the start.

    sessions: corrected, with the position, the effort and the inputs of the loop. Raises ArgumentError where it cannot
    be simulated.
    """
    given = _gathered(parameters)
    with naming("closed_loop.model", ModelError):
        model = loop.model.with_(**given) if isinstance(loop.model, Model) else loop.model(**given)
    runs = []
    for n, session in enumerate(sessions):
        raw = session.trajectory
        kept = slice(None, None, loop.every)
        time = raw.time[kept] - raw.time[0]
        inputs = {}
        for name in loop.inputs:
            given = Trajectory(time, {name: raw[name][kept]}, {name: raw.unit(name)})
            inputs[name] = (given, "cubic")
        start = {position: raw[position][0], f"der({position})": _first_rate(raw[position], session.sample_time)}

        def progress(at: float, n: int = n, end: float = float(time[-1])) -> bool:
            work.progress("simulating in closed loop", (n + at / end) / len(sessions), {"time_s": at})
            return work.interrupted()

        with naming("closed_loop", ModelError, TrajectoryError):
            done = simulate(
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
        rows = len(done.trajectory)
        if not done.status.ok and rows < 2:
            raise ArgumentError(f"the closed loop could not be simulated: {done.message}", "closed_loop")
        signals = {
            "measured": raw[position][kept][:rows],
            "simulated": done.trajectory[position],
            "measured_effort": raw[effort][kept][:rows],
            "simulated_effort": done.trajectory[effort],
        }
        units = dict(zip(signals, [raw.unit(position)] * 2 + [raw.unit(effort)] * 2, strict=True))
        runs.append(ClosedLoopRun(session.name, Trajectory(time[:rows], signals, units, synthetic=raw.synthetic)))
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
    """The largest error against the loop's bound, if it has one."""
    if loop is None or loop.bound is None or not runs:
        return {}
    return {"closed_loop_error": at_most(max(run.rms for run in runs), loop.bound)}


def _first_rate(position: np.ndarray, sample_time: float) -> np.ndarray | float:
    """Velocity at the first row, by a parabola through the first rows."""
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
