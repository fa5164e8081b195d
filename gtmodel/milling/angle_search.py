"""The search of a milling study: angles, refinement, places, feeds and speeds, and what to do."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..results import ArgumentError, Work
from ..vibration import OscillatorField
from .deflection import Deflection
from .guideline import Findings, choices, frequency_sensitivity, guideline
from .oscillators import Oscillators
from .refine import Refined
from .task import MillingPlace, MillingTask, deflections_of, place_of, refined


@dataclass
class AngleSearch:
    """Everything that the report needs."""

    task: MillingTask
    place: MillingPlace
    deflection: Deflection | None = None
    peak: np.ndarray = field(default_factory=lambda: np.zeros(0))
    angle: float = np.nan
    index: float = np.nan
    refined: list[Refined] = field(default_factory=list)
    freed: Refined | None = None
    combinations: list[dict[str, Any]] = field(default_factory=list)
    findings: Findings | None = None
    guideline: list[str] = field(default_factory=list)


def search(work: Work, f: AngleSearch) -> None:
    """Dynamic index of all combinations, refinement and guideline."""
    task, place = f.task, f.place
    dynamics = place.dynamics
    assert dynamics is not None
    f.deflection = deflections_of(task, dynamics.oscillators)
    f.peak = place.spread(f.deflection.peak)
    s_row, d_row = choices(place.static, f.peak)
    angles = place.sweep.angles
    given = task.search.static_choice
    if given is not None:
        s_row = int(dynamics.rows[np.argmin(np.abs(angles[dynamics.rows] - given))])
        if abs(angles[s_row] - given) > angles[1] - angles[0]:
            said = f"is {np.rad2deg(given):g}; expected an angle that is reachable and has dynamics"
            raise ArgumentError(said, "search.static_choice")
    work.progress("refinement", 0.4)
    try:
        f.refined = refined(task, place, f.peak)
        if task.search.speed_range is not None:
            low, high = task.search.speed_range
            if low >= high:
                said = f"is {60 * low:g} to {60 * high:g} rpm; expected the lower speed first"
                raise ArgumentError(said, "search.speed_range")
            freed = refined(task, place, f.peak, (low, high))
            f.freed = min(freed, key=lambda better: better.peak, default=None)
    except ArgumentError:
        raise
    except ValueError as error:
        raise ArgumentError(str(error), "search") from error
    f.angle, f.index = float(angles[d_row]), float(f.peak[d_row])
    for better in f.refined:
        if better.peak < f.index:
            f.angle, f.index = better.angle, better.peak
    work.progress("speeds", 0.6)
    by_speed = _combinations(work, f, int(np.flatnonzero(dynamics.rows == s_row)[0]))
    at_static, at_dynamic = dynamics.at(float(angles[s_row])), dynamics.at(f.angle)
    both = Oscillators.concatenate([at_dynamic, at_static])
    lower, higher = frequency_sensitivity(both, lambda oscillators: deflections_of(task, oscillators).peak)
    speeds, best, static = np.array(by_speed).reshape(-1, 3).T
    f.findings = Findings(
        angles, place.static, f.peak, at_static, at_dynamic, task.speed, task.cutter.teeth,
        (float(lower[0]), float(higher[0])), (float(lower[1]), float(higher[1])), speeds, best, static,
        None if given is None else s_row,
    )  # fmt: skip
    f.guideline = guideline(f.findings)


def _combinations(work: Work, f: AngleSearch, static: int) -> list[tuple[float, float, float]]:
    """Fills `combinations`; gives speed, least index and that of row `static` at the declared place and feed."""
    task = f.task
    s = task.search
    by_speed = []
    for p, where in enumerate([task.place, *s.places]):
        try:
            place = f.place if p == 0 else place_of(task, where)
        except ArgumentError as error:
            if error.argument != "place" and not (
                error.argument == "dynamics" and isinstance(task.given, OscillatorField)
            ):
                raise
            f.combinations.append({"place_m": where, "reason": error.message})
            continue
        dynamics = place.dynamics
        assert dynamics is not None
        for n, feed in enumerate([task.feed.tolist(), *s.feed_directions]):
            for v, speed in enumerate([task.speed, *s.speeds]):
                if work.interrupted():
                    return by_speed
                first = p == n == v == 0
                made = f.deflection if first else deflections_of(task, dynamics.oscillators, speed=speed, feed=feed)
                assert made is not None
                best = int(np.argmin(made.peak))
                angle = float(np.rad2deg(place.sweep.angles[dynamics.rows[best]]))
                f.combinations.append({"place_m": where, "feed_direction": feed, "speed_rpm": 60 * speed,
                                       "index_mm": 1e3 * float(made.peak[best]), "angle_deg": angle})  # fmt: skip
                if p == n == 0:
                    by_speed.append((speed, float(made.peak[best]), float(made.peak[static])))
    return by_speed
