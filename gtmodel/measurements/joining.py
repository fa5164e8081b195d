"""Join of two recordings: rows at the nearest time, interpolated, with the same number, or in the same order."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, get_args

import numpy as np

from ..results.interpolation import Nature, rotations_again, smooth
from ..results.refusal import ArgumentError
from ..results.trajectory import Trajectory
from .streams.form import LogError

Match = Literal["nearest", "interpolated", "number", "order"]


def joined(
    first: Trajectory,
    other: Trajectory,
    match: Match = "nearest",
    *,
    tolerance: float | None = None,
    number: str = "number",
    natures: Mapping[tuple[str, ...], Nature] | None = None,
) -> Trajectory:
    """Return the rows of `first` with the signals of `other` that belong to them.

    Args:
        match: "nearest": the row of `other` with the nearest time, at most `tolerance` [s] away; "interpolated":
            linearly, between its rows; "number": the row with the same value of the signal `number`, which both have;
            "order": the row at the same place.
        natures: signals of `other` that are rotations, which are interpolated as such.

    Raises LogError if a row of `first` has no partner, or more than one, and ArgumentError without a tolerance for
    "nearest".

    >>> readings = gt.Trajectory([0.1, 1.1], {"force": [3.0, 4.0]}, {"force": "N"})
    >>> poses = gt.Trajectory([0.0, 1.0, 2.0], {"x": [0.0, 1.0, 2.0]}, {"x": "m"})
    >>> gt.measurements.joined(readings, poses, tolerance=0.2)["x"].tolist()
    [0.0, 1.0]
    >>> gt.measurements.joined(readings, poses, "interpolated")["x"].tolist()
    [0.1, 1.1]
    """
    if match not in get_args(Match):
        raise ArgumentError(f"expected one of {', '.join(get_args(Match))}; found {match!r}", "match")
    if match == "interpolated":
        return first.merge(_interpolated(first.time, other, natures or {}))
    rows = _partners(first, other, match, tolerance, number)
    names = [name for name in other.names if not (match == "number" and name == number)]
    return first.with_values({n: other[n][rows] for n in names}, units={n: other.units[n] for n in names})


def _interpolated(time: np.ndarray, other: Trajectory, natures: Mapping[tuple[str, ...], Nature]) -> Trajectory:
    outside = (time < other.time[0]) | (time > other.time[-1])
    if outside.any():
        raise LogError(
            f"{int(outside.sum())} of {len(time)} rows, the first at {time[outside][0]:.6g} s, are not between the "
            f"first and the last row of the other recording, {other.time[0]:.6g} to {other.time[-1]:.6g} s"
        )
    even = smooth(other, dict(natures)).resample(time)
    return even.with_values(rotations_again({name: even[name] for name in even.names}, dict(natures)))


def _partners(first: Trajectory, other: Trajectory, match: Match, tolerance: float | None, number: str) -> np.ndarray:
    """Return the row of `other` for each row of `first`."""
    count = len(first)
    if match == "order":
        if len(other) != count:
            raise LogError(
                f"one recording has {count} rows, the other {len(other)}; expected as many for a join by order"
            )
        return np.arange(count)
    if match == "number":
        mine, theirs = first[number], other[number]
        values, where, times = np.unique(theirs, return_index=True, return_counts=True)
        if np.any(times > 1):
            raise LogError(f"the number {values[times > 1][0]:g} occurs {times.max()} times in the other recording")
        if (alone := ~np.isin(mine, theirs)).any():
            raise LogError(f"the other recording has no row with the number {mine[alone][0]:g}")
        return where[np.searchsorted(values, mine)]
    if tolerance is None:
        raise ArgumentError("is needed to join rows by their nearest times", "tolerance")
    after = np.clip(np.searchsorted(other.time, first.time), 1, max(len(other) - 1, 1))
    pair = np.minimum(np.stack([after - 1, after]), len(other) - 1)
    apart = np.abs(other.time[pair] - first.time)
    rows = pair[np.argmin(apart, axis=0), np.arange(count)]
    far = apart.min(axis=0)
    if (late := far > tolerance).any():
        raise LogError(
            f"{int(late.sum())} of {count} rows have no partner within {tolerance:g} s; the first, at "
            f"{first.time[late][0]:.6g} s, is {far[late][0]:.3g} s from the nearest"
        )
    return rows
