"""Columns read wrong, recognised by the closure equations: wrong units, quaternions or actuators in another order."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations, permutations, product
from operator import itemgetter
from typing import NamedTuple

import numpy as np
import scipy

from ...lang.source import ModelError
from ..calibration import calibrate
from ..measurements import Measurements
from ..problem import CalibrationProblem
from .alarms import Alarm
from .column_checks import AXES, exchanged, length, much_nearer

THOUSANDS = ((1e-3, "large", "divided", "in millimetres"), (1e3, "small", "multiplied", "in metres"))
STEPS = 20  # of each fit: a few unknowns near their start need fewer
POSES = 40  # that are looked at: enough to distinguish one order from another


def misread_columns(
    problem: CalibrationProblem, lengths: Sequence[str] = (), columns: Sequence[str] = (), axes_of: str = ""
) -> tuple[Alarm, str] | None:
    """The alarm, and one sentence with the residuals seen, where another reading of the columns closes the links much
    better, or None.

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
    trials = [*_scaled(problem, m, lengths), *_turned(problem.actuators, q, names), *_swapped(m, axes_of)]
    misfits = [_misfit(problem, m, {t.signal: t.rows}) for t in trials]
    left, order = _ordered(problem, m, given)
    pairs = len(order) * (len(order) - 1)  # of columns, and as many steps of the search
    best = min(range(len(trials)), key=misfits.__getitem__)
    if misfits[best] < left and much_nearer(misfits[best], given, len(trials) + pairs, beyond):
        t = trials[best]
        sentence = f"{t.looks}: links miss by {length(given)} rms as given, and by {length(misfits[best])} {t.when}"
        return t.alarm, sentence
    if not much_nearer(left, given, len(trials) + pairs, beyond):
        return None
    which, read = exchanged(names, order)
    return "exchanged_columns", (
        f"the columns {which} look exchanged: links miss by {length(given)} rms as given, and by {length(left)} when "
        f"they are read as {read}"
    )


class _Trial(NamedTuple):
    """Another reading of a signal's rows, and what to say of it."""

    alarm: Alarm
    signal: str
    rows: np.ndarray
    looks: str
    when: str


def _scaled(problem: CalibrationProblem, m: Measurements, lengths: Sequence[str]) -> Iterator[_Trial]:
    """Lengths in another unit, and quaternions with their scalar last."""
    for name in lengths:
        for factor, size, done, unit in THOUSANDS:
            when = f"when it is {done} by 1000; the column is probably {unit}"
            yield _Trial(
                "unit", name, factor * np.asarray(m.values[name]), f"'{name}' looks 1000 times too {size}", when
            )
    for name in problem.closure.unit:
        yield _Trial(
            "scalar_last", name, np.roll(np.asarray(m.values[name]), 1, axis=1),
            f"'{name}' looks written with its scalar last",
            "when its last column is read as the first; name the columns scalar first",
        )  # fmt: skip


def _turned(name: str, q: np.ndarray, names: Sequence[str]) -> Iterator[_Trial]:
    """Actuators that count the other way, one of them or all."""
    every = list(range(q.shape[1]))
    for turned in ([k] for k in every) if len(every) == 1 else (*([k] for k in every), every):
        rows = np.where(np.isin(every, turned), -1.0, 1.0) * q
        which = ", ".join(names[k] for k in turned)
        yield _Trial("exchanged_columns", name, rows, f"the columns {which} look reversed", "with the other sign; is a "
                     "scale -1?")  # fmt: skip


def _swapped(m: Measurements, name: str) -> Iterator[_Trial]:
    """Axes of a position in another order or reversed."""
    if not name:
        return
    T = np.asarray(m.values[name])
    for order, signs in product(permutations(range(T.shape[1])), product((1.0, -1.0), repeat=T.shape[1])):
        read = ", ".join(("-" if s < 0 else "") + AXES[k] for k, s in zip(order, signs, strict=True))
        when = f"when ({read}) is read as ({', '.join(AXES[: T.shape[1]])})"
        yield _Trial("swapped_axes", name, T[:, order] * signs, f"the axes of '{name}' look swapped", when)


def _ordered(problem: CalibrationProblem, m: Measurements, given: float) -> tuple[float, list[int]]:
    """The misfit and the order of the actuators' columns: by assignment at the start values, then by exchanges that
    each lower it."""
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
            return best, order
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
