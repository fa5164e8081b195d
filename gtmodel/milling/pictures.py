"""The pictures of a milling study."""

from __future__ import annotations

from typing import Any

import numpy as np

from .angle_search import AngleSearch
from .lobes import Lobes
from .published_tests import PrintedTests
from .task import MillingTask

SPEEDS = 121  # of the lobes, each proven


def angle(f: AngleSearch) -> Any:
    """Both indices over the angle."""
    from ..plot.milling import angle_figure

    place, n = f.place, len(f.place.sweep.angles)
    frequency, peak, marks = np.full((n, 3), np.nan), np.full(n, np.nan), {}
    if place.dynamics is not None and f.findings is not None:
        frequency[place.dynamics.rows] = place.dynamics.oscillators.frequency
        peak = f.peak
        static = "static choice, given" if f.findings.static_row is not None else "static choice"
        marks = {static: place.sweep.angles[f.findings.choices[0]], "dynamic choice": f.angle}
    else:
        marks = {"static choice": place.sweep.angles[int(np.nanargmin(place.static))]}
    tooth = [f.task.speed * f.task.cutter.teeth * n for n in range(1, 6)]
    return angle_figure(place.sweep.angles, place.static, peak, frequency, tooth, reachable=place.sweep.reachable,
                        choices=marks, title=f.task.heading)  # fmt: skip


def printed_tests(p: PrintedTests) -> Any:
    """Predicted beside measured."""
    from ..plot.milling import tests_figure

    title = "Tests of Cvitanic 2021: predicted from Table 16, measured in Table 5"
    return tests_figure(p.tooth_hz, p.mean_mm, p.measured_mean_mm, p.chosen_by, title=title)


def lobes_of(task: MillingTask, lobes: Lobes, low: float, high: float) -> Any:
    """Stability over the declared speeds."""
    from ..plot.milling import lobes_figure

    speed = np.linspace(low, high, SPEEDS)
    title = f"{task.heading}: axial depth that is proven stable"
    return lobes_figure(speed, lobes.depth_at(speed), (task.speed, task.cut.axial_depth), title=title)
