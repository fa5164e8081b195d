"""What measured runs must be before a law learns from them: at its clock, of its motion, repeats alike."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...inference.chance import f_test
from ...results import ArgumentError, Trajectory
from .lifted import Array
from .references import JUDGED

EVEN = 0.01  # of a period
ENDS = 5  # samples in which a motion from rest to rest does not move
SAME = 1e-6  # of the largest number: what files of few digits keep
BY_CHANCE = 0.01  # chance at which runs without drift are said to drift
NEEDS = {"1": ("motor",), "2A": ("motor", "acceleration"), "2B": ("motor", "acceleration"), "3": ("tool",)}


def check_run(run: Trajectory, sample_time: float, ramp: int) -> None:
    """Raises ArgumentError for another clock, and for a run too short to be judged between lead-in and lead-out."""
    check_clock(run, sample_time, "run")
    check_judged(len(run), ramp, "ramp")


def check_judged(size: int, ramp: int, argument: str) -> None:
    """Raises ArgumentError where fewer than JUDGED samples of a run lie between lead-in and lead-out."""
    if size - 2 * ramp < JUDGED:
        raise ArgumentError(
            f"lead-in and lead-out take {2 * ramp} samples of {size}, which leaves {max(size - 2 * ramp, 0)} to judge; "
            f"expected {JUDGED} or more: record a longer run, at rest before and behind the motion, or shorten both",
            argument,
        )


def moves_outside(reference: Array, corrected: slice) -> float:
    """The largest share of the way of any axis (N, axes) that lies in lead-in and lead-out; 0 of one that stands."""
    way = np.abs(np.diff(reference, axis=0))
    whole, inside = way.sum(axis=0), way[corrected].sum(axis=0)
    return float(np.max(1 - np.divide(inside, whole, out=np.ones_like(whole), where=whole > 0)))


def check_clock(run: Trajectory, sample_time: float, argument: str) -> None:
    """Raises ArgumentError where rows are not a sampling time apart."""
    off = np.abs(np.diff(run.time) - sample_time)
    if len(run) < 2 or np.any(off > EVEN * sample_time):
        where = f", first behind row {int(np.argmax(off > EVEN * sample_time))}" if len(run) > 1 else ""
        raise ArgumentError(f"its rows are not {1e3 * sample_time:g} ms apart, as the robot's are{where}", argument)


def check_repeats(repeats: Sequence[Trajectory], run: Trajectory, sample_time: float) -> None:
    """Raises ArgumentError where repeats have another clock or length, follow another reference, ran with inputs of
    their own, or hold the same numbers twice."""
    for k, other in enumerate(repeats):
        argument = f"repeats[{k}]"
        if len(other) != len(run):
            raise ArgumentError(f"has {len(other)} rows, the run {len(run)}; record the same motion", argument)
        check_clock(other, sample_time, argument)
        for name, first, whose in (("reference", run, "the run"), ("input", repeats[0], "repeats[0]")):
            if name in other.names and name in first.names and not _alike(other[name], first[name]):
                off = float(np.max(np.abs(np.asarray(other[name]) - np.asarray(first[name]))))
                raise ArgumentError(
                    f"its {name} is not that of {whose}: they differ by up to {1e6 * off:.4g} um, so that is not the "
                    "scatter of one motion",
                    argument,
                )
        for j in range(k):
            shared = [n for n in other.names if n in repeats[j].names and n not in ("reference", "input")]
            if shared and all(np.array_equal(other[n], repeats[j][n]) for n in shared):
                raise ArgumentError(f"holds the numbers of repeats[{j}]; name three different runs", argument)


def signals_of(
    run: Trajectory, reference: Array, u: Array, case: str, axes: int, argument: str
) -> tuple[dict[str, Array], list[float]]:
    """What a case learns from (N, axes) by name, positions from where the reference begins, and the accelerometer's
    mean [m/s2], which is taken off where reference and input are at rest at both ends: no speed is gained then."""
    made = {name: columns(run, name, axes, len(reference), argument) for name in NEEDS[case]}
    for name in ("motor", "tool"):
        if name in made:
            made[name] = made[name] - reference[0]
    ends = np.vstack([np.diff(x, axis=0)[s] for x in (reference, u) for s in (slice(0, ENDS), slice(-ENDS, None))])
    bias = [0.0] * axes
    if "acceleration" in made and not np.any(ends[np.abs(ends) > SAME * np.max(np.abs(reference), initial=0.0)]):
        bias = made["acceleration"].mean(axis=0).tolist()
        made["acceleration"] = made["acceleration"] - made["acceleration"].mean(axis=0)
    return made, bias


def columns(run: Trajectory, name: str, axes: int, size: int, argument: str) -> Array:
    """A signal (size, axes) in SI. Raises ArgumentError where it is missing, of another unit or size."""
    if name not in run.names:
        raise ArgumentError(f"has no signal '{name}'; it has {', '.join(run.names)}", argument)
    unit = "m/s2" if name == "acceleration" else "m"
    if run.unit(name) not in (unit, "m/s^2" if unit == "m/s2" else unit):
        raise ArgumentError(f"'{name}' is in {run.unit(name)}; expected {unit}", argument)
    values = np.asarray(run[name], float).reshape(len(run), -1)
    if values.shape != (size, axes):
        raise ArgumentError(
            f"'{name}' has {values.shape[0]} rows of {values.shape[1]} columns; expected {size} of {axes}, one for "
            "each axis", argument,
        )  # fmt: skip
    return values


def drift(runs: Array) -> bool:
    """Whether runs (m, n) slide along a line from one to the next, rather than scatter: the share of their variance
    on that line against what chance gives at one degree of freedom, which is the least that a scatter has."""
    apart = runs - runs.mean(axis=0)
    total, m = float(np.sum(apart**2)), len(runs)
    if not total > 0 or m < 3:
        return False
    line = np.arange(m) - (m - 1) / 2
    along = float(np.sum((line @ apart) ** 2) / (line @ line))
    return f_test(total, total - along, 1, m - 2)[1] < BY_CHANCE


def _alike(a: Array, b: Array) -> bool:
    one, two = np.asarray(a, float), np.asarray(b, float)
    scale = max(float(np.max(np.abs(one), initial=0.0)), float(np.max(np.abs(two), initial=0.0)))
    return one.shape == two.shape and bool(np.all(np.abs(one - two) <= SAME * scale))
