"""`Trajectory`: an immutable time series of named signals with units, for all parts of gtmodel.

Simulation results, optima, measurements, initial guesses and scaling references are trajectories, so that each of
them can be passed to any engine, written to a file, read back and plotted.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np
import numpy.typing as npt

from .._lazy import hint
from .interpolation import Kind, SmoothRows, interpolate
from .trajectory_checks import (
    COLUMN,
    Array,
    TrajectoryError,
    UnknownNameError,
    checked_time,
    checked_unit,
    checked_values,
    columns,
    json_text,
    one_line,
    unknown,
)
from .trajectory_csv import read_csv
from .trajectory_files import PathLike, read_npz, write_csv, write_npz

if TYPE_CHECKING:
    from matplotlib.figure import Figure
else:
    Figure = hint("matplotlib.figure", "Figure")

TIME_SLACK = 8 * np.finfo(float).eps  # relative; 3 * 0.1 may ask for the end of a trajectory that ends at 0.3
GRID_SLACK = 1e-9  # relative to dt; the rounding of duration / dt must not lose the last sample
REPR_SIGNALS = 6  # signals shown by repr


class Trajectory:
    """Named signals over one time grid, in SI units; immutable.

    Args:
        time: (n,) finite and strictly increasing [s], n >= 1; copied unless read-only.
        values: name -> (n,) for a scalar signal or (n, k) for a vector signal, finite; copied unless read-only. Names
            are printable, without blanks and quotes; "time" is reserved. The order of the names is kept.
        units: name -> SI unit text; a signal without one is dimensionless ("1").
        title: one line for plots and files.
        provenance: where the data came from (inputs, versions, hashes), JSON data.
        synthetic: None for measured or computed data; for synthetic measurements one line with seed and noise. It is
            copied into every file, repr and derived trajectory.

    "T[i]" is component i of a vector signal "T" wherever a name is read. A scalar signal may be called "x[0]" too,
    unless that is a component of a vector signal in the same trajectory.

    Raises TrajectoryError with the signal and row of the first fault, UnknownNameError for a unit of an unknown
    signal. Two trajectories are equal if all of the above is equal.

    >>> motion = gt.Trajectory([0.0, 0.1, 0.2], {"T": [[0.0, 0.0], [0.1, 0.0], [0.4, 0.1]]}, {"T": "m"})
    >>> motion["T[0]"].tolist(), motion.unit("T"), motion.duration
    ([0.0, 0.1, 0.4], 'm', 0.2)
    >>> motion(0.15, "T").round(6).tolist()  # linear between two rows
    [0.25, 0.05]
    """

    __slots__ = ("_provenance", "_smooth", "_synthetic", "_time", "_title", "_units", "_values")
    __hash__ = None  # type: ignore[assignment]  # equality compares arrays
    __iter__ = None  # len() counts rows, so iterating could mean two things: use names or time
    _time: Array
    _values: dict[str, Array]
    _units: dict[str, str]
    _title: str
    _provenance: str
    _synthetic: str | None
    _smooth: SmoothRows | None  # once somebody asks for values between the rows

    def __init__(
        self,
        time: npt.ArrayLike,
        values: Mapping[str, npt.ArrayLike],
        units: Mapping[str, str] | None = None,
        *,
        title: str = "",
        provenance: Mapping[str, Any] | None = None,
        synthetic: str | None = None,
    ) -> None:
        grid = checked_time(time)
        signals = checked_values(values, grid.size)
        known = {name: checked_unit(name, (units or {}).get(name, "1")) for name in signals}
        for name in units or {}:
            if name not in signals:
                raise UnknownNameError(unknown(name, signals, "units names the signal"))
        if synthetic is not None and not synthetic.strip():
            raise TrajectoryError("synthetic is empty; give seed and noise in one line, or None for real data")
        for attribute, value in (
            ("_time", grid),
            ("_values", signals),
            ("_units", known),
            ("_title", one_line("title", title)),
            ("_provenance", json_text(provenance or {})),
            ("_synthetic", None if synthetic is None else one_line("synthetic", synthetic)),
            ("_smooth", None),
        ):
            object.__setattr__(self, attribute, value)

    def __setattr__(self, name: str, value: Any) -> NoReturn:
        raise AttributeError(
            f"a trajectory is immutable, so {name!r} cannot be set; use with_values() to get a new one"
        )

    def __delattr__(self, name: str) -> NoReturn:
        raise AttributeError(f"a trajectory is immutable, so {name!r} cannot be deleted; use select() to get a new one")

    def __reduce__(self) -> tuple[Any, ...]:
        return _rebuild, (self._time, self._values, self._units, self.title, self.provenance, self.synthetic)

    # -- reading -----------------------------------------------------------------------------------

    @property
    def time(self) -> Array:
        """(n,) the time grid [s], read-only."""
        return self._time

    @property
    def duration(self) -> float:
        """Last minus first time [s]."""
        return float(self._time[-1] - self._time[0])

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the signals in their original order."""
        return tuple(self._values)

    @property
    def units(self) -> dict[str, str]:
        """Name -> unit text, a new dictionary."""
        return dict(self._units)

    @property
    def title(self) -> str:
        """One line for plots and files; may be empty."""
        return self._title

    @property
    def provenance(self) -> dict[str, Any]:
        """Where the data came from; a new dictionary at every call."""
        return json.loads(self._provenance)

    @property
    def synthetic(self) -> str | None:
        """Seed and noise of synthetic measurements, otherwise None."""
        return self._synthetic

    def unit(self, name: str) -> str:
        """Return the SI unit text of a signal or component; "1" if dimensionless.

        Raises UnknownNameError with close matches.
        """
        return self._units[self._find(name)[0]]

    def scale(self, name: str) -> float:
        """Return the largest absolute value of a signal over time and components, in its unit.

        Raises UnknownNameError with close matches.
        """
        return float(np.max(np.abs(self[name])))

    def __len__(self) -> int:
        """Number of rows, that is of points in time."""
        return self._time.size

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str) and self._place(name) is not None

    def __getitem__(self, name: str) -> Array:
        """Signal "T" as (n,) or (n, k), component "T[0]" as (n,); read-only.

        Raises UnknownNameError with close matches.
        """
        signal, index = self._find(name)
        return self._values[signal] if index is None else self._values[signal][:, index]

    def __call__(self, t: npt.ArrayLike, name: str, kind: Kind = "linear") -> Any:
        """Return the value of a signal between its rows.

        t : scalar or (m,) times [s] inside the time grid.
        name : signal or component.
        kind : "linear"; "pchip", monotone cubic; or "previous", constant from a row up to the next one.

        Returns a float or (k,) for a scalar t, (m,) or (m, k) for an array; at the rows the values are exact. Except
        for "previous", wrapped angles are unwrapped, quaternions have no jumps of sign, and quaternions, directions and
        rotation matrices keep their norm: "linear" rotates from row to row about a constant axis at constant speed. A
        component is interpolated with its whole signal; a component selected alone is a plain number.
        Raises TrajectoryError for a t outside the grid, an unknown kind, and a turn of more than 90 deg from row to
        row; UnknownNameError for the name.
        """
        times = _seconds(t, "t")
        if times.ndim > 1:
            raise TrajectoryError(f"t has shape {times.shape}; expected a scalar or a one-dimensional array")
        signal, index = self._find(name)
        value = self._at(self._inside(times), [signal], kind)[signal]
        value = value if index is None else value[..., index]
        return float(value) if value.ndim == 0 else value

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Trajectory):
            return NotImplemented
        return (
            self._header() == other._header()
            and np.array_equal(self._time, other._time)
            and all(np.array_equal(self._values[name], other._values[name]) for name in self._values)
        )

    def __repr__(self) -> str:
        signals = [
            f"{name}{f' ({self._values[name].shape[1]})' if self._values[name].ndim == 2 else ''} [{self._units[name]}]"
            for name in self.names[:REPR_SIGNALS]
        ]
        if len(self.names) > REPR_SIGNALS:
            signals.append(f"and {len(self.names) - REPR_SIGNALS} more")
        rows = f"{len(self)} rows from {self._time[0]:g} to {self._time[-1]:g} s"
        parts = [repr(self.title)] if self.title else []
        parts += ["synthetic"] if self.synthetic else []
        return f"Trajectory({', '.join([*parts, rows])}: {', '.join(signals)})"

    # -- new trajectories --------------------------------------------------------------------------

    def resample(self, t: npt.ArrayLike | None = None, *, dt: float | None = None, kind: Kind = "linear") -> Trajectory:
        """Return the signals on another time grid.

        t : (m,) new times [s], strictly increasing and inside the grid; or
        dt : step [s] > 0 from the first time on. The last time is kept if the duration is a multiple of dt,
            otherwise the new grid ends before it.
        kind : as for a call of the trajectory, also for rotations and wrapped angles.

        Raises TrajectoryError unless exactly one of t and dt is given, and as a call does.
        """
        if (t is None) == (dt is None):
            raise TrajectoryError("resample() takes either times t or a step dt; give exactly one of them")
        times = self._steps(dt) if dt is not None else _seconds(t, "t")
        if times.ndim != 1:
            raise TrajectoryError(f"t has shape {times.shape}; expected (m,) new times, or a step as dt={t!r}")
        times = self._inside(times)
        return self._derived(times, self._at(times, self.names, kind))

    def select(self, names: str | Iterable[str]) -> Trajectory:
        """Return only these signals or components, in this order; a component "T[0]" becomes a scalar signal.

        Raises UnknownNameError with close matches, TrajectoryError without a name.
        """
        selected = [names] if isinstance(names, str) else list(names)
        values = {name: self[name] for name in selected}
        return self._derived(self._time, values, {name: self.unit(name) for name in selected})

    def with_values(
        self,
        values: Mapping[str, npt.ArrayLike] | None = None,
        /,
        units: Mapping[str, str] | None = None,
        **named: npt.ArrayLike,
    ) -> Trajectory:
        """Return a copy with these signals replaced or added, on the same time grid.

        values, named : name -> (n,) or (n, k). Use the mapping for a name that is not a Python identifier.
        units : units of these signals; without one, a replaced signal keeps its unit and a new signal is dimensionless.

        Raises TrajectoryError and UnknownNameError as the constructor does.
        """
        return self._derived(
            self._time,
            {**self._values, **(values or {}), **named},
            {**self._units, **(units or {})},
        )

    def merge(self, other: Trajectory) -> Trajectory:
        """Return the signals of both trajectories, which must have the same time grid and no common name.

        The title is that of self, or of other if self has none; both synthetic notes are kept, and two different
        provenances become ``{"merged": [self's, other's]}``.

        Raises TrajectoryError if the grids differ or a name is in both.
        """
        if not np.array_equal(self._time, other._time):
            raise TrajectoryError(
                f"the time grids differ ({_span(self)}, and {_span(other)}); resample one on the time of the "
                "other first"
            )
        twice = [name for name in other.names if name in self._values]
        if twice:
            raise TrajectoryError(
                f"signal {twice[0]!r} is in both trajectories; use select() or with_values() to choose one"
            )
        notes = list(dict.fromkeys(note for note in (self.synthetic, other.synthetic) if note))
        origins = [origin for origin in (self.provenance, other.provenance) if origin]
        one = len(origins) < 2 or self._provenance == other._provenance
        return Trajectory(
            self._time,
            {**self._values, **other._values},
            {**self._units, **other._units},
            title=self.title or other.title,
            provenance=(origins[0] if origins else {}) if one else {"merged": origins},
            synthetic="; ".join(notes) or None,
        )

    # -- files -------------------------------------------------------------------------------------

    def plot(self, *names: str, marks: Sequence[float] = ()) -> Figure:
        """Return a matplotlib figure of the named signals over time, or of all; one panel for each unit.

        marks: times [s] with a thin line in every panel. Raises UnknownNameError.
        """
        for name in names:
            self._find(name)
        draw = import_module("gtmodel.plot.signals").signals_figure  # by name: results must not depend on gtmodel.plot
        return draw(self, list(names) or None, marks=marks)

    def to_pandas(self) -> Any:
        """Return a pandas DataFrame with time [s] as index and a column for each component, "T[0] [m]".

        Raises ModuleNotFoundError if pandas is not installed.
        """
        pandas = import_module("pandas")
        table = {}
        for name in self.names:
            values = self[name]
            parts = values.reshape(len(values), -1).T
            table |= {f"{c} [{self.unit(name)}]": part for c, part in zip(columns(name, values), parts, strict=True)}
        return pandas.DataFrame(table, index=pandas.Index(self.time, name="time [s]"))

    def to_csv(self, path: PathLike, *, overwrite: bool = False) -> None:
        """Write a CSV file: notes after "#", a header "time [s],T[0] [m],...", one row per time.

        Floats are written in the shortest form that reads back exactly, so `from_csv` returns an equal
        trajectory, and equal trajectories give identical files.

        Raises FileExistsError if the file exists and `overwrite` is False.
        """
        write_csv(self, path, overwrite)

    @classmethod
    def from_csv(cls, path: PathLike) -> Trajectory:
        """Read a CSV file in the format of `to_csv`.

        The first column is the time, in any unit of time; the header of each column is "name [unit]". Values are
        converted to SI: "time [ms]" and "q [mm]" become s and m. Adjacent columns "T[0]", "T[1]", ... that count
        from 0 and have the same unit become one signal "T" of shape (n, k), unless a note "# scalar: T[0]" says
        otherwise; with a gap or different units all of them stay scalar signals. Lines that begin with "#" are
        comments; the comments "# title:", "# synthetic:" and "# provenance:" are read.

        Raises TrajectoryError with file, line and column for an unreadable header, a missing or unknown unit, a cell
        that is not a finite number, a row of a different length, and time that does not increase. FileNotFoundError
        passes through.
        """
        return read_csv(cls, path)

    def to_npz(self, path: PathLike, *, overwrite: bool = False) -> None:
        """Write a NumPy .npz file, exact, and identical for equal trajectories.

        Raises FileExistsError if the file exists and `overwrite` is False.
        """
        write_npz(self, path, overwrite)

    @classmethod
    def from_npz(cls, path: PathLike) -> Trajectory:
        """Read a file written by `to_npz`. Raises TrajectoryError for any other file."""
        return read_npz(cls, path)

    # -- private -----------------------------------------------------------------------------------

    def _header(self) -> tuple[list[tuple[str, str]], str, str, str | None]:
        return list(self._units.items()), self._title, self._provenance, self._synthetic

    def _find(self, name: str) -> tuple[str, int | None]:
        """Signal and component index of a name; index None for the whole signal. Raises UnknownNameError."""
        place = self._place(name)
        if place is not None:
            return place
        match = COLUMN.fullmatch(name) if isinstance(name, str) else None
        value = self._values.get(match["base"]) if match else None
        if name == "time":
            raise UnknownNameError("the times are no signal; use the attribute .time")
        if not match or value is None or value.ndim == 1:
            raise UnknownNameError(unknown(name, self._values, "there is no signal"))
        base = match["base"]
        raise UnknownNameError(
            f"there is no component {name!r}: signal {base!r} has {value.shape[1]}, from "
            f"{columns(base, value)[0]!r} to {columns(base, value)[-1]!r}"
        )

    def _place(self, name: str) -> tuple[str, int | None] | None:
        """As `_find`, but None for an unknown name."""
        if name in self._values:
            return name, None
        match = COLUMN.fullmatch(name) if isinstance(name, str) else None
        value = self._values.get(match["base"]) if match else None
        if not match or value is None or value.ndim == 1 or int(match["index"]) >= value.shape[1]:
            return None
        return match["base"], int(match["index"])

    def _at(self, times: Array, names: Iterable[str], kind: Kind) -> dict[str, Array]:
        """Values of whole signals at times inside the grid; the columns of a rotation are interpolated together."""
        if kind == "previous":
            return {name: interpolate(self._time, self._values[name], times, kind) for name in names}
        if self._smooth is None:
            object.__setattr__(self, "_smooth", SmoothRows(self))
        result = dict[str, Array]()
        for name in names:
            if name not in result and self._smooth is not None:
                group, nature, rows = self._smooth(self, name)
                value = interpolate(self._time, rows, times, kind, nature)
                result |= {name: value} if len(group) == 1 else {n: value[..., k] for k, n in enumerate(group)}
        return {name: result[name] for name in names}

    def _inside(self, times: Array) -> Array:
        """Times, clipped to the grid if outside only by rounding. Raises TrajectoryError otherwise."""
        first, last = float(self._time[0]), float(self._time[-1])
        slack = TIME_SLACK * max(abs(first), abs(last))
        outside = ~((times >= first - slack) & (times <= last + slack))
        if outside.any():
            raise TrajectoryError(
                f"t = {float(times[outside].flat[0])!r} s is outside the trajectory, which runs from "
                f"{first!r} to {last!r} s"
            )
        return np.clip(times, first, last)

    def _steps(self, step: float) -> Array:
        dt = _seconds(step, "dt")
        if dt.ndim or not (math.isfinite(dt) and dt > 0 and math.isfinite(self.duration / dt)):
            raise TrajectoryError(f"dt is {step!r}; expected a positive finite step in seconds")
        count = math.floor(self.duration / dt + GRID_SLACK)
        times = self._time[0] + dt * np.arange(count + 1)
        if abs(times[-1] - self._time[-1]) <= GRID_SLACK * dt:
            times[-1] = self._time[-1]
        return times

    def _derived(
        self, time: Array, values: Mapping[str, npt.ArrayLike], units: Mapping[str, str] | None = None
    ) -> Trajectory:
        return Trajectory(
            time,
            values,
            self._units if units is None else units,
            title=self.title,
            provenance=self.provenance,
            synthetic=self.synthetic,
        )


def _rebuild(
    time: Array,
    values: dict[str, Array],
    units: dict[str, str],
    title: str,
    provenance: dict[str, Any],
    synthetic: str | None,
) -> Trajectory:
    """Constructor for pickle and copy."""
    return Trajectory(time, values, units, title=title, provenance=provenance, synthetic=synthetic)


def _seconds(value: Any, what: str) -> Array:
    try:
        return np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise TrajectoryError(f"{what} is {value!r}; expected seconds, as numbers") from None


def _span(trajectory: Trajectory) -> str:
    return f"{len(trajectory)} rows from {float(trajectory.time[0])!r} to {float(trajectory.time[-1])!r} s"
