"""Checks of measured runs before a law learns from them: sampling, reference, signals, repeats."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...inference.chance import f_test
from ...results import ArgumentError, Trajectory
from .lifted import Array
from .references import JUDGED

EVEN = 0.01  # of a period: largest jitter
ENDS = 5  # samples at each end in which a motion from rest to rest does not move
SAME = 1e-6  # of the largest number: equal within the digits of a file
BY_CHANCE = 0.01  # probability of a false drift
NEEDS = {"1": ("motor",), "2A": ("motor", "acceleration"), "2B": ("motor", "acceleration"), "3": ("tool",)}


def check_run(run: Trajectory, sample_time: float, ramp: int) -> None:
    """Raise ArgumentError for another sampling period, or if too few samples remain between lead-in and lead-out."""
    check_clock(run, sample_time, "run")
    check_judged(len(run), ramp, "ramp")


def check_judged(size: int, ramp: int, argument: str) -> None:
    """Raise ArgumentError if fewer than JUDGED samples of a run lie between lead-in and lead-out."""
    if size - 2 * ramp < JUDGED:
        raise ArgumentError(
            f"lead-in and lead-out take {2 * ramp} of {size} samples and leave {max(size - 2 * ramp, 0)} to evaluate; "
            f"expected {JUDGED} or more: record a longer run, with rest before and after the motion, or shorten both",
            argument,
        )


def moves_outside(reference: Array, corrected: slice) -> float:
    """Return the largest share of an axis' path length (N, axes) in lead-in and lead-out; 0 for an axis at rest."""
    way = np.abs(np.diff(reference, axis=0))
    whole, inside = way.sum(axis=0), way[corrected].sum(axis=0)
    return float(np.max(1 - np.divide(inside, whole, out=np.ones_like(whole), where=whole > 0)))


def check_clock(run: Trajectory, sample_time: float, argument: str) -> None:
    """Raise ArgumentError if rows are not one sampling period apart."""
    off = np.abs(np.diff(run.time) - sample_time)
    if len(run) < 2 or np.any(off > EVEN * sample_time):
        where = f", first after row {int(np.argmax(off > EVEN * sample_time))}" if len(run) > 1 else ""
        raise ArgumentError(
            f"its rows are not {1e3 * sample_time:g} ms apart, the robot's sampling period{where}", argument
        )


def check_repeats(repeats: Sequence[Trajectory], run: Trajectory, sample_time: float) -> None:
    """Raise ArgumentError if repeats differ in sampling, length, reference or input, or if two are identical."""
    for k, other in enumerate(repeats):
        argument = f"repeats[{k}]"
        if len(other) != len(run):
            raise ArgumentError(f"has {len(other)} rows, the run has {len(run)}; record the same motion", argument)
        check_clock(other, sample_time, argument)
        for name, first, owner in (("reference", run, "the run"), ("input", repeats[0], "repeats[0]")):
            if name in other.names and name in first.names and not _alike(other[name], first[name]):
                off = float(np.max(np.abs(np.asarray(other[name]) - np.asarray(first[name]))))
                raise ArgumentError(
                    f"its {name} differs from that of {owner} by up to {1e6 * off:.4g} um; repeats must be runs of the "
                    "same motion",
                    argument,
                )
        for j in range(k):
            shared = [n for n in other.names if n in repeats[j].names and n not in ("reference", "input")]
            if shared and all(np.array_equal(other[n], repeats[j][n]) for n in shared):
                raise ArgumentError(f"is identical to repeats[{j}]; name three different runs", argument)


def signals_of(
    run: Trajectory, reference: Array, u: Array, case: str, axes: int, argument: str
) -> tuple[dict[str, Array], list[float]]:
    """Return the signals (N, axes) of a case by name, positions relative to the start of the reference, and the
    accelerometer's mean [m/s2]. The mean is subtracted if reference and input are at rest at both ends, because the
    change of speed is then zero."""
    signals = {name: columns(run, name, axes, len(reference), argument) for name in NEEDS[case]}
    for name in ("motor", "tool"):
        if name in signals:
            signals[name] = signals[name] - reference[0]
    ends = np.vstack([np.diff(x, axis=0)[s] for x in (reference, u) for s in (slice(0, ENDS), slice(-ENDS, None))])
    bias = [0.0] * axes
    if "acceleration" in signals and not np.any(ends[np.abs(ends) > SAME * np.max(np.abs(reference), initial=0.0)]):
        bias = signals["acceleration"].mean(axis=0).tolist()
        signals["acceleration"] = signals["acceleration"] - signals["acceleration"].mean(axis=0)
    return signals, bias


def columns(run: Trajectory, name: str, axes: int, size: int, argument: str) -> Array:
    """Return a signal (size, axes) in SI. Raises ArgumentError if it is missing or has another unit or size."""
    if name not in run.names:
        raise ArgumentError(f"has no signal '{name}'; it has {', '.join(run.names)}", argument)
    unit = "m/s2" if name == "acceleration" else "m"
    if run.unit(name) not in (unit, "m/s^2" if unit == "m/s2" else unit):
        raise ArgumentError(f"'{name}' is in {run.unit(name)}; expected {unit}", argument)
    values = np.asarray(run[name], float).reshape(len(run), -1)
    if values.shape != (size, axes):
        raise ArgumentError(
            f"'{name}' has {values.shape[0]} rows and {values.shape[1]} columns; expected {size} rows and {axes} "
            "columns, one per axis", argument,
        )  # fmt: skip
    return values


def drift(runs: Array) -> bool:
    """Return whether runs (m, n) drift linearly from run to run rather than scatter: an F test of the variance along
    the line, with one degree of freedom, the fewest that a scatter can have."""
    apart = runs - runs.mean(axis=0)
    total, m = float(np.sum(apart**2)), len(runs)
    if not total > 0 or m < 3:
        return False
    line = np.arange(m) - (m - 1) / 2
    along = float(np.sum((line @ apart) ** 2) / (line @ line))
    return f_test(total, total - along, 1, m - 2)[1] < BY_CHANCE


def _alike(a: Array, b: Array) -> bool:
    x, y = np.asarray(a, float), np.asarray(b, float)
    scale = max(float(np.max(np.abs(x), initial=0.0)), float(np.max(np.abs(y), initial=0.0)))
    return x.shape == y.shape and bool(np.all(np.abs(x - y) <= SAME * scale))
