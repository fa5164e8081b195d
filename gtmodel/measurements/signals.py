"""Measured signals with a delay, a scale and an offset, each fixed or estimated, for all sessions or for each."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from .._lazy import hint
from ..inference.nonlinear import by_differences, nonlinear_fit
from ..results.interpolation import natures, rotations_again, smooth
from ..results.trajectory import Trajectory
from ..results.trajectory_checks import Array
from ..results.trajectory_files import PathLike
from .conversion import Conversion, Matrix, Numbers
from .log import JITTER, TIME, Column, LogError, Session, read_log, recordings_of

if TYPE_CHECKING:
    from .common_grid.options import AlignBy, EvenGrid
else:
    AlignBy = hint("gtmodel.measurements.common_grid.options", "AlignBy")
    EvenGrid = hint("gtmodel.measurements.common_grid.options", "EvenGrid")

Estimate = Literal["estimate"]
ESTIMATE: Estimate = "estimate"
What = Literal["delay", "scale", "offset"]
LONGEST_DELAY = 0.05  # s; the delay of a bus, a filter and a servo cycle together, not the offset between two clocks


@dataclass(frozen=True)
class Signal:
    """Columns of a log and their conversion: quantity(t) = coupling (factor * columns(t + delay)) - offset.

    The factor is the scale, with gear ratio and motor constant if they are given, see `Conversion`.

    Args:
        column, unit: name and unit of the column, see `Column`; components with different units have one unit each.
        scale: quantity per column [quantity_unit / unit], one number or one for each column.
        offset: scale times the reading at zero quantity [quantity_unit], one number or one for each component.
        delay: delay of the column [s], one number or one for each column.
        quantity_unit: SI unit of the quantity, or of each component; default: the unit of the column.
        per_session: which of the estimated corrections have a value for each session; stretches of one recording
            between gaps share it.
        gear_ratio, motor_constant, coupling: of the drives, see `Conversion`.
        time, stream, file: own time column, stream and file, as of a `Column`; see `read_signals`.

    Numbers fix scale, offset or delay; ESTIMATE leaves it to be estimated, see `Corrections`. Raises LogError if column
    and quantity differ in dimension and there is no scale.

    >>> gt.measurements.Signal("volts", "V", quantity_unit="N")
    Traceback (most recent call last):
        ...
    gtmodel.measurements.streams.form.LogError: ...give the scale in N per V, or scale = "estimate"
    """

    column: str | tuple[str, ...]
    unit: str | tuple[str, ...]
    scale: Numbers | Estimate = 1.0
    offset: Numbers | Estimate = 0.0
    delay: Numbers | Estimate = 0.0
    quantity_unit: str | tuple[str, ...] = ""
    per_session: tuple[What, ...] = ("offset",)
    gear_ratio: Numbers | None = None
    motor_constant: Numbers | None = None
    coupling: Matrix | None = None
    time: Column | None = None
    stream: str = ""
    file: str = ""

    def __post_init__(self) -> None:
        if not self.units:
            raise LogError(f"the column '{self.column}' has no unit; give one, or one for each of its columns")
        if self.scale != ESTIMATE:
            replace(self.conversion, scale=self.scale).check(self.units, self.column)

    @property
    def conversion(self) -> Conversion:
        """What the drives do to the columns, without this signal's scale and offset."""
        return Conversion(
            gear_ratio=self.gear_ratio, motor_constant=self.motor_constant, coupling=self.coupling,
            quantity_unit=self.quantity_unit,
        )  # fmt: skip

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the columns: one each, or one for all."""
        return (self.unit,) if isinstance(self.unit, str) else self.unit


class FreeCorrection(NamedTuple):
    """One correction to be estimated; `session` and `component` are None if it applies to all of them."""

    signal: str
    what: What
    session: int | None
    component: int | None

    @property
    def name(self) -> str:
        """Name such as "force.offset[0] of session 2"."""
        part = "" if self.component is None else f"[{self.component}]"
        return f"{self.signal}.{self.what}{part}" + ("" if self.session is None else f" of session {self.session + 1}")


class Corrections:
    """Delays, scales and offsets of the signals of some sessions, fixed or to be estimated.

    Args:
        signals: quantity -> `Signal`.
        sessions: sessions from `read_log`, with uncorrected columns.
        longest_delay: bound on an estimated delay [s].

    `free`: the corrections to be estimated, in the order of the argument of `apply`; `start`: their initial values.

    >>> t = 0.002 * np.arange(500)
    >>> log = gt.Trajectory(t, {"force": np.sin(5 * t)}, {"force": "V"})
    >>> signal = gt.measurements.Signal("volts", "V", scale=35.0, offset=2.0, quantity_unit="N")
    >>> corrections = gt.measurements.Corrections({"force": signal}, [gt.measurements.session_of(log)])
    >>> (session,) = corrections.apply()
    >>> session.trajectory.unit("force"), float(session.trajectory["force"].max().round(2))  # 35 - 2
    ('N', 33.0)
    """

    def __init__(
        self, signals: Mapping[str, Signal], sessions: Sequence[Session], *, longest_delay: float = LONGEST_DELAY
    ) -> None:
        self.signals = dict(signals)
        self.sessions = tuple(sessions)
        self.longest_delay = longest_delay
        self._recordings = recordings_of(self.sessions)
        self.free = tuple(_free(self.signals, self.sessions))
        self._places = {free: k for k, free in enumerate(self.free)}
        self.start = np.array([1.0 if free.what == "scale" else 0.0 for free in self.free])

    def apply(self, values: Array | Sequence[float] = (), *, still: str = "") -> tuple[Session, ...]:
        """Return the sessions with the quantities, in SI units, in place of the columns; `values` belong to `free`.

        Both ends are cut by the longest possible delay, so that the number of rows does not depend on `values`. A cubic
        spline interpolates between samples; apply a low-pass filter to noisy signals first.

        `still` names a signal that is not smooth, such as an effort with noise and with the steps of friction: its
        samples stay, and the other signals move by its mean delay instead. Only differences between the delays of its
        columns are interpolated. The time is then that of its samples.
        """
        return tuple(self._session(k, np.asarray(values, dtype=float), still) for k in range(len(self.sessions)))

    def bounds(self) -> tuple[Array, Array]:
        """Return lower and upper bounds of the estimated values; only delays are bounded."""
        most = np.array([self.longest_delay if free.what == "delay" else np.inf for free in self.free])
        return -most, most

    def estimate(self, residual: Callable[[tuple[Session, ...]], Array]) -> Array:
        """Return the values that minimise the sum of squares of residual(corrected sessions).

        residual : smooth and of constant length; it may eliminate further unknowns itself (variable projection). Better
            estimate offsets of a force as columns of the regressor, see `offset_columns`.

        Raises LogError if no minimum is found, or if a delay ends at its bound.
        """
        if not self.free:
            return np.zeros(0)
        size = self.sizes()
        residuals = by_differences(lambda z: residual(self.apply(z * size)), len(residual(self.apply(self.start))))
        names, most = [free.name for free in self.free], self.bounds()[1] / size
        fit = nonlinear_fit(
            residuals, self.start / size, names, bounds={n: (-m, m) for n, m in zip(names, most, strict=True)},
            hold_undetermined=True,
        )  # fmt: skip
        if fit.estimate is None:
            raise LogError(f"the estimation of {', '.join(names)} failed: {fit.message}")
        self.refuse_bounds(fit.x * size)
        return fit.x * size

    def refuse_bounds(self, values: Array) -> None:
        """Raise LogError if a delay is at its bound."""
        for free, value in zip(self.free, values, strict=True):
            if free.what == "delay" and abs(value) >= self.longest_delay * (1 - 1e-9):
                raise LogError(
                    f"the estimate of {free.name} has reached its bound, {1e3 * value:.3g} ms; "
                    "cut the logs to a common start, or set the delay"
                )

    def named(self, values: Array) -> dict[str, float]:
        """Return the estimated values by name; delays in s."""
        return {free.name: float(x) for free, x in zip(self.free, values, strict=True)}

    def sizes(self) -> Array:
        """Return a size for each value: a sample time, 1 for a scale, the signal's deviation for an offset."""
        return np.array([self._size(free) for free in self.free])

    def _size(self, free: FreeCorrection) -> float:
        if free.what == "delay":
            return min(session.sample_time for session in self.sessions)
        if free.what == "scale":
            return 1.0
        trajectory = self.sessions[self._recordings.index(free.session or 0)].trajectory
        return float(np.std(trajectory[free.signal])) or 1.0

    def _session(self, k: int, values: Array, still: str) -> Session:
        session = self.sessions[k]
        kinds = natures(session.trajectory.select([n for n in session.trajectory.names if n in self.signals]))
        raw, step = smooth(session.trajectory, kinds), session.sample_time
        reaches = {n: self._reach(s) for n, s in self.signals.items()}
        reach, common = max(reaches.values(), default=0.0), 0.0
        if still in raw and still in self.signals:
            width = 1 if raw[still].ndim == 1 else raw[still].shape[1]
            common = float(np.mean(self._values(still, self.signals[still], "delay", k, width, values)))
            reach += reaches[still]
        cut = int(np.ceil(reach / step - 1e-9))
        if 2 * cut + 3 > len(raw):
            raise LogError(f"'{session.name}' lasts {raw.duration:g} s, too short for delays of {reach:g} s")
        time = raw.time[cut : len(raw) - cut]
        quantities, units, late, moved = {}, {}, dict[str, Array](), set[str]()
        for name, signal in [(n, s) for n, s in self.signals.items() if n in raw]:
            width = 1 if raw[name].ndim == 1 else raw[name].shape[1]
            rows = raw[name].reshape(len(raw), width)
            delay = self._values(name, signal, "delay", k, width, values) - common
            columns = [_at(raw.time, rows[:, j], time, cut, float(delay[j])) for j in range(width)]
            late[name] = columns[0] if raw[name].ndim == 1 else np.column_stack(columns)
            moved |= {name} if np.any(delay != 0) else set()
        late = rotations_again(late, {group: nature for group, nature in kinds.items() if moved.intersection(group)})
        for name in raw.names:
            signal = self.signals.get(name)
            if signal is None:
                quantities[name], units[name] = raw[name][cut : len(raw) - cut], raw.unit(name)
                continue
            width = 1 if raw[name].ndim == 1 else raw[name].shape[1]
            scale, offset = (self._values(name, signal, what, k, width, values) for what in ("scale", "offset"))
            conversion = signal.conversion
            scaled = late[name].reshape(len(time), width) * (scale * conversion.factors(signal.units, width))
            corrected = conversion.coupled(scaled) - offset
            quantities[name] = corrected[:, 0] if raw[name].ndim == 1 else corrected
            units[name] = conversion.si_unit(signal.units)
        derived = Trajectory(
            time, quantities, units, title=raw.title, provenance=raw.provenance, synthetic=raw.synthetic
        )
        return session._replace(trajectory=derived)

    def _reach(self, signal: Signal) -> float:
        """Return the longest possible delay of a signal [s]."""
        return self.longest_delay if isinstance(signal.delay, str) else float(np.max(np.abs(signal.delay)))

    def _values(self, name: str, signal: Signal, what: What, k: int, width: int, values: Array) -> Array:
        fixed = getattr(signal, what)
        if not isinstance(fixed, str):
            return Conversion.each(what, fixed, width)
        session = self._recordings[k] if what in signal.per_session else None
        parts = range(width) if width > 1 else [None]
        return np.array([values[self._places[FreeCorrection(name, what, session, part)]] for part in parts])


def read_signals(
    paths: Sequence[PathLike],
    signals: Mapping[str, Signal],
    *,
    time: Column | None = TIME,
    session: str | None = None,
    sample_time: float | None = None,
    jitter: float = JITTER,
    grid: EvenGrid | None = None,
    align_by: Sequence[AlignBy] = (),
    curves: Mapping[str, Column] | None = None,
    **more: Any,
) -> tuple[Session, ...]:
    r"""Read the columns of the signals from one or several files as sessions, without corrections.

    Args:
        paths: files; each is a recording, unless signals name their files.
        signals: quantity -> its `Signal`; `Corrections` applies scale, offset and delay afterwards. Signals with their
            own time, stream or file are joined on the rows of the first signal, which must be even, or on `grid`. A
            signal's file may be a pattern, "*_currents.csv": the n-th file of each pattern belongs to recording n.
        grid: even grid on which uneven rows are resampled.
        align_by, curves: pairs that align the clocks, as in `resampling_study`; further columns for them alone. Without
            a pair a clock must have the time origin of the first signal. The key "joined" of the `provenance` of a
            joined session holds sentences about its clocks.

    Other arguments and errors as in `read_log`; raises ArgumentError if clocks have no times in common.

    >>> from pathlib import Path
    >>> written = Path("run.csv").write_text("time,volts\n0.0,1.0\n0.1,1.5\n0.2,1.0\n")
    >>> force = gt.measurements.Signal("volts", "V", scale=35.0, quantity_unit="N")
    >>> (session,) = gt.measurements.read_signals(["run.csv"], {"force": force})
    >>> session.trajectory["force"].tolist(), session.trajectory.unit("force")
    ([1.0, 1.5, 1.0], 'V')
    """
    columns = {n: Column(s.column, s.unit, s.time, s.stream, s.file) for n, s in signals.items()}
    several = any(c.time or c.stream or c.file for c in columns.values()) or (time is not None and time.per_channel)
    if align_by or curves or several:
        from .common_grid.joined_log import read_joined  # here: logs with one clock need no alignment

        if session is not None:
            raise LogError(
                f"the column '{session}' tells the recordings of one clock apart, but signals have their own clocks; "
                "give each recording its own files"
            )
        return read_joined(
            paths, columns, time=time, sample_time=sample_time, jitter=jitter, grid=grid, align_by=align_by,
            curves=curves or {}, **more,
        )  # fmt: skip
    options: dict[str, Any] = {"time": time, "session": session, "sample_time": sample_time, "jitter": jitter, **more}
    if grid is None:
        return tuple(part for path in paths for part in read_log(path, columns, **options))
    from .resampling import resample

    uneven = [part for path in paths for part in read_log(path, columns, uneven=True, **options)]
    how = {"method": grid.method, "longest_gap": grid.longest_gap}
    even = [resample(s.trajectory, grid.sample_time, name=s.name, **how) for s in uneven]
    return tuple(part for one in even for part in one.sessions)


def offset_columns(rows: Sequence[int], width: int = 1, *, per_session: bool = True) -> Array:
    """Return the regressor columns of the offsets of a measured force, (sum(rows) * width, offsets), zeros and ones.

    Args:
        rows: number of rows of each session; the sessions are stacked, with the `width` components of a row adjacent.
        width: number of components of the force.
        per_session: whether each session has its own offsets; False: one set for all.

    The offsets are ordered by session, then by component. The measured force is
    regressor @ parameters + these columns @ offsets.

    >>> gt.measurements.offset_columns([2, 1]).tolist()  # two sessions, a scalar force
    [[1.0, 0.0], [1.0, 0.0], [0.0, 1.0]]
    """
    sessions = np.repeat(np.arange(len(rows)), rows) if per_session else np.zeros(sum(rows), dtype=int)
    count = len(rows) if per_session else 1
    return np.kron(np.eye(count)[sessions], np.eye(width)).astype(float)


def _free(signals: Mapping[str, Signal], sessions: Sequence[Session]) -> list[FreeCorrection]:
    free, count = [], recordings_of(sessions)[-1] + 1
    for name, signal in signals.items():
        rows = sessions[0].trajectory[name]
        parts: Sequence[int | None] = [None] if rows.ndim == 1 else range(rows.shape[1])
        for what in ("delay", "scale", "offset"):
            if getattr(signal, what) == ESTIMATE:
                where: Sequence[int | None] = range(count) if what in signal.per_session else [None]
                free += [FreeCorrection(name, what, k, part) for k in where for part in parts]
    return free


def _at(time: Array, rows: Array, instants: Array, cut: int, delay: float) -> Array:
    if delay == 0.0:
        return rows[cut : len(rows) - cut]
    import scipy

    return scipy.interpolate.CubicSpline(time, rows)(instants + delay)
