"""Points as a CSV table, which may contain NaN, and conditions on known values, such as a quaternion of length 1."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path

import casadi as ca
import numpy as np

from ...compiler.causal import CausalFunction, CausalSignal
from ...compiler.rows import map_columns
from ...lang.units import UnitError, convert, parse_unit
from ...measurements.signal_table import CsvTable
from ...results import ArgumentError

UNIT_LENGTH = 1e-3  # a quaternion whose length deviates more from 1 is an error, not rounding
# unit vectors in arbitrary directions: a condition that all of them satisfy is a condition on the length
DIRECTIONS = np.array([[0.5, -0.1, 0.7, 0.5], [-0.1, 0.3, 0.3, -0.9], [0.7, 0.7, -0.1, 0.1]])


class Conditions:
    """The conditions of a causality on its known values, if it has any."""

    def __init__(self, function: CausalFunction) -> None:
        flat, blocks = function.plan.flat, function.plan.blocks
        self._inputs = function.inputs
        self._margins: ca.Function | None = None
        self._quaternions: list[int] = []
        known = {p for s in function.inputs for p in s.pairs}
        margins = blocks[0].margins if blocks and blocks[0].kind == "condition" else []
        expressions = [e for e in (m.expression for m in margins) if known.issuperset(flat.scope.symbols_in(e))]
        if not expressions:
            return
        symbols = [ca.vertcat(*[flat.scope.symbol(*p) for p in s.pairs]) for s in function.inputs]
        parametric = ca.Function("margins", [*symbols, flat.p], [ca.vertcat(*expressions)])
        self._margins = ca.Function("margins", symbols, parametric.call([*symbols, ca.DM(flat.p0)]))
        self._symbols = [set(flat.scope.symbols_in(e)) for e in expressions]
        self._quaternions = [k for k in range(len(function.inputs)) if self._are_lengths(k)]

    def broken(self, inputs: Sequence[np.ndarray]) -> np.ndarray:
        """Return whether each row (n,) violates a condition. inputs: (n, *shape) each, in the function's order."""
        n = len(inputs[0])
        if self._margins is None:
            return np.zeros(n, dtype=bool)
        return ~np.all(self._evaluated(inputs) >= 0, axis=0)

    def normalised(self, inputs: Sequence[np.ndarray]) -> tuple[list[np.ndarray], int]:
        """Return the inputs with normalised quaternions, and the number of rows that changed.

        A quaternion is an input of shape (4,) with conditions on its length only. It is normalised if it violates them
        and its length is within 1e-3 of 1, because measured and typed numbers are rounded.
        """
        scaled, changed = list(inputs), np.zeros(len(inputs[0]), dtype=bool)
        for k in self._quaternions:
            length = np.linalg.norm(scaled[k], axis=1)
            near = self.broken(scaled) & (np.abs(length - 1.0) <= UNIT_LENGTH)
            scaled[k] = np.where(near[:, None], scaled[k] / np.where(near, length, 1.0)[:, None], scaled[k])
            changed |= near
        return scaled, int(np.sum(changed))

    def _are_lengths(self, k: int) -> bool:
        """Return whether input k is a unit quaternion: all unit vectors satisfy the model's conditions on it."""
        pairs = set(self._inputs[k].pairs)
        conditions = [n for n, p in enumerate(self._symbols) if pairs.issuperset(p)]  # without conditions on rates
        if self._inputs[k].shape != (4,) or not conditions:
            return False
        inputs = [np.ones((len(DIRECTIONS), s.size)) for s in self._inputs]
        inputs[k] = DIRECTIONS
        return bool(np.all(self._evaluated(inputs)[conditions] >= 0))

    def _evaluated(self, inputs: Sequence[np.ndarray]) -> np.ndarray:
        """Return the margins (conditions, n)."""
        assert self._margins is not None
        return map_columns(self._margins, [a.reshape(len(a), -1).T for a in inputs])[0]


def read(path: Path, signals: Sequence[CausalSignal]) -> list[np.ndarray]:
    """Read one array (rows, *shape) per signal from a CSV file, in SI units.

    The header names the columns: "T[0] [m]", or "T[0]" in the unit declared by the model. Other columns are ignored,
    so a table written by `text` can be read again. An empty cell or nan is NaN; lines that begin with # are comments.
    Raises ArgumentError with the line for a missing or duplicate column, an incompatible unit, or a cell that is not a
    number.
    """
    table = CsvTable(path)
    parts = [[_in_units_of(signal, table, name) for name in columns(signal)] for signal in signals]
    return [np.stack(c, axis=1).reshape(-1, *signal.shape) for c, signal in zip(parts, signals, strict=True)]


def columns(signal: CausalSignal) -> list[str]:
    """Return the names of a signal's components: T[0], T[1], ...; R[0,0] is written R[0][0], without a comma."""
    return [signal.name + "".join(f"[{i}]" for i in index) for index in np.ndindex(*signal.shape)]


def text(table: Sequence[tuple[Sequence[str], str, np.ndarray]], status: Sequence[str]) -> str:
    """Return the CSV text: row number from 0, columns (names, unit, values (rows, *shape)), status of each row."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    heads = [f"{name} [{unit}]" if unit else name for names, unit, _ in table for name in names]
    writer.writerow(["row", *heads, "status"])
    numbers = np.column_stack([values.reshape(len(status), -1) for _, _, values in table])
    for k, word in enumerate(status):
        writer.writerow([k, *map(repr, numbers[k].tolist()), word])
    return out.getvalue()


def _in_units_of(signal: CausalSignal, table: CsvTable, name: str) -> np.ndarray:
    """Return the values of a column in the unit that the model declares."""
    unit, values = table.units[table.place(name)], table.numbers(name, gaps=True)
    if not unit:
        return values
    place = f"{table.where}, column '{name}'"
    try:
        fits = not signal.unit or parse_unit(unit).dimension == parse_unit(signal.unit).dimension
    except UnitError as error:
        raise ArgumentError(f"{place}: {error}") from error
    if not fits:
        raise ArgumentError(f"{place}: the unit {unit} is not compatible with the model's unit {signal.unit}")
    return np.asarray(convert(values, unit, signal.unit), float) if signal.unit else values
