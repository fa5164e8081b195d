"""Columns read wrong, told by the closure equations alone: wrong units, quaternions or actuators in another order."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from scipy.optimize import linear_sum_assignment

from ...lang.source import ModelError
from ..calibration import calibrate
from ..measurements import Measurements
from ..problem import Problem

NEARER = 3.0  # another reading is believed where it leaves a third of the residuals: nominal geometry misses by as much
THOUSANDS = ((1e-3, "large", "divided", "in millimetres"), (1e3, "small", "multiplied", "in metres"))
STEPS = 20  # of each fit: a few unknowns near their start need fewer
POSES = 40  # that are looked at: enough to tell an order from another


def misreading(problem: Problem, lengths: Sequence[str] = (), columns: Sequence[str] = ()) -> str | None:
    """One sentence with the residuals seen where another reading of the columns closes the links much better, or None.

    `problem`: prepared with little left free, such as the frames and an offset per actuator, so that a wrong reading
    cannot be explained away. `lengths`: signals that may be off by a factor of 1000; `columns`: what to call those of
    the actuators. No forward kinematics is needed. Where frames are free, their start must be nearer to the truth than
    a turn that renumbers the links.
    """
    m = problem.measurements
    rows = np.unique(np.linspace(0, len(m) - 1, min(POSES, len(m))).round().astype(int))
    problem, m = problem.on(m.part(rows)), m.part(rows)
    given = _misfit(problem, m, {})
    for name in lengths:
        for factor, size, done, unit in THOUSANDS:
            found = _misfit(problem, m, {name: factor * np.asarray(m.values[name])})
            if found * NEARER < given:
                return (
                    f"'{name}' looks 1000 times too {size}: links miss by {_length(given)} rms as given, and by "
                    f"{_length(found)} when it is {done} by 1000; the column is probably {unit}"
                )
    for name in problem.closure.unit:
        found = _misfit(problem, m, {name: np.roll(np.asarray(m.values[name]), 1, axis=1)})
        if found * NEARER < given:
            return (
                f"'{name}' looks written with its scalar last: links miss by {_length(given)} rms as given, and by "
                f"{_length(found)} when its last column is read as the first; name the columns scalar first"
            )
    found, order = _ordered(problem, m, given)
    if not found * NEARER < given:
        return None
    names = columns or [f"{problem.actuators}[{k}]" for k in range(len(order))]
    changed = [k for k, j in enumerate(order) if j != k]
    read = ", ".join(names[order[k]] for k in changed)
    return (
        f"the columns {', '.join(names[k] for k in changed)} look exchanged: links miss by {_length(given)} rms as "
        f"given, and by {_length(found)} when they are read as {read}"
    )


def _ordered(problem: Problem, m: Measurements, given: float) -> tuple[float, list[int]]:
    """The misfit and the order of the actuators' columns: by assignment at the start values, then by exchanges that
    each lower it."""
    columns = np.asarray(m.values[problem.actuators])

    def misfit(order: Sequence[int]) -> float:
        return _misfit(problem, m, {problem.actuators: columns[:, order]})

    best, order = given, list(range(columns.shape[1]))
    assigned = _assigned(problem, m)
    found = misfit(assigned) if assigned != order else given
    if found < best:
        best, order = found, assigned
    while True:
        trials = []
        for a, b in combinations(range(len(order)), 2):
            trial = order.copy()
            trial[a], trial[b] = trial[b], trial[a]
            trials.append((misfit(trial), trial))
        found, trial = min(trials, default=(np.inf, order))
        if not found < best * (1 - 1e-9):
            return best, order
        best, order = found, trial


def _assigned(problem: Problem, m: Measurements) -> list[int]:
    """Which column each actuator should read, by how little its links' errors vary from pose to pose."""
    columns = np.asarray(m.values[problem.actuators])
    n = columns.shape[1]
    varied = np.empty((n, n))
    for k in range(n):
        for j in range(n):
            read = columns.copy()
            read[:, k] = columns[:, j]
            other = Measurements({**m.values, problem.actuators: read}, m.noise, m.sessions, m.poses, m.corrections)
            varied[k, j] = np.sum(np.var(problem.on(other).residuals(), axis=0))
    return [int(j) for j in linear_sum_assignment(varied)[1]]


def _misfit(problem: Problem, m: Measurements, read: dict[str, np.ndarray]) -> float:
    """Root mean square [m] of the links' errors after the fit; infinite where there is none."""
    other = Measurements({**m.values, **read}, m.noise, m.sessions, m.poses, m.corrections)
    try:
        r = calibrate(problem.on(other), confidence=False, limit=STEPS).residuals
    except ModelError:
        return np.inf
    rms = float(np.sqrt(np.mean(r**2)))
    return rms if np.isfinite(rms) else np.inf


def _length(metres: float) -> str:
    return f"{1e3 * metres:.3g} mm"
