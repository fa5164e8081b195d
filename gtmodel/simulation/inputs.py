"""What drives a simulation: constants, functions of time, tables as piecewise polynomials, trajectories."""

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

# polynomial coefficients of one piece: with two, the first derivative is known too, and so on
INTERPOLATIONS = {"previous": 1, "linear": 2, "cubic": 4}


@dataclass(eq=False)
class InputTable:
    """A scalar function of time given by rows; constant before the first and after the last one."""

    name: str
    times: np.ndarray
    values: np.ndarray
    interpolation: str = "linear"

    @property
    def coefficients(self) -> int:
        return INTERPOLATIONS[self.interpolation]

    @cached_property
    def _rows(self) -> np.ndarray:
        """Taylor coefficients (value, derivatives) at the beginning of each piece, one row per time."""
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
        """Largest size of a derivative at the rows."""
        return float(np.max(np.abs(self._rows[:, order])))

    def piece(self, start: float, before: bool = False) -> np.ndarray:
        """Taylor coefficients at a time, of the piece that begins or goes on there; `before`: that leads there."""
        k = int(np.searchsorted(self.times, start, side="left" if before else "right")) - 1
        if k < 0:
            return np.concatenate([self.values[:1], np.zeros(self.coefficients - 1)])
        row, after = self._rows[k], start - self.times[k]
        n = self.coefficients
        return np.array([sum(row[j] * after ** (j - i) / math.factorial(j - i) for j in range(i, n)) for i in range(n)])


Shape = tuple[int, ...]
Entry = TypeVar("Entry")


@dataclass(eq=False)
class SimulationInputs:
    """Scalar known variables as functions of time.

    `functions`: index -> expression of `t`; `tables`: index -> Table; `constants`: index -> value; `parameters`: place
    in `flat.p` -> value, of those that vary from run to run. `p` holds a reference time, for each table in the order of
    the indices the coefficients of its polynomial there, the constants and the parameters in their order; it is
    constant between `knots`, and the integrator restarts at each of them.
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
        """Equal for inputs that differ in numbers only: their tables' rows, their constants and parameters."""
        of_time = [self.functions[index] for index in sorted(self.functions)]
        text = ca.Function("inputs", [self.t], [ca.vertcat(*of_time)]).serialize() if of_time else ""
        tables = tuple((index, self.tables[index].coefficients) for index in sorted(self.tables))
        return tuple(sorted(self.functions)), text, tables, tuple(sorted(self.constants)), tuple(self._parameter)

    def knots(self, start: float, end: float) -> np.ndarray:
        """Times strictly inside an interval at which a table bends or is discontinuous."""
        times = np.unique(np.concatenate([np.zeros(0), *(table.times for table in self.tables.values())]))
        return times[(times > start) & (times < end)]

    def piece(self, start: float, before: bool = False) -> np.ndarray:
        """Values of `p` from a knot, or any other time, up to the next knot; `before`: of the piece that ends there."""
        pieces = [self.tables[index].piece(start, before) for index in sorted(self.tables)]
        numbers = [given[key] for given in (self.constants, self.parameters) for key in sorted(given)]
        return np.concatenate([[start], *pieces, numbers])

    def with_parameters(self, p: np.ndarray, numbers: Mapping[int, float]) -> np.ndarray:
        """Values of `p` with other numbers of parameters, by their places in the model's."""
        p = p.copy()
        p[[self._parameter[place] for place in numbers]] = list(numbers.values())
        return p

    def symbol_of(self, place: int) -> ca.SX:
        """What stands in `p` for a parameter that varies."""
        return self.p[self._parameter[place]]

    @property
    def varied(self) -> tuple[ca.SX, ca.SX]:
        """Symbols of the model's parameters that vary, and what stands for them in `p`."""
        symbols = [self.flat.parameters[place].symbol for place in self._parameter]
        return ca.SX(ca.vertcat(*symbols)), self.p[list(self._parameter.values())]

    def values(self, pairs: list[tuple[int, int]], time: float) -> list[float]:
        """Numbers of known variables' derivatives (index, order) at a time."""
        if all(index in self.constants for index, _ in pairs):
            return [self.constants[index] if order == 0 else 0.0 for index, order in pairs]
        column = ca.vertcat(*[self.expression(*pair) for pair in pairs])
        return (
            np.asarray(ca.Function("values", [self.t, self.p], [column])(time, self.piece(time))).reshape(-1).tolist()
        )

    def expression(self, index: int, order: int) -> ca.SX:
        """A known variable's derivative as an expression of t and p."""
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
    flat: FlatModel, given: Mapping[str, Any], parameters: Mapping[int, float] | None = None
) -> SimulationInputs:
    """Inputs from what a person gave by name.

    Each value is a number or array; a function of time, of one argument that takes NumPy's and gtmodel's functions
    (``lambda t: [0.0, np.sin(3 * t)]``); a pair (times, values); or a Trajectory that holds the name. A table is
    "linear" between its rows unless ((times, values), interpolation) or (trajectory, interpolation) says otherwise:
    "previous" holds each row up to the next (a recorded row on a discontinuity shows what was before it), "cubic" is
    a spline, which has two derivatives. Of a trajectory, wrapped angles are unwrapped for these two and the sign of a
    quaternion does not jump. Before its first and after its last row every table keeps its end value.

    Raises ModelError for a wrong name, shape or unit, and for a function that cannot be evaluated symbolically.
    """
    t = ca.SX.sym("t")
    functions: dict[int, ca.SX] = {}
    tables: dict[int, InputTable] = {}
    constants: dict[int, float] = {}
    for name, value in given.items():
        with about(f"inputs.{name}"):
            shape, indices, order = flat.lookup(name)
            if order:
                raise ModelError(f"input '{name}' is a derivative; give the variable itself as a function of time")
            twice = [flat.variables[i].name for i in indices if i in functions or i in tables or i in constants]
            if twice:
                raise ModelError(f"input '{twice[0]}' is given twice")
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
    """Entries of an input by the indices of its variables; one stands for all."""
    if len(entries) not in (1, len(indices)):
        raise ModelError(f"input '{name}' has {len(indices)} entries; found {len(entries)}")
    return dict(zip(indices, entries if len(entries) > 1 else entries * len(indices), strict=True))


def _table(flat: FlatModel, name: str, index: int, value: Any) -> tuple[np.ndarray, np.ndarray, str] | None:
    """(times, values, interpolation) where the value is a table or a trajectory, else None."""
    interpolation = "linear"
    if isinstance(value, tuple) and len(value) == 2 and isinstance(value[1], str):
        if not isinstance(value[0], (Trajectory, tuple)):
            raise ModelError(f"input '{name}' takes (times, values), or that or a Trajectory with an interpolation")
        value, interpolation = value
        if interpolation not in INTERPOLATIONS:
            raise ModelError(
                f"input '{name}': there is no interpolation '{interpolation}'; it is one of {', '.join(INTERPOLATIONS)}"
            )
    if isinstance(value, Trajectory):
        try:
            values, unit = value[name], value.unit(name)
        except UnknownNameError as error:
            raise ModelError(f"input '{name}': {error}") from None
        expected = flat.variables[index].unit
        if expected is not None and si_unit(expected).dimension != si_unit(unit).dimension:
            raise ModelError(f"input '{name}' is in {expected}; the trajectory gives it in {unit}")
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
    """Values of a table as (rows, entries). Raises ModelError for numbers that make no table."""
    rows = values.shape[0] if values.ndim else 0
    if times.ndim != 1 or rows != len(times) or rows == 0 or values.shape[1:] not in (shape, (size,)):
        expected = "(n,)" if not shape else f"(n, {size})"
        raise ModelError(
            f"the table of input '{name}' takes times (n,) and values {expected}; found {times.shape} and "
            f"{values.shape}"
        )
    if not (np.all(np.isfinite(times)) and np.all(np.isfinite(values))):
        raise ModelError(f"the table of input '{name}' holds numbers that are not finite")
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
        raise ModelError(f"input '{name}' must be a function of time alone; it holds {foreign[0]}", line_of(function))
    return ca.vertsplit(entries)
