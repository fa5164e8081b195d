"""Solved blocks: assignments in order, the margins that decide the status, and the signs of possible pivots."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from ..results.status import Status
from .consistency.points import Sampler
from .flat import FlatModel

# the status of a violated margin, by kind
VERDICTS = {
    "discriminant": Status.OUT_OF_RANGE,
    "condition": Status.OUT_OF_RANGE,
    "solution": Status.OUT_OF_RANGE,
    "turn": Status.NOT_CONVERGED,
    "limit": Status.OUT_OF_RANGE,
    "pivot": Status.SINGULAR,
    "branch": Status.WRONG_BRANCH,
}


@dataclass(frozen=True, eq=False)
class Margin:
    """A quantity that decides the status: discriminant or condition >= 0, |pivot| and branch above a tolerance.

    `kind` is a key of VERDICTS. A condition restricts known values alone; "solution" compares them with the solution,
    "turn" excludes a rotation by half a turn, "limit" keeps a joint within its limits, and a branch checks which
    solution Newton's method reached. `scale` is the typical size at the sample points.
    """

    kind: str
    expression: ca.SX
    label: str
    scale: float = 1.0


@dataclass(frozen=True, eq=False)
class Root:
    """A square root with a branch: `sign` is a symbol; `slope` = 2 qa t + qb has this sign at a known point.

    `settled_by` names the declared branch that selects the solution; if it is empty, the start values select it.
    `name`: the root is a branch itself, which `branches` may select, with its sign at the start as value; `default`:
    the start does not determine it.
    """

    sign: ca.SX
    slope: ca.SX
    label: str
    value: int = 0
    settled_by: str = ""
    name: str = ""
    default: bool = False


@dataclass(eq=False)
class NewtonBlock:
    """Equations without a closed form: residuals of the unknowns that remain after elimination.

    `scale` holds the nominal values of the unknowns, `labels` their names.
    """

    unknowns: list[ca.SX]
    residuals: list[ca.SX]
    labels: list[str]
    scale: np.ndarray

    @property
    def size(self) -> int:
        return len(self.unknowns)


@dataclass(frozen=True, eq=False)
class DenseCore:
    """matrix @ unknowns == right: the part of a linear block without allowed pivots, of four or more unknowns.

    definite: whether the matrix is symmetric and positive definite.
    """

    unknowns: list[ca.SX]
    matrix: ca.SX
    right: ca.SX
    definite: bool


@dataclass(frozen=True, eq=False)
class SolvedBlock:
    """One solved block: the unknowns in order, each with its expression of earlier symbols.

    `uses`: the names of all symbols in each equation, for the picture of the block-triangular form. `closures`: the
    residuals of a block that is nonlinear in its unknowns. `core`: the dense core of a linear block, also solved by
    `assignments`; the margins of such a block are its pivots.
    """

    kind: str
    unknowns: list[str]
    equations: list[str]
    assignments: list[tuple[ca.SX, ca.SX]]
    margins: list[Margin] = field(default_factory=list)
    roots: list[Root] = field(default_factory=list)
    detail: str = ""
    newton: NewtonBlock | None = None
    uses: tuple[tuple[str, ...], ...] = ()
    closures: tuple[ca.SX, ...] = ()
    core: DenseCore | None = None


# constant pivots are preferred: dividing by a parameter costs an operation and an assumption
PARAMETER_COST = 50
# cost, in fill-in entries, of each digit lost by a pivot that is smaller than another entry of its column
DIGIT_COST = 10

EQUAL = 1e-9  # consistent points are good to 1e-11

POSITIVE, NEGATIVE, NONZERO, UNKNOWN = "+", "-", "n", "?"
# operations whose sign follows from the signs of their operands
_SIGNED = frozenset(
    [ca.OP_MUL, ca.OP_DIV, ca.OP_ADD, ca.OP_SUB, ca.OP_NEG, ca.OP_SQ, ca.OP_SQRT, ca.OP_INV, ca.OP_TWICE]
)


def median(values: np.ndarray) -> np.ndarray:
    """Return the median over the rows, NaN if a value is NaN. np.median does the same, but imports numpy.ma."""
    ordered = np.sort(values, axis=0)
    middle = (ordered[(len(ordered) - 1) // 2] + ordered[len(ordered) // 2]) / 2
    return np.where(np.isnan(ordered[-1]), np.nan, middle)


class SignAnalysis:
    """Signs of parameter expressions, from the declared `positive` and `nonzero`, and sizes at consistent points."""

    def __init__(self, flat: FlatModel, sampler: Sampler, points: np.ndarray) -> None:
        self._arguments = [sampler.w, flat.p, flat.scope.time]
        self._points = [ca.DM(np.asarray(points).T), ca.DM(flat.p0), ca.DM(sampler.time)]
        # by the parameters: whether it is an entry of a rotation matrix
        self._turns = np.zeros(len(flat.parameters), dtype=bool)
        for r in flat.tree.parameters:
            if getattr(r.item, "kind", "") == "rotation":
                self._turns[list(r.indices)] = True
        self._symbols: dict[int, str] = {}
        self._signs: dict[int, tuple[ca.SX, str]] = {}  # by hash, which is unique while the expression is kept
        for q in flat.parameters:
            sign = UNKNOWN
            if q.nonzero:
                sign = (POSITIVE if q.value > 0 else NEGATIVE) if q.name in flat.positive else NONZERO
            self._symbols[q.symbol.element_hash()] = sign

    def kind(self, e: ca.SX) -> str | None:
        """Return "constant" or "parameter" if the scalar is an allowed divisor, else None."""
        if e.is_constant():
            return "constant" if float(e) != 0.0 else None
        return "parameter" if self.sign(e) != UNKNOWN else None

    @property
    def count(self) -> int:
        """The number of consistent points."""
        return int(self._points[0].shape[1])

    def values(self, expressions: Sequence[ca.SX]) -> np.ndarray:
        """Return the values at the consistent points (points, expressions)."""
        constant = [float(e) if e.is_constant() else 0.0 for e in expressions]
        values = np.repeat([constant], self.count, axis=0)
        varying = [n for n, e in enumerate(expressions) if not e.is_constant()]
        if varying:
            f = ca.Function("values", self._arguments, [ca.vertcat(*[expressions[n] for n in varying])])
            columns = (f.map(self.count) if self.count > 1 else f).call(self._points)[0]
            values[:, varying] = np.array(ca.densify(columns).nonzeros()).reshape(self.count, -1)
        return values

    def sizes(self, expressions: Sequence[ca.SX]) -> list[float]:
        """Return typical magnitudes: the medians over the consistent points."""
        sizes: list[float] = median(np.abs(self.values(expressions))).tolist()
        return sizes

    def at_home(self, e: ca.SX) -> float:
        """Return the value at the consistent point nearest to the start values."""
        w, p, time = self._points
        return float(ca.Function("at_home", self._arguments, [e])(w[:, 0], p, time))

    def holds(self, e: ca.SX, size: ca.SX) -> bool:
        """Return whether a column is zero relative to `size` at the consistent points, also with other values of all
        parameters but rotation matrices."""
        f = ca.Function("holds", self._arguments, [ca.densify(e), size])
        rng = np.random.default_rng(0)
        w, p, time = self._points
        other = np.array(p).reshape(-1)
        for n in range(w.shape[1]):
            value, scale = (np.array(x).reshape(-1) for x in f(w[:, n], other, time))
            if not np.all(np.abs(value) <= EQUAL * max(1.0, abs(scale[0]))):
                return False
            other = np.where(self._turns, other, other * (1 + rng.uniform(0.1, 0.5, other.size)))
        return True

    def sign(self, e: ca.SX) -> str:
        """Return the sign of a scalar; UNKNOWN if it contains a symbol of unknown sign, such as a variable."""
        key = e.element_hash()
        if key not in self._signs:
            self._signs[key] = e, self._sign(e, key)
        return self._signs[key][1]

    def _sign(self, e: ca.SX, key: int) -> str:
        if e.is_constant():
            value = float(e)
            return POSITIVE if value > 0 else NEGATIVE if value < 0 else UNKNOWN
        if e.is_symbolic():
            return self._symbols.get(key, UNKNOWN)
        op = e.op()
        if op not in _SIGNED or (first := self.sign(e.dep(0))) == UNKNOWN:
            return UNKNOWN
        if op in (ca.OP_MUL, ca.OP_DIV):
            return _product(first, self.sign(e.dep(1)))
        if op == ca.OP_ADD:
            return _sum(first, self.sign(e.dep(1)))
        if op == ca.OP_SUB:
            return _sum(first, _product(NEGATIVE, self.sign(e.dep(1))))
        if op == ca.OP_NEG:
            return _product(NEGATIVE, first)
        return POSITIVE if op == ca.OP_SQ else first


def pivot_cost(kind: str, fill: int, size: float, largest: float) -> float:
    """Return the cost of a pivot: fill-in, assumption on a parameter, and digits lost relative to the largest entry of
    its column; infinite for a zero pivot."""
    if not size > 0 or not math.isfinite(largest):
        return math.inf
    return fill + PARAMETER_COST * (kind == "parameter") + DIGIT_COST * math.floor(math.log10(largest / size))


def _product(a: str, b: str) -> str:
    if UNKNOWN in (a, b):
        return UNKNOWN
    if NONZERO in (a, b):
        return NONZERO
    return POSITIVE if a == b else NEGATIVE


def _sum(a: str, b: str) -> str:
    return a if a == b and a in (POSITIVE, NEGATIVE) else UNKNOWN
