"""`Trajectory`: one named, unit-carrying, immutable time series for every stage of gtmodel.

It is a simulation result, an optimum, a measurement, an initial guess and a scaling reference alike, so that
any of them can be handed to any engine, written to a file, read back and plotted.
"""

from __future__ import annotations

import difflib
import io
import json
import math
import os
import re
from collections.abc import Iterable, Mapping
from typing import Any, Literal, NoReturn

import numpy as np
import numpy.typing as npt

from gtmodel.lang.units import UnitError, si_unit

Array = npt.NDArray[np.float64]
Kind = Literal["linear", "pchip", "previous"]
PathLike = str | os.PathLike[str]

KINDS = ("linear", "pchip", "previous")
TIME_SLACK = 8 * np.finfo(float).eps  # relative; 3 * 0.1 may ask for the end of a trajectory that ends at 0.3
GRID_SLACK = 1e-9  # relative to dt; the rounding of duration / dt must not lose the last sample
REPR_SIGNALS = 6  # signals shown by repr

COLUMN = re.compile(r"(?P<base>.+)\[(?P<index>0|[1-9][0-9]*)\]")


class TrajectoryError(ValueError):
    """Data that make no trajectory, or a question it cannot answer. The message is one plain sentence."""


class UnknownNameError(KeyError):
    """A signal name that a trajectory does not hold; the sentence gives close matches."""

    def __str__(self) -> str:
        return str(self.args[0])


class Trajectory:
    """Named signals over one time grid, in SI units; immutable.

    time : (n,) finite and strictly increasing [s], n >= 1; copied.
    values : name -> (n,) for a scalar signal or (n, k) for a vector one, finite; copied. Names are printable
        and hold no blank or quote; "time" is reserved. The order of the names is kept.
    units : name -> SI unit text; a signal without one is dimensionless ("1").
    title : one line for plots and files.
    provenance : where the data came from (inputs, versions, hashes), JSON data.
    synthetic : None for measured or computed data; for data made to look like a measurement one line with
        seed and noise. It is carried into every file, repr and derived trajectory.

    Component i of a vector signal "T" can be asked for as "T[i]" wherever a name is read. A scalar signal may
    be called "x[0]" too, but never like a component of a vector signal next to it.

    Raises TrajectoryError naming the signal and row of the first fault, UnknownNameError for a unit of a
    signal that is not there. Two trajectories are equal when all of the above is.
    """

    __slots__ = ("_provenance", "_synthetic", "_time", "_title", "_units", "_values")
    __hash__ = None  # type: ignore[assignment]  # equality compares arrays
    __iter__ = None  # len() counts rows, so iterating could mean two things: use names or time
    _time: Array
    _values: dict[str, Array]
    _units: dict[str, str]
    _title: str
    _provenance: str
    _synthetic: str | None

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
        grid = _checked_time(time)
        signals = _checked_values(values, grid.size)
        known = {name: _checked_unit(name, (units or {}).get(name, "1")) for name in signals}
        for name in units or {}:
            if name not in signals:
                raise UnknownNameError(_unknown(name, signals, "units names the signal"))
        if synthetic is not None and not synthetic.strip():
            raise TrajectoryError("synthetic is empty; give seed and noise in one line, or None for real data")
        for attribute, value in (
            ("_time", grid),
            ("_values", signals),
            ("_units", known),
            ("_title", _one_line("title", title)),
            ("_provenance", _json_text(provenance or {})),
            ("_synthetic", None if synthetic is None else _one_line("synthetic", synthetic)),
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
        """Names of the signals, in the order they were given."""
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
        """Seed and noise when the data were made to look like a measurement, else None."""
        return self._synthetic

    def unit(self, name: str) -> str:
        """SI unit text of a signal or of a component of one; "1" when dimensionless.

        Raises UnknownNameError with close matches.
        """
        return self._units[self._find(name)[0]]

    def scale(self, name: str) -> float:
        """Largest absolute value of a signal over time and components, in its unit; 0.0 for a signal at rest.

        Raises UnknownNameError with close matches.
        """
        return float(np.max(np.abs(self[name])))

    def __len__(self) -> int:
        """Number of rows, that is of points in time."""
        return self._time.size

    def __contains__(self, name: object) -> bool:
        try:
            return isinstance(name, str) and bool(self._find(name))
        except UnknownNameError:
            return False

    def __getitem__(self, name: str) -> Array:
        """Signal "T" as (n,) or (n, k), component "T[0]" as (n,); read-only.

        Raises UnknownNameError with close matches.
        """
        signal, index = self._find(name)
        return self._values[signal] if index is None else self._values[signal][:, index]

    def __call__(self, t: npt.ArrayLike, name: str, kind: Kind = "linear") -> Any:
        """Value of a signal between its rows.

        t : scalar or (m,) times [s] inside the time grid.
        name : signal or component.
        kind : "linear"; "pchip", monotone cubic; or "previous", constant from a row up to the next one.

        Returns a float or (k,) for a scalar t, (m,) or (m, k) for an array; at the rows the values are exact.
        Raises TrajectoryError for a t outside the grid or an unknown kind, UnknownNameError for the name.
        """
        times = np.asarray(t, dtype=float)
        if times.ndim > 1:
            raise TrajectoryError(f"t has shape {times.shape}; expected a scalar or a one-dimensional array")
        value = _interpolate(self._time, self[name], self._inside(times), kind)
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
        """The same signals on another time grid.

        t : (m,) new times [s], strictly increasing and inside the grid; or
        dt : step [s] > 0 from the first time on. The last time is kept when the duration is a multiple of dt,
            otherwise the new grid ends before it.
        kind : as for calling the trajectory.

        Raises TrajectoryError unless exactly one of t and dt is given, and as calling does.
        """
        if (t is None) == (dt is None):
            raise TrajectoryError("resample() takes either times t or a step dt; give exactly one of them")
        times = self._steps(dt) if dt is not None else np.asarray(t, dtype=float)
        if times.ndim != 1:
            raise TrajectoryError(f"t has shape {times.shape}; expected (m,) new times, or a step as dt={t!r}")
        times = self._inside(times)
        return self._derived(
            times, {name: _interpolate(self._time, v, times, kind) for name, v in self._values.items()}
        )

    def select(self, names: str | Iterable[str]) -> Trajectory:
        """Only these signals or components, in this order; a component "T[0]" becomes a scalar signal.

        Raises UnknownNameError with close matches, TrajectoryError when no name is given.
        """
        wanted = [names] if isinstance(names, str) else list(names)
        values = {name: self[name] for name in wanted}
        return self._derived(self._time, values, {name: self.unit(name) for name in wanted})

    def with_values(
        self,
        values: Mapping[str, npt.ArrayLike] | None = None,
        /,
        units: Mapping[str, str] | None = None,
        **named: npt.ArrayLike,
    ) -> Trajectory:
        """These signals replaced or added, on the same time grid.

        values, named : name -> (n,) or (n, k). Use the mapping for a name that is no Python identifier.
        units : units of the signals given; a replaced signal keeps its unit, an added one is dimensionless.

        Raises TrajectoryError and UnknownNameError as the constructor does.
        """
        return self._derived(
            self._time,
            {**self._values, **(values or {}), **named},
            {**self._units, **(units or {})},
        )

    def merge(self, other: Trajectory) -> Trajectory:
        """The signals of both, which must share the time grid exactly and have no name in common.

        The title is that of self, or of other when self has none; both synthetic notes are kept, and two
        different provenances become ``{"merged": [self's, other's]}``.

        Raises TrajectoryError when the grids differ or a name is in both.
        """
        if not np.array_equal(self._time, other._time):
            raise TrajectoryError(
                f"the time grids differ ({_span(self)}, and {_span(other)}); resample one on the time of the "
                "other first"
            )
        twice = [name for name in other.names if name in self._values]
        if twice:
            raise TrajectoryError(
                f"signal {twice[0]!r} is in both trajectories; use select() or with_values() to say which one is meant"
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

    def to_csv(self, path: PathLike, *, overwrite: bool = False) -> None:
        """Write a CSV file: notes behind "#", a header "time [s],T[0] [m],...", one row per time.

        Floats are written in the shortest form that reads back exactly, so `from_csv` returns an equal
        trajectory, and equal trajectories give the same bytes.

        Raises FileExistsError when the file is there and `overwrite` is False.
        """
        origin = self._provenance if self.provenance else ""
        notes = {"title": self.title, "synthetic": self.synthetic, "provenance": origin}
        lines = [f"# {key}: {text}" for key, text in notes.items() if text]
        lines += [f"# scalar: {name}" for name, v in self._values.items() if v.ndim == 1 and COLUMN.fullmatch(name)]
        cells = ["time [s]"]
        for name, value in self._values.items():
            cells += [_quoted(f"{column} [{self._units[name]}]") for column in _columns(name, value)]
        lines.append(",".join(cells))
        table = np.column_stack([self._time, *self._values.values()])
        lines += [",".join(map(repr, row)) for row in table.tolist()]
        _write(path, ("\n".join(lines) + "\n").encode(), overwrite)

    @classmethod
    def from_csv(cls, path: PathLike) -> Trajectory:
        """Read a CSV file as `to_csv` writes it, or a measurement in that form.

        The first column is the time, in any unit of time; every column names its unit as "name [unit]". Units
        with a scale are converted, so that "time [ms]" and "q [mm]" arrive in s and m. Columns "T[0]", "T[1]"
        and so on that stand side by side, count up from 0 and share a unit become one signal "T" of shape
        (n, k), except where a note "# scalar: T[0]" says otherwise; with a gap or two units all of them stay
        scalar signals. Lines that begin with "#" are comments; of these "# title:", "# synthetic:" and
        "# provenance:" are read.

        Raises TrajectoryError with file, line and column: unreadable header, missing or unknown unit, a cell
        that is no finite number, a row of another length, time that does not increase. FileNotFoundError
        passes through.
        """
        from .trajectory_csv import read_csv

        return read_csv(path)

    def to_npz(self, path: PathLike, *, overwrite: bool = False) -> None:
        """Write a NumPy .npz file, exact and with the same bytes for equal trajectories.

        Raises FileExistsError when the file is there and `overwrite` is False.
        """
        header = dict(zip(("signals", "title", "provenance", "synthetic"), self._header(), strict=True))
        arrays = {f"value_{i}": value for i, value in enumerate(self._values.values())}
        buffer = io.BytesIO()
        np.savez(buffer, header=np.array(json.dumps(header)), time=self._time, **arrays)  # type: ignore[arg-type]
        _write(path, buffer.getvalue(), overwrite)

    @classmethod
    def from_npz(cls, path: PathLike) -> Trajectory:
        """Read what `to_npz` wrote. Raises TrajectoryError for another kind of file."""
        try:
            with np.load(path, allow_pickle=False) as data:
                header = json.loads(str(data["header"]))
                signals = dict(header["signals"])
                values = {name: data[f"value_{i}"] for i, name in enumerate(signals)}
                return cls(
                    data["time"],
                    values,
                    signals,
                    title=header["title"],
                    provenance=json.loads(header["provenance"]),
                    synthetic=header["synthetic"],
                )
        except FileNotFoundError:
            raise
        except Exception as error:
            raise TrajectoryError(
                f"{path} is not a trajectory written by to_npz() ({error}); write it again"
            ) from error

    # -- private -----------------------------------------------------------------------------------

    def _header(self) -> tuple[list[tuple[str, str]], str, str, str | None]:
        return list(self._units.items()), self._title, self._provenance, self._synthetic

    def _find(self, name: str) -> tuple[str, int | None]:
        """Signal and component index behind a name; index None for the whole signal."""
        if name in self._values:
            return name, None
        found = COLUMN.fullmatch(name) if isinstance(name, str) else None
        value = self._values.get(found["base"]) if found else None
        if not found or value is None or value.ndim == 1:
            raise UnknownNameError(_unknown(name, self._values, "there is no signal"))
        base, index = found["base"], int(found["index"])
        if index >= value.shape[1]:
            raise UnknownNameError(
                f"there is no component {name!r}: signal {base!r} has {value.shape[1]}, from "
                f"{_columns(base, value)[0]!r} to {_columns(base, value)[-1]!r}"
            )
        return base, index

    def _inside(self, times: Array) -> Array:
        """Times clipped to the grid when outside by rounding only; raises TrajectoryError when really out."""
        first, last = float(self._time[0]), float(self._time[-1])
        slack = TIME_SLACK * max(abs(first), abs(last))
        outside = ~((times >= first - slack) & (times <= last + slack))
        if outside.any():
            raise TrajectoryError(
                f"t = {float(times[outside].flat[0])!r} s is outside the trajectory, which runs from "
                f"{first!r} to {last!r} s"
            )
        return np.clip(times, first, last)

    def _steps(self, dt: float) -> Array:
        if not (math.isfinite(dt) and dt > 0 and math.isfinite(self.duration / dt)):
            raise TrajectoryError(f"dt is {dt!r}; expected a positive finite step in seconds")
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
    """What pickle and copy call."""
    return Trajectory(time, values, units, title=title, provenance=provenance, synthetic=synthetic)


# -- checks of the constructor ---------------------------------------------------------------------


def _frozen(data: npt.ArrayLike, what: str) -> Array:
    try:
        raw = np.asarray(data)
    except ValueError as error:
        raise TrajectoryError(f"{what} is no array ({error}); expected rows of equal length") from error
    if raw.dtype.kind not in "biuf":
        raise TrajectoryError(f"{what} holds {raw.dtype} data; expected real numbers")
    array = np.array(raw, dtype=np.float64, order="C")
    array.setflags(write=False)
    return array


def _checked_time(time: npt.ArrayLike) -> Array:
    grid = _frozen(time, "time")
    if grid.ndim != 1 or grid.size == 0:
        raise TrajectoryError(f"time has shape {grid.shape}; expected (n,) with n at least 1")
    if (bad := np.flatnonzero(~np.isfinite(grid))).size:
        raise TrajectoryError(f"time[{bad[0]}] is {float(grid[bad[0]])!r}; expected finite seconds")
    if (bad := np.flatnonzero(np.diff(grid) <= 0)).size:
        i = int(bad[0]) + 1
        raise TrajectoryError(
            f"time[{i}] = {float(grid[i])!r} s does not come after time[{i - 1}] = {float(grid[i - 1])!r} "
            "s; time must increase strictly, so sort the rows or remove the repeated one"
        )
    return grid


def _checked_values(values: Mapping[str, npt.ArrayLike], rows: int) -> dict[str, Array]:
    if not values:
        raise TrajectoryError("a trajectory needs at least one signal; values is empty")
    signals: dict[str, Array] = {}
    for name, data in values.items():
        check_name(name)
        value = _frozen(data, f"signal {name!r}")
        if value.ndim not in (1, 2) or value.shape[0] != rows or value.size == 0:
            raise TrajectoryError(
                f"signal {name!r} has shape {value.shape}; expected ({rows},) or ({rows}, k), a row for each time"
            )
        if (bad := np.argwhere(~np.isfinite(value))).size:
            row = int(bad[0][0])
            column = name if value.ndim == 1 else f"{name}[{bad[0][1]}]"
            raise TrajectoryError(
                f"signal {column!r} is {float(value[tuple(bad[0])])!r} in row {row}; expected finite "
                "numbers, so remove the row or fill the gap before"
            )
        signals[name] = value
    for name, value in signals.items():
        for column in _columns(name, value) if value.ndim == 2 else []:
            if column in signals:
                raise TrajectoryError(
                    f"signal {column!r} has the name of a component of the vector signal {name!r}; rename one of them"
                )
    return signals


def check_name(name: object) -> None:
    if not isinstance(name, str):
        raise TrajectoryError(f"a signal is named {name!r} of type {type(name).__name__}; expected a text")
    if not name or not name.isprintable() or any(mark in name for mark in ' "') or name.startswith("#"):
        raise TrajectoryError(
            f"signal name {name!r} cannot be written to a file; expected printable characters without "
            "blank or quote and no leading '#'"
        )
    if name == "time":
        raise TrajectoryError("a signal is named 'time', which is the name of the time grid; choose another name")


def _checked_unit(name: str, unit: str) -> str:
    try:
        return si_unit(unit).text
    except UnitError as error:
        raise TrajectoryError(f"signal {name!r}: {error}") from error


def _one_line(what: str, text: str) -> str:
    stripped = text.strip()
    if not stripped.isprintable():
        raise TrajectoryError(f"{what} is {text!r}; expected one line of printable characters")
    return stripped


def _json_text(provenance: Mapping[str, Any]) -> str:
    try:
        return json.dumps(dict(provenance), sort_keys=True, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise TrajectoryError(
            f"provenance cannot be written as JSON ({error}); give texts, finite numbers, lists and dictionaries"
        ) from error


# -- names -----------------------------------------------------------------------------------------


def _quoted(cell: str) -> str:
    """A header cell as CSV; names such as der(T,2) hold a comma."""
    return f'"{cell}"' if "," in cell else cell


def _columns(name: str, value: Array) -> list[str]:
    """Column names of a signal: itself, or one per component."""
    return [name] if value.ndim == 1 else [f"{name}[{i}]" for i in range(value.shape[1])]


def _unknown(name: object, signals: Mapping[str, Array], lead: str) -> str:
    known = [*signals, *(c for n, v in signals.items() if v.ndim == 2 for c in _columns(n, v))]
    close = difflib.get_close_matches(str(name), known, n=3)
    if close:
        return f"{lead} {name!r}; close matches are {', '.join(map(repr, close))}"
    shown = ", ".join(map(repr, list(signals)[:10]))
    return f"{lead} {name!r}; the trajectory holds {shown}{' and more' if len(signals) > 10 else ''}"


def _span(trajectory: Trajectory) -> str:
    return f"{len(trajectory)} rows from {float(trajectory.time[0])!r} to {float(trajectory.time[-1])!r} s"


# -- interpolation ---------------------------------------------------------------------------------


def _interpolate(grid: Array, value: Array, times: Array, kind: Kind) -> Array:
    """Values (..., k) at times inside the grid."""
    if kind not in KINDS:
        raise TrajectoryError(f"kind is {kind!r}; expected 'linear', 'pchip' or 'previous'")
    if kind == "previous" or grid.size == 1:
        return value[np.searchsorted(grid, times, side="right") - 1]
    if kind == "pchip":
        from scipy.interpolate import PchipInterpolator

        between = PchipInterpolator(grid, value, axis=0)(times)
        end = times == grid[-1]  # scipy evaluates the last polynomial there, which rounds
        return np.where(end[..., None] if value.ndim == 2 else end, value[-1], between)
    left = np.clip(np.searchsorted(grid, times, side="right") - 1, 0, grid.size - 2)
    weight = (times - grid[left]) / (grid[left + 1] - grid[left])
    weight = weight[..., None] if value.ndim == 2 else weight
    below, above = value[left], value[left + 1]
    return np.where(weight == 1.0, above, below + weight * (above - below))


# -- files -----------------------------------------------------------------------------------------


def _write(path: PathLike, data: bytes, overwrite: bool) -> None:
    try:
        with open(path, "wb" if overwrite else "xb") as file:
            file.write(data)
    except FileExistsError:
        raise FileExistsError(
            f"{path} is already there and was left alone; choose another path or pass overwrite=True"
        ) from None
