"""Curves that do not depend on the frame of a sensor: the length of a vector, the angular speed of an orientation."""

from __future__ import annotations

import numpy as np

from ...lang.units import parse_unit
from ...results.interpolation import Nature, nature_of, smooth
from ...results.refusal import ArgumentError
from ...results.trajectory import Trajectory
from ...results.trajectory_checks import Array
from ..alignment.align import FEWEST
from .options import AlignBy, Curve

STEPS = 4  # default window of a speed, in steps of the slower clock
MOST_TURN = np.radians(150.0)  # in the window; the direction of a turn by 180 deg is ambiguous


def curves(first: Trajectory, other: Trajectory, pair: AlignBy) -> tuple[Trajectory, Trajectory]:
    """Return the common curve of a pair in both recordings, each under the name of its signal and on its own clock.

    The mean rate of an orientation between t - window / 2 and t + window / 2 is the turn between both, divided by the
    window. Vectors are averaged over the same window, so that speed and length are comparable. The windows of a curve
    do not overlap. Raises ArgumentError.
    """
    speeds = "speed" in (pair.reference_curve, pair.other_curve)
    window = pair.window or (STEPS * max(_step(first), _step(other)) if speeds else 0.0)
    return (
        _curve(first.select([pair.reference]), pair.reference, pair.reference_curve, window),
        _curve(other.select([pair.other]), pair.other, pair.other_curve, window),
    )


def _step(rows: Trajectory) -> float:
    return float(np.median(np.diff(rows.time)))


def _curve(rows: Trajectory, name: str, curve: Curve, window: float) -> Trajectory:
    if curve == "values":
        return rows
    if curve == "length" and (rows[name].ndim == 1 or nature_of(rows[name], rows.unit(name)) is not None):
        what = "a number" if rows[name].ndim == 1 else "a rotation or direction of constant length"
        raise ArgumentError(f"'{name}' is {what}; expected a vector, or take its values or its speed")
    time = rows.time
    if window:  # apart by the window: the noise of overlapping means would look like a motion
        time = np.arange(time[0] + window / 2, time[-1] - window / 2, window)
        if len(time) < FEWEST:
            raise ArgumentError(
                f"the window of {window:g} s leaves {len(time)} rows of '{name}'; expected at least {FEWEST}: choose a "
                "shorter one",
                "window",
            )
    unit = rows.unit(name)
    if curve == "length":
        values = np.linalg.norm(_mean(rows, name, time, window), axis=1)
    else:
        nature = nature_of(rows[name], unit, rows.time)
        ends = np.clip([time - window / 2, time + window / 2], rows.time[0], rows.time[-1])
        even = smooth(rows)
        before, after = (even.resample(end)[name] for end in ends)
        if nature not in (None, "angle"):
            turned = np.concatenate([[0.0], np.cumsum(_turn(even[name][:-1], even[name][1:], nature))])
            most = float(np.max(np.diff(np.interp(ends, even.time, turned), axis=0)))
            if most > MOST_TURN:
                raise ArgumentError(
                    f"'{name}' turns by {np.degrees(most):.3g} deg in {window:g} s; expected at most "
                    f"{np.degrees(MOST_TURN):.0f} deg, so choose a shorter window",
                    "window",
                )
        turn = _turn(before, after, nature)
        values = turn / window
        unit = parse_unit("rad/s" if nature is not None else f"{unit}/s").si_text
    return Trajectory(time, {name: values}, {name: unit}, synthetic=rows.synthetic)


def _mean(rows: Trajectory, name: str, time: Array, window: float) -> Array:
    """Return the means (n, k) of a vector signal over a window about each time."""
    if not window:
        return rows[name]
    import scipy

    integral = scipy.interpolate.make_interp_spline(rows.time, rows[name], k=1).antiderivative()
    return (integral(time + window / 2) - integral(time - window / 2)) / window


def _turn(before: Array, after: Array, nature: Nature | None) -> Array:
    """Return the distance between rows, for rotations and directions their angle [rad]."""
    if nature is None or nature == "angle":
        apart = (after - before).reshape(len(after), -1)
        return np.linalg.norm(apart, axis=1)
    if nature == "quaternion":
        after = after * np.where(np.sum(before * after, axis=1) < 0, -1.0, 1.0)[:, None]
        chord, sum_ = (np.linalg.norm(x, axis=1) for x in (after - before, after + before))
        return 4 * np.arctan2(chord, sum_)
    chord = np.linalg.norm(after - before, axis=1)
    return 2 * np.arcsin(np.clip(chord / (np.sqrt(8) if nature == "matrix" else 2.0), 0.0, 1.0))
