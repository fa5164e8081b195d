"""The search of a milling problem: angles, refinement, places, feeds and speeds, and what to do."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from gtmodel.milling import Deflection, Findings, Oscillators, choices, frequency_sensitivity, guideline
from gtmodel.problem_files.base import Context, InputError

from .milling_keys import Schema
from .milling_task import Better, Place, Task, deflections_of, place_of, refined, replace_oscillators


@dataclass
class Found:
    """Everything that the report needs."""

    task: Task
    place: Place
    deflection: Deflection | None = None
    static: np.ndarray = field(default_factory=lambda: np.zeros(0))
    peak: np.ndarray = field(default_factory=lambda: np.zeros(0))
    angle: float = np.nan
    index: float = np.nan
    refined: list[Better] = field(default_factory=list)
    freed: Better | None = None
    combinations: list[dict[str, Any]] = field(default_factory=list)
    findings: Findings | None = None
    said: list[str] = field(default_factory=list)


def search(problem: Schema, context: Context, f: Found) -> None:
    """Dynamic index of all combinations, refinement and guideline."""
    task, place = f.task, f.place
    dynamics = place.dynamics
    assert dynamics is not None
    f.deflection = deflections_of(task, dynamics)
    f.peak = place.spread(f.deflection.peak)
    s_row, d_row = choices(place.static, f.peak)
    angles = place.sweep.angles
    given = problem.search.static_choice_deg
    if given is not None:
        s_row = int(dynamics.rows[np.argmin(np.abs(angles[dynamics.rows] - np.deg2rad(given)))])
        if abs(angles[s_row] - np.deg2rad(given)) > angles[1] - angles[0]:
            raise InputError(
                f"is {given:g}; expected an angle that is reachable and has dynamics", "search.static_choice_deg"
            )
    context.progress("refinement", 0.4)
    try:
        f.refined = refined(problem, task, place, f.peak)
        if problem.search.speed_range_rpm is not None:
            low, high = problem.search.speed_range_rpm
            if low >= high:
                raise InputError(f"is {low:g} to {high:g}; expected the lower speed first", "search.speed_range_rpm")
            freed = refined(problem, task, place, f.peak, (low / 60, high / 60))
            f.freed = min(freed, key=lambda better: better.peak, default=None)
    except ValueError as error:
        raise error if isinstance(error, InputError) else InputError(str(error), "search") from error
    f.angle, f.index = float(angles[d_row]), float(f.peak[d_row])
    for better in f.refined:
        if better.peak < f.index:
            f.angle, f.index = better.angle, better.peak
    context.progress("speeds", 0.6)
    by_speed = _combinations(problem, context, f, int(np.flatnonzero(dynamics.rows == s_row)[0]))
    at_static, at_dynamic = dynamics.at(float(angles[s_row])), dynamics.at(f.angle)

    def peaks(oscillators: Oscillators) -> np.ndarray:
        return deflections_of(task, replace_oscillators(dynamics, oscillators)).peak

    lower, higher = frequency_sensitivity(Oscillators.joined([at_dynamic, at_static]), peaks)
    speeds, best, static = np.array(by_speed).reshape(-1, 3).T
    f.findings = Findings(
        angles, place.static, f.peak, at_static, at_dynamic, task.speed, task.cutter.teeth,
        (float(lower[0]), float(higher[0])), (float(lower[1]), float(higher[1])), speeds, best, static,
        None if given is None else s_row,
    )  # fmt: skip
    f.said = guideline(f.findings)


def _combinations(problem: Schema, context: Context, f: Found, static: int) -> list[tuple[float, float, float]]:
    """Fills `combinations`; gives speed, least index and that of row `static` at the declared place and feed."""
    s, k, task = problem.search, problem.cut, f.task
    by_speed = []
    for p, where in enumerate([problem.place_m, *s.places_m]):
        try:
            place = f.place if p == 0 else place_of(problem, task, where)
        except ValueError as error:
            if isinstance(error, InputError) and error.key != "oscillator_field":
                raise
            f.combinations.append({"place_m": where, "reason": str(error)})
            continue
        dynamics = place.dynamics
        assert dynamics is not None
        for n, feed in enumerate([k.feed_direction, *s.feed_directions]):
            for v, rpm in enumerate([k.speed_rpm, *s.speeds_rpm]):
                if context.interrupted():
                    return by_speed
                first = p == n == v == 0
                made = f.deflection if first else deflections_of(task, dynamics, speed=rpm / 60, feed=feed)
                assert made is not None
                best = int(np.argmin(made.peak))
                angle = float(np.rad2deg(place.sweep.angles[dynamics.rows[best]]))
                f.combinations.append({"place_m": where, "feed_direction": feed, "speed_rpm": rpm,
                                       "index_mm": 1e3 * float(made.peak[best]), "angle_deg": angle})  # fmt: skip
                if p == n == 0:
                    by_speed.append((rpm / 60, float(made.peak[best]), float(made.peak[static])))
    return by_speed
