"""Columns read wrong, recognised by the closure equations: wrong units, quaternions or actuators in another order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from operator import itemgetter

import numpy as np
import scipy

from ...lang.source import ModelError
from ...measurements.inspection.readings import (
    OtherReading,
    axes,
    compared,
    in_order,
    reversals,
    scalar_last,
    thousands,
)
from ...results.suspicion import Suspicion
from ..calibration import calibrate
from ..measurements import Measurements
from ..problem import CalibrationProblem
from .column_checks import NEARER, length

STEPS = 20  # of each fit: a few unknowns near their start need fewer
POSES = 40  # that are looked at: enough to distinguish one order from another


def misread_columns(
    problem: CalibrationProblem, lengths: Sequence[str] = (), columns: Sequence[str] = (), axes_of: str = ""
) -> Suspicion | None:
    """Another reading of the columns that closes the links much better, with the residuals seen.

    `problem`: prepared with little left free, such as the frames and an offset per actuator, so that a wrong reading
    cannot be explained away. `lengths`: signals that may be off by a factor of 1000; `columns`: what to call those of
    the actuators; `axes_of`: a position whose axes may be exchanged or reversed. No forward kinematics is needed. Where
    frames are free, their start must be nearer to the truth than a turn that renumbers the links.
    """
    m = problem.measurements
    rows = np.unique(np.linspace(0, len(m) - 1, min(POSES, len(m))).round().astype(int))
    problem, m = problem.on(m.part(rows)), m.part(rows)
    given = _misfit(problem, m, {})
    beyond = len(m) * len(problem.labels) - len(problem.unknowns.names)
    q = np.asarray(m.values[problem.actuators])
    names = columns or [f"{problem.actuators}[{k}]" for k in range(q.shape[1])]
    at, of = problem.actuators, {name: np.asarray(m.values[name]) for name in m.values}
    readings = [in_order(names, _ordered(problem, m, given), at), *reversals(names, [range(len(names))], at)]
    readings += [r for name in lengths for r in thousands(name, of[name].shape[1])]
    readings += [scalar_last(name) for name in problem.closure.unit]
    readings += axes(axes_of, of[axes_of].shape[1]) if axes_of else []
    steps = len(names) * (len(names) - 1) - 1  # pairs of columns, and as many steps of the search

    def left(r: OtherReading) -> float:
        return _misfit(problem, m, {r.signal: r(of[r.signal])})

    best = compared(given, readings, left, beyond, nearer=NEARER, tests=steps)
    return (
        None
        if best.passed
        else best.suspicion(f"links miss by {length(given)} rms as given, and by", length(best.left))
    )


def _ordered(problem: CalibrationProblem, m: Measurements, given: float) -> list[int]:
    """The order of the actuators' columns: by assignment at the start values, then by exchanges that each lower what
    the links miss by."""
    columns = np.asarray(m.values[problem.actuators])

    def misfit(order: Sequence[int]) -> float:
        return _misfit(problem, m, {problem.actuators: columns[:, order]})

    assigned = _assigned(problem, m)
    best, order = min([(given, list(range(columns.shape[1]))), (misfit(assigned), assigned)], key=itemgetter(0))
    while True:
        trials = []
        for a, b in combinations(range(len(order)), 2):
            trial = order.copy()
            trial[a], trial[b] = trial[b], trial[a]
            trials.append((misfit(trial), trial))
        least, trial = min(trials, default=(np.inf, order))
        if not least < best * (1 - 1e-9):
            return order
        best, order = least, trial


def _assigned(problem: CalibrationProblem, m: Measurements) -> list[int]:
    """Which column each actuator should read, by how little its links' errors vary from pose to pose."""
    columns = np.asarray(m.values[problem.actuators])
    n = columns.shape[1]
    varied = np.empty((n, n))
    for k in range(n):
        for j in range(n):
            read = columns.copy()
            read[:, k] = columns[:, j]
            other = replace(m, values={**m.values, problem.actuators: read})
            varied[k, j] = np.sum(np.var(problem.on(other).residuals(), axis=0))
    return [int(j) for j in scipy.optimize.linear_sum_assignment(varied)[1]]


def _misfit(problem: CalibrationProblem, m: Measurements, read: dict[str, np.ndarray]) -> float:
    """Root mean square [m] of the links' errors after the fit; infinite where there is none."""
    try:
        other = problem.on(replace(m, values={**m.values, **read}))
        free = bool(other.unknowns.names)
        r = calibrate(other, confidence=False, limit=STEPS).residuals if free else other.residuals()
    except ModelError:
        return np.inf
    rms = float(np.sqrt(np.mean(r**2)))
    return rms if np.isfinite(rms) else np.inf
