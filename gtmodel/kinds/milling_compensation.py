"""The compensated path of a milling problem: offsets against the deflection, and what they leave."""

from __future__ import annotations

from typing import Any

import numpy as np

from gtmodel.milling import Oscillators, compensate, cutting_force
from gtmodel.milling.deflection import duration
from gtmodel.problem_files.base import Check, InputError, Row, at_most

from .milling_keys import Schema
from .milling_task import Task, title_of

COLUMNS = "time_s,x_m,y_m,z_m,offset_x_m,offset_y_m,offset_z_m"  # compensated path, and what was added to it
FILE = "compensation.csv"
WORSE = "the compensation leaves more than it takes away: change compensation.bandwidth_Hz"
RATE = 4000.0  # samples per second of the simulation


def add(
    problem: Schema, task: Task, here: Oscillators, values: dict[str, Any], rows: list[Row], checks: dict[str, Check],
    figures: dict[str, Any], files: dict[str, str | bytes],
) -> None:  # fmt: skip
    """The tool enters the work; offsets against that force by both models, then what a robot can follow.

    What is written must leave less than the path without it.
    """
    c = problem.compensation
    assert c is not None
    try:
        seconds = duration(task.speed, c.seconds, c.entry_s)  # a whole turn after the entry at least
        F, step = cutting_force(task.cutter, task.cut, task.speed, task.feed, up=task.up, seconds=seconds, rate=RATE)
    except ValueError as error:
        raise InputError(str(error), "compensation.seconds") from error
    time = step * np.arange(len(F))
    F = F * np.clip(time / c.entry_s, 0, 1)[:, None]
    made = {}
    try:
        for name, model, bandwidth in (
            ("static", "static", None), ("dynamic", "dynamic", None),
            (f"dynamic, up to {c.bandwidth_Hz:g} Hz", "dynamic", c.bandwidth_Hz),
        ):  # fmt: skip
            made[name] = compensate(here, F, step, model=model, bandwidth=bandwidth)
    except ValueError as error:
        raise InputError(str(error), "compensation") from error
    followed = list(made.values())[-1]
    rms = [1e3 * followed.rms()[0], *(1e3 * x.rms()[1] for x in made.values())]
    values["compensation_rms_mm"] = rms
    checks["compensated_rms_mm"] = at_most(rms[-1], rms[0], WORSE)
    rows.append(Row("path not compensated, error rms", rms[0], "mm"))
    rows += [Row(f"path offset, {name}, error rms", x, "mm") for name, x in zip(made, rms[1:], strict=True)]
    at = np.arange(0.0, time[-1], c.cycle_s)
    offset = np.column_stack([np.interp(at, time, followed.offset[:, j]) for j in range(3)])
    along = task.feed / np.linalg.norm(task.feed)
    fast = task.cut.feed_per_tooth * task.cutter.teeth * task.speed
    path = np.array(problem.place_m) + fast * at[:, None] * along + offset
    table = np.column_stack([at, path, offset])
    lines = [",".join(f"{value:.9g}" for value in line) for line in table]
    files[FILE] = "\n".join([COLUMNS, *lines, ""])

    def figure() -> Any:
        from gtmodel.plot.milling import compensation_figure

        after = {name: np.linalg.norm(x.after, axis=1) for name, x in made.items()}
        title = f"{title_of(problem, task)}: compensation, by simulation"
        return compensation_figure(time, np.linalg.norm(followed.before, axis=1), after, title=title)

    figures["compensation"] = figure


__all__ = ["add"]
