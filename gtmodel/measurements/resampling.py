"""Resampling of uneven rows on an even grid, with an estimate of the interpolation error."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..results.interpolation import Nature, natures, rotations_again, smooth
from ..results.refusal import ArgumentError, naming
from ..results.trajectory import Trajectory
from ..results.trajectory_checks import Array
from .log import SHORT, LogError, Session, left_out
from .sampling import Gap, sampling_of

Method = Literal["cubic", "linear", "monotone"]
METHODS: tuple[Method, ...] = ("cubic", "linear", "monotone")
FEWEST = 8  # rows between gaps: every other one is left out to estimate the error
LEAST = 3  # rows on the grid between gaps
LONGEST_GAP = 5.0  # median steps: interpolation across a longer gap is a guess


@dataclass(frozen=True, eq=False)
class Resampled:
    """A recording on an even grid. `sessions`: one for each stretch between gaps that are too long to bridge.

    `error`: signal -> RMS interpolation error of each component, in the signal's unit. It is computed at every other
    row, from the remaining rows. With twice the spacing and the noise of the rows it overestimates the error on the
    grid; within bridged gaps the error is larger. `bridged`: gaps filled by interpolation; `cut`: gaps that split the
    recording. `natures`: the signals that are angles, quaternions, directions or rotation matrices.
    """

    sessions: tuple[Session, ...]
    method: Method
    error: Mapping[str, Array]
    bridged: tuple[Gap, ...]
    cut: tuple[Gap, ...]
    natures: Mapping[tuple[str, ...], Nature]

    @property
    def trajectory(self) -> Trajectory:
        """The trajectory of the only session. Raises LogError if gaps split the recording."""
        if len(self.sessions) != 1:
            raise LogError(
                f"'{self.sessions[0].name}' has {len(self.cut)} gaps too long to bridge, the first of "
                f"{self.cut[0].duration:.3g} s at {self.cut[0].time:.6g} s; use `sessions`, or increase `longest_gap`"
            )
        return self.sessions[0].trajectory

    @property
    def message(self) -> str:
        rows = sum(len(s.trajectory) for s in self.sessions)
        text = f"{rows} rows every {1e3 * self.sessions[0].sample_time:.6g} ms by {self.method} interpolation"
        if self.cut:
            text += f", in {len(self.sessions)} stretches between gaps"
        if self.bridged:
            text += f"; {sum(g.missing for g in self.bridged)} missing rows are bridged"
        return text


def resample(
    trajectory: Trajectory,
    sample_time: float | None = None,
    *,
    method: Method = "cubic",
    longest_gap: float | None = None,
    start: float | None = None,
    name: str = "log",
    at: Array | None = None,
) -> Resampled:
    """Resample a recording with uneven rows on an even grid.

    Args:
        trajectory: the recording; its rows may jitter and have gaps.
        sample_time: sample time of the grid [s]; default: the median step of the rows.
        method: "cubic" spline, "linear" interpolation, or "monotone" (cubic without overshoot). No method filters:
            apply a low-pass filter first if the grid is much coarser than the rows.
        longest_gap: longest gap that is bridged [s]; default: five median steps. A longer gap splits the recording.
        start: first time of the grid [s]; default: the time of the first row. All stretches share this grid.
        at: times of the rows to make [s], increasing, such as those of another recording, instead of a grid.

    Quaternions, rotation matrices and directions are recognised and remain valid between the rows; the sign of a
    quaternion does not jump. Wrapped angles are unwrapped in each stretch separately.

    A stretch of fewer than eight rows between gaps is left out. Raises LogError if there is no longer one, or if the
    sense of rotation between two rows is ambiguous; ArgumentError for a wrong argument.

    >>> rng = np.random.default_rng(0)
    >>> t = np.sort(0.01 * np.arange(500) + 0.003 * rng.uniform(-1, 1, 500))
    >>> log = gt.Trajectory(t, {"q": np.sin(4 * t)}, {"q": "rad"})
    >>> even = gt.measurements.resample(log, 0.01)
    >>> T = even.trajectory.time
    >>> float(np.abs(even.trajectory["q"] - np.sin(4 * T)).max()) < float(even.error["q"][0]) < 1e-5
    True
    """
    if method not in METHODS:
        raise ArgumentError(f"there is no method '{method}'; there are {', '.join(METHODS)}", "method")
    sampling = sampling_of(trajectory.time)
    with naming("sample_time", TypeError, ValueError):
        step = sampling.step if sample_time is None else float(sample_time)
    with naming("longest_gap", TypeError, ValueError):
        longest = LONGEST_GAP * sampling.step if longest_gap is None else float(longest_gap)
    with naming("start", TypeError, ValueError):
        origin = float(trajectory.time[0] if start is None else start)
    if not (np.isfinite(step) and step > 0):
        raise ArgumentError(f"the sample time is {step:g} s; expected more than zero", "sample_time")
    if not longest >= sampling.step:
        raise ArgumentError(
            f"the longest gap to bridge is {longest:g} s; expected at least the step of the rows, {sampling.step:g} s",
            "longest_gap",
        )
    time = trajectory.time
    steps = np.diff(time)
    breaks = np.flatnonzero(steps > longest) + 1
    pieces, most = list[tuple[int, int, Array, Array]](), (0, 0)
    for begin, end in zip([0, *breaks.tolist()], [*breaks.tolist(), len(time)], strict=True):
        first, last = np.ceil((time[begin] - origin) / step - 1e-9), np.floor((time[end - 1] - origin) / step + 1e-9)
        grid = origin + step * np.arange(first, last + 1)
        if at is not None:
            grid = at[(at >= time[begin] - 1e-9 * step) & (at <= time[end - 1] + 1e-9 * step)]
        most = max(most, (end - begin, len(grid)))
        if end - begin >= FEWEST and len(grid) >= LEAST:
            inside = np.clip(grid, time[begin], time[end - 1])
            pieces.append((begin, end, inside, inside if at is None else grid))
    if not pieces and most[0] < FEWEST:
        raise LogError(
            f"'{name}' has at most {most[0]} rows between gaps; expected at least {FEWEST}: bridge longer gaps "
            "(longest_gap), or cut the recording",
            "longest_gap",
        )
    if not pieces:
        raise LogError(
            f"'{name}': a sample time of {step:g} s leaves {most[1]} rows; expected at least {LEAST}", "sample_time"
        )
    dropped = left_out([trajectory])
    if short := len(time) - sum(end - begin for begin, end, _, _ in pieces):
        dropped[SHORT] = dropped.get(SHORT, 0) + short
    sessions, misses, kinds = list[Session](), dict[str, list[Array]](), natures(trajectory)
    for k, (begin, end, inside, grid) in enumerate(pieces):
        part = slice(begin, end)
        values, stretch = dict[str, Array](), smooth(_rows(trajectory, part), kinds)
        straight = stretch.resample(inside) if method == "linear" else None
        for signal in trajectory.names:
            y = np.asarray(stretch[signal], float)
            values[signal] = straight[signal] if straight is not None else _curve(method)(time[part], y)(inside)
            misses.setdefault(signal, []).append(_misses(method, time[part], y))
        values = rotations_again(values, kinds)
        label = name if not len(breaks) else f"{name} from {at_time(time[begin])}"
        sessions.append(Session(label, Trajectory(
            grid, values, {n: trajectory.unit(n) for n in trajectory.names}, title=trajectory.title,
            provenance={"resampled": method, "sample_time_s": step} | ({} if k else dropped),
            synthetic=trajectory.synthetic,
        ), step, k))  # fmt: skip
    error = {n: np.sqrt(np.mean(np.concatenate(parts) ** 2, axis=0)) for n, parts in misses.items()}
    bridged, cut = (tuple(g for g in sampling.gaps if (g.duration > longest) == over) for over in (False, True))
    return Resampled(tuple(sessions), method, error, bridged, cut, kinds)


def at_time(time: float) -> str:
    """Return a time for the name of a stretch; those since an epoch have more digits."""
    return f"{time:.6g} s" if abs(time) < 1e6 else f"{time:.3f} s"


def _rows(trajectory: Trajectory, part: slice) -> Trajectory:
    values = {name: trajectory[name][part] for name in trajectory.names}
    return Trajectory(trajectory.time[part], values, trajectory.units)


def _curve(method: Method) -> Callable[[Array, Array], Callable[[Array], Array]]:
    import scipy

    if method == "linear":
        return lambda t, y: scipy.interpolate.make_interp_spline(t, y, k=1)
    if method == "cubic":
        return lambda t, y: scipy.interpolate.CubicSpline(t, y)
    return lambda t, y: scipy.interpolate.PchipInterpolator(t, y)


def _misses(method: Method, time: Array, y: Array) -> Array:
    """Return the errors (rows, components) of interpolating the inner odd rows from the even ones."""
    even = slice(0, None, 2)
    odd = slice(1, len(time) - 1 if len(time) % 2 == 0 else None, 2)
    curve = _curve(method)(time[even], y[even])
    return (curve(time[odd]) - y[odd]).reshape(len(time[odd]), -1)
