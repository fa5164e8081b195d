"""The pictures of a milling problem."""

from __future__ import annotations

from typing import Any

import numpy as np

from gtmodel.milling import Lobes

from .milling_keys import Schema
from .milling_printed import Printed
from .milling_search import Found
from .milling_task import Task, title_of

SPEEDS = 121  # of the lobes, each proven


def angle(problem: Schema, f: Found) -> Any:
    """Both indices over the angle."""
    from gtmodel.plot.milling import angle_figure

    place, n = f.place, len(f.place.sweep.angles)
    frequency, peak, marks = np.full((n, 3), np.nan), np.full(n, np.nan), {}
    if place.dynamics is not None and f.findings is not None:
        frequency[place.dynamics.rows] = place.dynamics.oscillators.frequency
        peak = f.peak
        marks = {"static choice": place.sweep.angles[f.findings.choices[0]], "dynamic choice": f.angle}
    else:
        marks = {"static choice": place.sweep.angles[int(np.nanargmin(place.static))]}
    tooth = [f.task.speed * f.task.cutter.teeth * n for n in range(1, 6)]
    return angle_figure(place.sweep.angles, place.static, peak, frequency, tooth, reachable=place.sweep.reachable,
                        choices=marks, title=title_of(problem, f.task))  # fmt: skip


def printed_tests(p: Printed) -> Any:
    """Predicted beside measured."""
    from gtmodel.plot.milling import tests_figure

    title = "Tests of Cvitanic 2021: predicted from Table 16, measured in Table 5"
    return tests_figure(p.tooth_hz, p.mean_mm, p.measured_mean_mm, p.chosen_by, title=title)


def lobes_of(problem: Schema, task: Task, lobes: Lobes) -> Any:
    """Stability over the declared speeds."""
    from gtmodel.plot.milling import lobes_figure

    assert problem.lobes is not None
    speed = np.linspace(problem.lobes.from_rpm, problem.lobes.to_rpm, SPEEDS) / 60
    title = f"{title_of(problem, task)}: stability"
    return lobes_figure(speed, lobes.depth_at(speed), (task.speed, task.cut.axial_depth), title=title)
