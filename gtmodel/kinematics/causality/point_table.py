"""Points as a CSV table, where a NaN is data, and conditions on known values, such as a quaternion of length 1."""

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

UNIT_LENGTH = 1e-3  # a quaternion farther from length 1 is a slip of the pen, not rounding
# unit vectors in no special direction: what holds for all of them is a condition on the length
DIRECTIONS = np.array([[0.5, -0.1, 0.7, 0.5], [-0.1, 0.3, 0.3, -0.9], [0.7, 0.7, -0.1, 0.1]])


class Conditions:
    """The conditions that a causality puts on its known values; none where its plan has no block of them."""

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
        given = [ca.vertcat(*[flat.scope.symbol(*p) for p in s.pairs]) for s in function.inputs]
        made = ca.Function("margins", [*given, flat.p], [ca.vertcat(*expressions)])
        self._margins = ca.Function("margins", given, made.call([*given, ca.DM(flat.p0)]))
        self._places = [set(flat.scope.symbols_in(e)) for e in expressions]
        self._quaternions = [k for k in range(len(function.inputs)) if self._are_lengths(k)]

    def broken(self, inputs: Sequence[np.ndarray]) -> np.ndarray:
        """Which rows (n,) break a condition. inputs: (n, *shape) each, in the order of the function."""
        n = len(inputs[0])
        if self._margins is None:
            return np.zeros(n, dtype=bool)
        return ~np.all(self._at(inputs) >= 0, axis=0)

    def normalised(self, inputs: Sequence[np.ndarray]) -> tuple[list[np.ndarray], int]:
        """The inputs with quaternions near length 1 brought to it, and the number of rows that this changed.

        A quaternion is an input of shape (4,) on which the one condition is its length. Those within 1e-3 of length 1
        that break it are changed, for measured and typed numbers are rounded.
        """
        scaled, changed = list(inputs), np.zeros(len(inputs[0]), dtype=bool)
        for k in self._quaternions:
            length = np.linalg.norm(scaled[k], axis=1)
            near = self.broken(scaled) & (np.abs(length - 1.0) <= UNIT_LENGTH)
            scaled[k] = np.where(near[:, None], scaled[k] / np.where(near, length, 1.0)[:, None], scaled[k])
            changed |= near
        return scaled, int(np.sum(changed))

    def _are_lengths(self, k: int) -> bool:
        """Whether input k has conditions, and unit vectors in any direction keep them."""
        pairs = set(self._inputs[k].pairs)
        own = [n for n, p in enumerate(self._places) if pairs.issuperset(p)]  # not those that speak of rates too
        if self._inputs[k].shape != (4,) or not own:
            return False
        any_way = [np.ones((len(DIRECTIONS), s.size)) for s in self._inputs]
        any_way[k] = DIRECTIONS
        return bool(np.all(self._at(any_way)[own] >= 0))

    def _at(self, inputs: Sequence[np.ndarray]) -> np.ndarray:
        """Margins (conditions, n)."""
        assert self._margins is not None
        return map_columns(self._margins, [a.reshape(len(a), -1).T for a in inputs])[0]


def read(path: Path, signals: Sequence[CausalSignal]) -> list[np.ndarray]:
    """One array per signal, (rows, *shape), in SI units.

    The header names the columns: "T[0] [m]", or "T[0]" for the unit that the model declares; further columns are left
    alone, so a table written by `text` can be read again. An empty cell or nan is NaN; lines that begin with # are
    comments. Raises ArgumentError with the line: a column missing or there twice, a unit that does not fit, a cell that
    is no number.
    """
    table = CsvTable(path)
    parts = [[_in_units_of(signal, table, name) for name in columns(signal)] for signal in signals]
    return [np.stack(c, axis=1).reshape(-1, *signal.shape) for c, signal in zip(parts, signals, strict=True)]


def columns(signal: CausalSignal) -> list[str]:
    """Names of a signal's components: T[0], T[1], ...; R[0,0] is written R[0][0], for commas part columns."""
    return [signal.name + "".join(f"[{i}]" for i in index) for index in np.ndindex(*signal.shape)]


def text(table: Sequence[tuple[Sequence[str], str, np.ndarray]], status: Sequence[str]) -> str:
    """The CSV: row number from 0, columns (names, unit, values (rows, *shape)), and the status of each row."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    heads = [f"{name} [{unit}]" if unit else name for names, unit, _ in table for name in names]
    writer.writerow(["row", *heads, "status"])
    numbers = np.column_stack([values.reshape(len(status), -1) for _, _, values in table])
    for k, word in enumerate(status):
        writer.writerow([k, *map(repr, numbers[k].tolist()), word])
    return out.getvalue()


def _in_units_of(signal: CausalSignal, table: CsvTable, name: str) -> np.ndarray:
    """Numbers of a column in the unit that the model declares."""
    unit, values = table.units[table.place(name)], table.numbers(name, gaps=True)
    if not unit:
        return values
    where = f"{table.where}, column '{name}'"
    try:
        fits = not signal.unit or parse_unit(unit).dimension == parse_unit(signal.unit).dimension
    except UnitError as error:
        raise ArgumentError(f"{where}: {error}") from error
    if not fits:
        raise ArgumentError(f"{where}: the unit {unit} does not fit; the model has it in {signal.unit}")
    return np.asarray(convert(values, unit, signal.unit), float) if signal.unit else values
