"""Recording of a simulation as a Trajectory, and the balance of the energies that a model declares."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from ..compiler.flat import FlatModel
from ..lang.scope import derivative_name
from ..lang.source import ModelError, about
from ..results.check import Check
from ..results.trajectory import Trajectory
from .options import names

# bound of the error relative to the exchanged energy: amplitudes are then accurate to half of it, invisible in a
# picture. At the default tolerance, undamped motions stay below it for some two hundred periods, all others always
ENERGY_BALANCE = 1e-4


def balance(error: float | None, moved: float) -> dict[str, Check]:
    """Return the check "energy_balance": the error [J] relative to the exchanged energy `moved` [J].

    If no energy was exchanged, as at rest, the error itself is checked.
    """
    if error is None:
        return {}
    return {"energy_balance": Check(error / moved if moved > 0 else error, ENERGY_BALANCE, "use a smaller tolerance")}


def unbalanced(checks: dict[str, Check], moved: float) -> str:
    """Return a sentence if the energy balance fails, else an empty string."""
    check = checks.get("energy_balance")
    if check is None or check.passed:
        return ""
    return (
        f"the energy balance is off by {check.value:.2g} of the exchanged energy, {moved:.3g} J; the bound is "
        f"{check.bound:g}: {check.advice}"
    )


def stored_terms(flat: FlatModel) -> list[ca.SX]:
    """Return the terms of the stored energies in original symbols, such as kinetic and potential energy separately.

    Their sum may be constant, so only the separate terms show how much energy is exchanged.
    """
    return [term for e in flat.energies if e.kind == "stored" for term in _terms(ca.SX(e.expression), ca.SX(1))]


def _terms(e: ca.SX, factor: ca.SX) -> list[ca.SX]:
    """Return the addends of an expression, also of a sum that is multiplied or divided by a constant."""
    if e.is_leaf() or e.numel() != 1:
        return [factor * e]
    operation = e.op()
    if operation in (ca.OP_ADD, ca.OP_SUB):
        return [t for k in range(2) for t in _terms(e.dep(k), factor)]
    if operation == ca.OP_MUL:
        for k in range(2):
            if e.dep(k).is_constant():
                return _terms(e.dep(1 - k), factor * e.dep(k))
    if operation == ca.OP_DIV and e.dep(1).is_constant():
        return _terms(e.dep(0), factor / e.dep(1))
    return [factor * e]


Pair = tuple[int, int]
ROUND_OFF = 1e-9  # relative to the stored energies
Shape = tuple[int, ...]


@dataclass(frozen=True)
class RecordedQuantity:
    """A recorded name with its unit ("?" if none is declared) and its scalar symbols."""

    name: str
    shape: Shape
    pairs: tuple[Pair, ...]
    unit: str


@dataclass(frozen=True)
class Wanted:
    """The names to record: beside those that every run records, or if `only`, nothing else."""

    names: tuple[str, ...] = ()
    only: bool = False

    @staticmethod
    def of(outputs: Sequence[str] | str, keep: Sequence[str] | str | None) -> Wanted:
        """Return what these arguments of `simulate` ask for."""
        further = names("outputs", outputs)
        if keep is None:
            return Wanted(tuple(further))
        with about("keep"):
            wanted = Wanted((*names("keep", keep), *further), only=True)
            if not wanted.names:
                raise ModelError("keep lists all variables that are recorded, but it is empty; leave it out")
        return wanted


def entries_of(flat: FlatModel, wanted: Wanted) -> list[RecordedQuantity]:
    """Return the wanted quantities; beside them, unless `only` these are, those of the top level and one below, and
    first derivatives of top-level ones."""
    entries: dict[str, RecordedQuantity] = {}

    def add(name: str, shape: Shape, indices: list[int], order: int) -> None:
        if len(shape) > 1:  # a Trajectory holds vectors, so the entries of a matrix are recorded one by one
            for i in indices:
                add(flat.variables[i].name, (), [i], order)
            return
        full = derivative_name(name, order)
        entries[full] = RecordedQuantity(
            full, shape, tuple((i, order) for i in indices), flat.unit_of(indices[0], order)
        )

    moving = {i for e in flat.equations for i, k in flat.scope.symbols_in(e.residual) if k >= 1}
    groups = {} if wanted.only else flat.groups
    for name, (shape, indices) in groups.items():
        levels = flat.level(indices[0])
        if levels > 1:
            continue
        add(name, shape, indices, 0)
        if levels == 0 and (moving.issuperset(indices) or flat.variables[indices[0]].prefer > 0):
            add(name, shape, indices, 1)
    for name in wanted.names:
        shape, indices, order = flat.lookup(name)
        known = next((n for n, group in flat.groups.items() if group == (shape, indices)), None)
        add(known or flat.variables[indices[0]].name, shape, indices, order)
    in_vectors = {pair for e in entries.values() if e.shape for pair in e.pairs}
    return [e for e in entries.values() if e.shape or e.pairs[0] not in in_vectors]


@dataclass(frozen=True, eq=False)
class Recorded:
    """The columns of a row: `entries`, then `terms` terms of the stored energy and `extra` numbers that are not
    recorded. key: what they depend on in the model."""

    key: Hashable
    entries: list[RecordedQuantity]
    expressions: list[ca.SX]
    terms: int
    has_energy: bool
    extra: int = 0

    @staticmethod
    def of(flat: FlatModel, wanted: Wanted) -> Recorded:
        """Return the columns for these names; cached in the model."""
        key = "recorded", wanted
        if key not in flat.cache:
            entries, terms = entries_of(flat, wanted), stored_terms(flat)
            symbols = [flat.scope.symbol(*pair) for e in entries for pair in e.pairs]
            flat.cache[key] = Recorded(wanted, entries, [*symbols, *terms], len(terms), bool(flat.energies))
        return flat.cache[key]


class Recorder:
    """Rows of a running simulation."""

    def __init__(self, recorded: Recorded) -> None:
        self._recorded = recorded
        self._blocks: list[np.ndarray] = []

    def add(self, times: np.ndarray, values: np.ndarray, works: np.ndarray) -> None:
        """Add rows: values of the entries, stored energy terms, extra numbers and stored energy; and the energies
        supplied and dissipated so far [J]."""
        self._blocks.append(np.column_stack([times, values, works]))

    @property
    def empty(self) -> bool:
        """Whether nothing was recorded, not even the start."""
        return not any(len(block) for block in self._blocks)

    def trajectory(self) -> tuple[Trajectory, float | None, float]:
        """Return the trajectory, the largest error of the energy balance [J], and the exchanged energy [J]."""
        table = np.concatenate(self._blocks)
        times, rows = table[:, 0], table[:, 1:]
        values: dict[str, np.ndarray] = {}
        units: dict[str, str] = {}
        column = 0
        for e in self._recorded.entries:
            block = rows[:, column : column + len(e.pairs)]
            column += len(e.pairs)
            values[e.name] = block if e.shape else block[:, 0]
            if e.unit != "?":
                units[e.name] = e.unit
        error, moved = None, 0.0
        terms, column = rows[:, column : column + self._recorded.terms], column + self._recorded.terms
        column += self._recorded.extra
        if self._recorded.has_energy:
            stored, supplied, dissipated = rows[:, column:].T
            for name, data in (("stored", stored), ("supplied", supplied), ("dissipated", dissipated)):
                values[f"energy.{name}"], units[f"energy.{name}"] = data, "J"
            flows = np.column_stack([terms, stored, supplied, dissipated])
            moved = float(np.max(np.ptp(flows, axis=0)))
            # a smaller share of the stored energy is round-off
            moved = max(moved, ROUND_OFF * float(np.max(np.abs(flows))))
            error = float(np.max(np.abs(stored - stored[0] - supplied + dissipated)))
        return Trajectory(times, values, units), error, moved
