"""JoinRows of two recordings or files that belong together: by number, by order, by time, or at rest."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Literal, get_args

import numpy as np

from ..results.interpolation import Nature, rotations_again, smooth
from ..results.options import Options, Unit, Within
from ..results.refusal import ArgumentError
from ..results.trajectory import Trajectory
from .rest import motion_at_rest
from .streams.form import LogError

Match = Literal["nearest", "interpolated", "at_rest", "number", "order"]
IN_TIME = ("nearest", "interpolated", "at_rest")
FEWEST = 8  # rows of a rest: two blocks whose means are compared
STILL = 1e-5  # of a signal's range over the recording: a smaller change of a mean is no motion


@dataclass(frozen=True)
class ClockColumn(Options):
    """The time column of a file.

    >>> gt.measurements.ClockColumn("stamp", "ms").unit
    'ms'
    """

    column: Annotated[str, "name of the time column"] = "time"
    unit: Annotated[str, "its unit"] = "s"


@dataclass(frozen=True)
class RowJoin(Options):
    """The row of another file that belongs to a row.

    >>> gt.measurements.RowJoin("at_rest", tolerance=0.5).rest
    0.2
    """

    match: Annotated[
        Match,
        "row of the other file: nearest in time, interpolated in time, the mean of its rows at rest around that time, "
        "with the same number, or by the order of the rows",
    ] = "nearest"
    tolerance: Annotated[
        float | None, Unit("s"), Within(above=0.0),
        "nearest: largest difference of the times; at_rest: how far the rest may be from the time, 0 if left out",
    ] = None  # fmt: skip
    number: Annotated[str | None, "number: column of both files with the number or name of the row"] = None
    rest: Annotated[float, Unit("s"), Within(above=0.0), "at_rest: length of the rest"] = 0.2
    time: Annotated[ClockColumn | None, "time column of the other file; as in the first one if left out"] = None


@dataclass(frozen=True, eq=False)
class JoinRows:
    """JoinRows of a file or recording, for messages and joins.

    name: in a sentence. where: returns the place of a row in a sentence. keys: number or name of each row. time: of
    each row (n,) [s].
    """

    name: str
    where: Callable[[int], str]
    count: int
    keys: Sequence[str] = ()
    time: np.ndarray = field(default_factory=lambda: np.zeros(0))


def by_order(first: JoinRows, other: JoinRows) -> np.ndarray:
    """Return the row of `other` for each row of `first`, in the same order. Raises LogError if the numbers differ."""
    if first.count != other.count:
        longer, place = (first, other.count) if first.count > other.count else (other, first.count)
        raise LogError(
            f"{longer.where(place)}: this row has no partner; {first.name} has {first.count} rows and {other.name} "
            f"{other.count}; name a column that joins the rows, or remove rows"
        )
    return np.arange(first.count)


def by_number(firsts: Sequence[JoinRows], other: JoinRows, column: str, *, one_to_one: bool = True) -> list[np.ndarray]:
    """Return the rows of `other` with the keys of each of `firsts`.

    one_to_one: whether each row of `other` must have exactly one partner; else any number. Raises LogError for a row
    of `firsts` without a partner, and for a key that occurs twice in `other`.
    """
    row_of = dict[str, int]()
    for row, key in enumerate(map(_plain, other.keys)):
        if key in row_of:
            raise LogError(
                f"{other.where(row)}: '{column}' is {key} again, as in {other.where(row_of[key])}; expected one row "
                "for each pose"
            )
        row_of[key] = row
    rows, taken = list[np.ndarray](), dict[str, str]()
    for first in firsts:
        partners = []
        for row, key in enumerate(map(_plain, first.keys)):
            if key not in row_of:
                raise LogError(
                    f"{first.where(row)}: no row of {other.name} has '{column}' {key}; remove this row, or add its "
                    "partner"
                )
            if one_to_one and key in taken:
                raise LogError(
                    f"{first.where(row)}: '{column}' is {key} again, as in {taken[key]}; expected one row for each pose"
                )
            taken[key] = first.where(row)
            partners.append(row_of[key])
        rows.append(np.array(partners, int))
    lonely = next((row for key, row in row_of.items() if key not in taken), None) if one_to_one else None
    if lonely is not None:
        raise LogError(
            f"{other.where(lonely)}: no row of {firsts[0].name} has '{column}' {_plain(other.keys[lonely])}; remove "
            "this row, or add its partner"
        )
    return rows


def _plain(text: str) -> str:
    """Return a number without leading or trailing zeros, other texts without blanks around them."""
    try:
        return f"{float(text):.12g}"
    except ValueError:
        return text.strip()


def in_time(
    first: JoinRows, other: JoinRows, values: Mapping[str, np.ndarray], join: RowJoin, natures: Mapping[str, Nature]
) -> dict[str, np.ndarray]:
    """Return the values (m, k) of `other` at the times of `first`.

    natures: signals that are rotations; at rest the middle row stands for their mean. Raises LogError for a row without
    a partner, and ArgumentError about "tolerance".
    """
    order = np.argsort(other.time, kind="stable")
    clock = other.time[order]
    if (again := np.diff(clock) <= 0).any():
        k = order[1:][again][0]
        raise LogError(f"{other.where(int(k))}: another row has the time {other.time[k]:.6g} s, too; expected one")
    values = {name: rows[order] for name, rows in values.items()}
    if join.match == "nearest":
        near = _nearest(first, clock, join.tolerance)
        return {name: rows[near] for name, rows in values.items()}
    outside = np.flatnonzero((first.time < clock[0]) | (first.time > clock[-1]))
    if outside.size:
        raise LogError(
            f"{first.where(int(outside[0]))}: the time {first.time[outside[0]]:.6g} s and {outside.size - 1} others "
            f"are outside {other.name}, from {clock[0]:.6g} to {clock[-1]:.6g} s"
        )
    if join.match == "interpolated":
        of: dict[tuple[str, ...], Nature] = {(name,): nature for name, nature in natures.items()}
        ascending, back = np.unique(first.time, return_inverse=True)
        even = smooth(Trajectory(clock, dict(values)), of).resample(ascending)
        turned = rotations_again({name: even[name] for name in even.names}, of)
        return {name: np.asarray(turned.get(name, even[name]))[back] for name in values}
    pairs = _rests(first, other.name, clock, values, join)
    return {
        name: np.array([v[(a + b) // 2] if name in natures else v[a:b].mean(axis=0) for a, b in pairs])
        for name, v in values.items()
    }


def _nearest(first: JoinRows, clock: np.ndarray, tolerance: float | None) -> np.ndarray:
    if tolerance is None:
        raise ArgumentError("is missing; give the largest difference of the times", "tolerance")
    after = np.clip(np.searchsorted(clock, first.time), 1, max(len(clock) - 1, 1))
    pair = np.minimum(np.stack([after - 1, after]), len(clock) - 1)
    apart = np.abs(clock[pair] - first.time)
    far = apart.min(axis=0)
    if (late := np.flatnonzero(far > tolerance)).size:
        raise LogError(
            f"{first.where(int(late[0]))}: this row is {far[late[0]]:.3g} s from the nearest row of the other file, "
            f"{late.size - 1} others too are farther than {tolerance:g} s; give a larger tolerance, or remove rows"
        )
    return pair[np.argmin(apart, axis=0), np.arange(first.count)]


def _rests(
    first: JoinRows, name: str, clock: np.ndarray, values: Mapping[str, np.ndarray], join: RowJoin
) -> list[tuple[int, int]]:
    """Return begin and end of the rest nearest to the time of each row. Raises LogError if there is none or two."""
    columns = np.column_stack([v.reshape(len(clock), -1) for v in values.values()])
    span = np.ptp(columns, axis=0)
    columns = (columns - columns[0]) / np.where(span > 0, span, 1.0)
    half, reach = join.rest / 2, join.tolerance or 0.0
    steps = half * np.arange(int(reach / half) + 1)

    def rest(at: float) -> tuple[int, int] | None:
        ends = np.searchsorted(clock, [at - half, at + half * (1 + 1e-9)])
        begin, end = int(ends[0]), int(ends[1])
        if at - half < clock[0] or at + half > clock[-1] or end - begin < FEWEST:
            return None
        return (begin, end) if motion_at_rest(columns[begin:end], STILL)[0] is None else None

    rests = list[tuple[int, int]]()
    for row, t in enumerate(first.time.tolist()):
        sides = [next((r for s in steps if (r := rest(t + sign * s)) is not None), None) for sign in (-1.0, 1.0)]
        pair = list(dict.fromkeys(r for r in sides if r is not None))
        if not pair:
            raise LogError(
                f"{first.where(row)}: {name} is not at rest for {join.rest:g} s at {t:.6g} s: a signal moves by more "
                f"than its noise, or there are fewer than {FEWEST} rows; compare the clocks, give a tolerance, or "
                "remove this row"
            )
        if len(pair) == 2 and motion_at_rest(np.concatenate([columns[a:b] for a, b in pair]), STILL)[0] is not None:
            raise LogError(
                f"{first.where(row)}: {name} moves at {t:.6g} s, and rests before and after it in different places: "
                "compare the clocks, or give a smaller tolerance"
            )
        rests.append(min(pair, key=lambda r: abs(clock[r[0]] + clock[r[1] - 1] - 2 * t)))
    return rests


def joined(
    first: Trajectory,
    other: Trajectory,
    join: RowJoin,
    *,
    natures: Mapping[str, Nature] | None = None,
) -> Trajectory:
    """Return the rows of `first` with the signals of `other` that belong to them.

    join: how; a column `number` is a signal of both. natures: signals of `other` that are rotations.

    Raises LogError if a row of `first` has no partner, or more than one, and ArgumentError if the join lacks an option.

    >>> readings = gt.Trajectory([0.1, 1.1], {"force": [3.0, 4.0]}, {"force": "N"})
    >>> poses = gt.Trajectory([0.0, 1.0, 2.0], {"x": [0.0, 1.0, 2.0]}, {"x": "m"})
    >>> RowJoin = gt.measurements.RowJoin
    >>> gt.measurements.joined(readings, poses, RowJoin("nearest", tolerance=0.2))["x"].tolist()
    [0.0, 1.0]
    >>> gt.measurements.joined(readings, poses, RowJoin("interpolated"))["x"].tolist()
    [0.1, 1.1]
    """
    if join.match not in get_args(Match):
        raise ArgumentError(f"expected one of {', '.join(get_args(Match))}; found {join.match!r}", "match")
    number, names = join.number or "", list(other.names)
    if join.match == "number":
        if not number:
            raise ArgumentError("is missing; name the column with the number of the row", "number")
        names.remove(number)
    keys = [[f"{x:.17g}" for x in t[number]] if join.match == "number" else () for t in (first, other)]
    mine = JoinRows("the first recording", lambda k: f"row {k + 1}", len(first), keys[0], first.time)
    theirs = JoinRows("the other recording", lambda k: f"row {k + 1} of the other", len(other), keys[1], other.time)
    if join.match in IN_TIME:
        values = in_time(mine, theirs, {n: other[n] for n in names}, join, natures or {})
    else:
        if join.match == "number":
            (rows,) = by_number([mine], theirs, number, one_to_one=False)
        else:
            rows = by_order(mine, theirs)
        values = {n: other[n][rows] for n in names}
    return first.with_values(values, units={n: other.units[n] for n in names})
