"""Inputs of a simulation: constants, functions of time, tables as piecewise polynomials, trajectories."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, TypeVar

import casadi as ca
import numpy as np
import scipy

from ..compiler.flat import FlatModel
from ..lang.expression import Expr, gathered
from ..lang.slips import floats, line_of, shortened
from ..lang.source import ModelError, about
from ..lang.units import si_unit
from ..results.trajectory import Trajectory, TrajectoryError, UnknownNameError

# polynomial coefficients of one piece; n coefficients give n - 1 derivatives
INTERPOLATIONS = {"previous": 1, "linear": 2, "cubic": 4}


@dataclass(eq=False)
class InputTable:
    """A scalar function of time given by rows; constant before the first and after the last row."""

    name: str
    times: np.ndarray
    values: np.ndarray
    interpolation: str = "linear"

    @property
    def coefficients(self) -> int:
        return INTERPOLATIONS[self.interpolation]

    @cached_property
    def _rows(self) -> np.ndarray:
        """Value and derivatives at the beginning of each piece, one row per time."""
        n = len(self.times)
        rows = np.zeros((n, self.coefficients))
        rows[:, 0] = self.values
        if n > 1 and self.interpolation == "linear":
            rows[:-1, 1] = np.diff(self.values) / np.diff(self.times)
        elif n > 1 and self.interpolation == "cubic":
            rows[:-1] = scipy.interpolate.CubicSpline(self.times, self.values).c[::-1].T * [
                math.factorial(k) for k in range(4)
            ]
        return rows

    def largest(self, order: int) -> float:
        """Return the largest absolute value of a derivative at the rows."""
        return float(np.max(np.abs(self._rows[:, order])))

    def piece(self, start: float, before: bool = False) -> np.ndarray:
        """Return value and derivatives at a time, from the piece after it, or from the piece `before` it."""
        k = int(np.searchsorted(self.times, start, side="left" if before else "right")) - 1
        if k < 0:
            return np.concatenate([self.values[:1], np.zeros(self.coefficients - 1)])
        row, after = self._rows[k].tolist(), float(start - self.times[k])
        if not after:  # as at most restarts; + 0.0: no negative zero, as in the sums below
            return self._rows[k] + 0.0
        n = self.coefficients
        return np.array([sum(row[j] * after ** (j - i) / math.factorial(j - i) for j in range(i, n)) for i in range(n)])


Shape = tuple[int, ...]
Entry = TypeVar("Entry")


@dataclass(eq=False)
class SimulationInputs:
    """Scalar known variables as functions of time.

    `functions`: index -> expression of `t`; `tables`: index -> InputTable; `constants`: index -> value; `parameters`:
    place in `flat.p` -> value, for the parameters that vary between runs. `p` holds a reference time, the polynomial
    coefficients of each table at that time in the order of the indices, the constants, and the parameters. It is
    constant between `knots`; the integrator restarts at each knot.
    """

    flat: FlatModel
    t: ca.SX
    functions: dict[int, ca.SX]
    tables: dict[int, InputTable]
    constants: dict[int, float] = field(default_factory=dict)
    parameters: dict[int, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        size = 1 + sum(table.coefficients for table in self.tables.values())
        self._constant = {index: size + n for n, index in enumerate(sorted(self.constants))}
        last = size + len(self.constants)
        self._parameter = {place: last + n for n, place in enumerate(sorted(self.parameters))}
        self.p = ca.SX.sym("p", last + len(self.parameters))
        self._first: dict[int, int] = {}
        column = 1
        for index in sorted(self.tables):
            self._first[index] = column
            column += self.tables[index].coefficients

    @property
    def known(self) -> list[int]:
        return sorted([*self.functions, *self.tables, *self.constants])

    @cached_property
    def structure(self) -> Hashable:
        """A key that is equal for inputs that differ only in numbers: table rows, constants and parameters."""
        of_time = [self.functions[index] for index in sorted(self.functions)]
        text = ca.Function("inputs", [self.t], [ca.vertcat(*of_time)]).serialize() if of_time else ""
        tables = tuple((index, self.tables[index].coefficients) for index in sorted(self.tables))
        return tuple(sorted(self.functions)), text, tables, tuple(sorted(self.constants)), tuple(self._parameter)

    def knots(self, start: float, end: float) -> np.ndarray:
        """Return the times strictly inside an interval at which a table has a corner or a discontinuity."""
        times = np.unique(np.concatenate([np.zeros(0), *(table.times for table in self.tables.values())]))
        return times[(times > start) & (times < end)]

    def piece(self, start: float, before: bool = False) -> np.ndarray:
        """Return the values of `p` from a time to the next knot; `before`: for the piece that ends at that time."""
        pieces = [self.tables[index].piece(start, before) for index in sorted(self.tables)]
        numbers = [values[key] for values in (self.constants, self.parameters) for key in sorted(values)]
        return np.concatenate([[start], *pieces, numbers])

    def with_parameters(self, p: np.ndarray, numbers: Mapping[int, float]) -> np.ndarray:
        """Return `p` with other parameter values, given by place in `flat.p`."""
        p = p.copy()
        p[[self._parameter[place] for place in numbers]] = list(numbers.values())
        return p

    def symbol_of(self, place: int) -> ca.SX:
        """Return the symbol in `p` of a varied parameter."""
        return self.p[self._parameter[place]]

    @property
    def varied(self) -> tuple[ca.SX, ca.SX]:
        """The model's symbols of the varied parameters, and their symbols in `p`."""
        symbols = [self.flat.parameters[place].symbol for place in self._parameter]
        return ca.SX(ca.vertcat(*symbols)), self.p[list(self._parameter.values())]

    def values(self, pairs: list[tuple[int, int]], time: float) -> list[float]:
        """Return the values of known variables' derivatives (index, order) at a time."""
        if all(index in self.constants for index, _ in pairs):
            return [self.constants[index] if order == 0 else 0.0 for index, order in pairs]
        column = ca.vertcat(*[self.expression(*pair) for pair in pairs])
        return (
            np.asarray(ca.Function("values", [self.t, self.p], [column])(time, self.piece(time))).reshape(-1).tolist()
        )

    def expression(self, index: int, order: int) -> ca.SX:
        """Return a derivative of a known variable as an expression of t and p."""
        if index in self.functions:
            e = self.functions[index]
            for _ in range(order):
                e = ca.jacobian(e, self.t)
            return ca.densify(e)
        if index in self.constants:
            return self.p[self._constant[index]] if order == 0 else ca.SX(0.0)
        if index not in self.tables:
            name = self.flat.variables[index].name
            raise ModelError(f"input '{name}' needs a value; give inputs={{'{name}': ...}}")
        table = self.tables[index]
        if order >= table.coefficients:
            name = self.flat.symbol_name(index, order)
            raise ModelError(
                f"the model needs {name}, which a table with '{table.interpolation}' interpolation does not have; give "
                "a function of time, or the table with 'cubic' interpolation"
            )
        first, after = self._first[index], self.t - self.p[0]
        value = ca.SX(0)
        for k in reversed(range(order, table.coefficients)):  # Horner on Taylor coefficients: c_k after^k / k!
            value = value * after / (k - order + 1) + self.p[first + k]
        return value


def read_inputs(
    flat: FlatModel, inputs: Mapping[str, Any], parameters: Mapping[int, float] | None = None
) -> SimulationInputs:
    """Convert a user's inputs, by name.

    Each value is a number or array; a function of time that uses NumPy's or gtmodel's functions
    (``lambda t: [0.0, np.sin(3 * t)]``); a pair (times, values); or a Trajectory that holds the name. A table is
    "linear" between its rows unless ((times, values), interpolation) or (trajectory, interpolation) selects another
    interpolation. "previous" is a zero-order hold (a recorded row at a discontinuity has the value before it); "cubic"
    is a spline with two derivatives. For "linear" and "cubic", wrapped angles of a trajectory are unwrapped and sign
    changes of a quaternion are removed. Every table is constant before its first and after its last row.

    Raises ModelError for a wrong name, shape or unit, and for a function that cannot be evaluated symbolically.
    """
    t = ca.SX.sym("t")
    functions: dict[int, ca.SX] = {}
    tables: dict[int, InputTable] = {}
    constants: dict[int, float] = {}
    for name, value in inputs.items():
        with about(f"inputs.{name}"):
            shape, indices, order = flat.lookup(name)
            if order:
                raise ModelError(f"input '{name}' is a derivative; give the variable itself as a function of time")
            repeated = [flat.variables[i].name for i in indices if i in functions or i in tables or i in constants]
            if repeated:
                raise ModelError(f"input '{repeated[0]}' is given twice")
            table = _table(flat, name, indices[0], value)
            if table is not None:
                times, values, interpolation = table
                columns = _columns(name, shape, len(indices), times, values)
                tables |= {i: InputTable(name, times, columns[:, k], interpolation) for k, i in enumerate(indices)}
                continue
            if callable(value):
                functions |= _by_index(name, indices, _symbolic(flat, name, value, t))
            else:
                constants |= _by_index(name, indices, _constant(name, value))
    return SimulationInputs(flat, t, functions, tables, constants, dict(parameters or {}))


def _by_index(name: str, indices: list[int], entries: list[Entry]) -> dict[int, Entry]:
    """Return the entries of an input by the indices of its variables; a single entry applies to all."""
    if len(entries) not in (1, len(indices)):
        raise ModelError(f"input '{name}' has {len(indices)} entries; found {len(entries)}")
    return dict(zip(indices, entries if len(entries) > 1 else entries * len(indices), strict=True))


def _table(flat: FlatModel, name: str, index: int, value: Any) -> tuple[np.ndarray, np.ndarray, str] | None:
    """Return (times, values, interpolation) if the value is a table or a trajectory, else None."""
    interpolation = "linear"
    if isinstance(value, tuple) and len(value) == 2 and isinstance(value[1], str):
        if not isinstance(value[0], (Trajectory, tuple)):
            raise ModelError(f"input '{name}' takes ((times, values), interpolation) or (Trajectory, interpolation)")
        value, interpolation = value
        if interpolation not in INTERPOLATIONS:
            raise ModelError(
                f"input '{name}': there is no interpolation '{interpolation}'; use one of {', '.join(INTERPOLATIONS)}"
            )
    if isinstance(value, Trajectory):
        try:
            values, unit = value[name], value.unit(name)
        except UnknownNameError as error:
            raise ModelError(f"input '{name}': {error}") from None
        expected = flat.variables[index].unit
        if expected is not None and si_unit(expected).dimension != si_unit(unit).dimension:
            raise ModelError(f"input '{name}' is in {expected}; found {unit} in the trajectory")
        if interpolation != "previous":
            try:
                values = value(value.time, name)
            except TrajectoryError as error:
                raise ModelError(f"input '{name}': {error}") from None
        return value.time, values, interpolation
    if isinstance(value, tuple) and len(value) == 2:
        try:
            return np.asarray(value[0], float), np.asarray(value[1], float), interpolation
        except (TypeError, ValueError):
            raise ModelError(f"the table of input '{name}' takes numbers: (times, values)") from None
    return None


def _columns(name: str, shape: Shape, size: int, times: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return the values of a table as (rows, entries). Raises ModelError for an invalid table."""
    rows = values.shape[0] if values.ndim else 0
    if times.ndim != 1 or rows != len(times) or rows == 0 or values.shape[1:] not in (shape, (size,)):
        expected = "(n,)" if not shape else f"(n, {size})"
        raise ModelError(
            f"the table of input '{name}' takes times (n,) and values {expected}; found {times.shape} and "
            f"{values.shape}"
        )
    if not (np.all(np.isfinite(times)) and np.all(np.isfinite(values))):
        raise ModelError(f"the table of input '{name}' contains numbers that are not finite")
    if np.any(np.diff(times) <= 0):
        raise ModelError(f"the times of input '{name}' must increase strictly")
    return values.reshape(len(times), size)


def _constant(name: str, value: Any) -> list[float]:
    try:
        array = floats(value).reshape(-1)
    except (TypeError, ValueError):
        raise ModelError(
            f"input '{name}' takes a number, an array, a function of time, (times, values) or a Trajectory; "
            f"found {type(value).__name__} {shortened(value)}"
        ) from None
    if not np.all(np.isfinite(array)):
        raise ModelError(f"input '{name}' must be finite; found {value}")
    return [float(x) for x in array]


def _symbolic(flat: FlatModel, name: str, function: Callable[[Any], Any], t: ca.SX) -> list[ca.SX]:
    try:
        value = gathered(function(Expr(t, (), None, flat.scope)))
        entries = ca.vec(value.sx.T) if isinstance(value, Expr) else ca.SX(ca.DM(floats(value).ravel()))
    except Exception as error:
        raise ModelError(
            f"input '{name}' cannot be written as an expression of time ({type(error).__name__}: {error}); use "
            "functions such as np.sin, or give (times, values)",
            line_of(function),
        ) from None
    if value is None:
        raise ModelError(
            f"the function of input '{name}' returns nothing; expected a number or an array", line_of(function)
        )
    if not ca.symvar(entries) and not np.all(np.isfinite(np.asarray(ca.DM(entries)))):
        raise ModelError(f"the function of input '{name}' returns {entries}, which is not finite", line_of(function))
    foreign = [s.name() for s in ca.symvar(entries) if s.element_hash() != t.element_hash()]
    if foreign:
        raise ModelError(f"input '{name}' must depend on time only; it contains {foreign[0]}", line_of(function))
    return ca.vertsplit(entries)
