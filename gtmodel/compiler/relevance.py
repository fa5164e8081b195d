"""What a causality needs of a flat model: conditions on known values set apart, undetermined rest left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from .blocks import Margin, SolvedBlock, median
from .consistency.points import Sampler
from .flat import FlatEquation, FlatModel
from .structure import overdetermined_and_underdetermined

# a unit quaternion printed with six digits is one, anything coarser is refused; of rates the same
CONDITION_TOLERANCE = 1e-6

Pair = tuple[int, int]


@dataclass(frozen=True, eq=False)
class KnownCondition:
    """What known values must satisfy: `order` times differentiated, with `symbols` in it.

    `square` is the square of the size that its residual is compared with: that of the equation's own constant (1 for
    e'e == 1), and of a rate also of its terms.
    """

    label: str
    residual: ca.SX
    order: int
    symbols: frozenset[Pair]
    square: ca.SX

    def folded(self, p: ca.SX, values: ca.SX) -> KnownCondition:
        """With values in place of the parameters."""
        residual, square = ca.substitute([self.residual, self.square], [p], [values])
        return replace(self, residual=residual, square=square)


def set_apart(
    flat: FlatModel, equations: Sequence[FlatEquation], known: set[int]
) -> tuple[list[FlatEquation], list[FlatEquation]]:
    """(equations to solve, conditions): a condition holds among the elements of one known variable, e'e = 1.

    An equation among several known variables stays: there are too many knowns then.
    """
    group_of = {i: n for n, (_, indices) in enumerate(flat.groups.values()) for i in indices}
    left: list[FlatEquation] = []
    conditions: list[FlatEquation] = []
    for e in equations:
        inside = flat.scope.symbols_in(e.residual)
        one = len({group_of.get(i, -1 - i) for i, _ in inside}) == 1
        alone = one and len(inside) > 1 and all(i in known and order == 0 for i, order in inside)
        (conditions if alone else left).append(e)
    return left, conditions


def needed(
    flat: FlatModel, equations: list[FlatEquation], unknowns: list[int], targets: set[int]
) -> tuple[list[FlatEquation], list[int], list[int]]:
    """(equations, unknowns, undetermined): without the underdetermined part, where no target lies in it.

    The forces of a mechanism whose loads nobody gave do not stand in the way of its kinematics: by Dulmage and
    Mendelsohn the well-determined part does not contain them. A system with surplus equations stays whole.
    """
    column = {j: n for n, j in enumerate(unknowns)}
    entries = {
        (i, column[index]): 0
        for i, e in enumerate(equations)
        for index, _ in flat.scope.symbols_in(e.residual)
        if index in column
    }
    over, under = overdetermined_and_underdetermined(len(equations), len(unknowns), entries)
    dropped = {unknowns[j] for j in under}
    if over or not under or not targets or dropped & targets:
        return equations, unknowns, []
    kept = [e for e in equations if not any(i in dropped for i, _ in flat.scope.symbols_in(e.residual))]
    return kept, [j for j in unknowns if j not in dropped], sorted(dropped)


def conditions_on(
    flat: FlatModel, equations: Sequence[FlatEquation], read: set[Pair], sampler: Sampler, samples: np.ndarray
) -> list[KnownCondition]:
    """The conditions on what is read of known variables, each differentiated as often as these are.

    e'e == 1 says e'der(e) == 0 where der(e) is read: a rate that stretches a quaternion is the rate of no rotation.
    """
    read = set(read)
    conditions: dict[tuple[int, int], KnownCondition] = {}
    while True:
        before = len(conditions)
        for n, e in enumerate(equations):
            variables = {i for i, _ in flat.scope.symbols_in(e.residual)}
            top = max((order for i, order in read if i in variables), default=-1)
            residual, size = e.residual, None
            for m in range(top + 1):
                if (n, m) not in conditions:
                    size = _own_size(flat, e.residual, sampler, samples) if size is None else size
                    symbols = flat.scope.symbols_in(residual)
                    terms = [flat.scope.symbol(*p) for p in symbols if p[1] > 0]
                    products = ca.gradient(residual, ca.vertcat(*terms)) * ca.vertcat(*terms) if terms else ca.SX(0)
                    square = size**2 + ca.sumsqr(products)
                    label = f"{e.label}{chr(39) * m} ({e.where})"
                    conditions[n, m] = KnownCondition(label, residual, m, frozenset(symbols), square)
                    read |= set(symbols)
                residual = flat.scope.derivative(residual) if m < top else residual
        if len(conditions) == before:
            return [conditions[key] for key in sorted(conditions)]


def _own_size(flat: FlatModel, residual: ca.SX, sampler: Sampler, samples: np.ndarray) -> float:
    """The size of an equation among values: its constant; else half of its derivative times the typical values."""
    x = ca.vertcat(*[flat.scope.symbol(*p) for p in flat.scope.symbols_in(residual)])
    at = [sampler.position[p] for p in flat.scope.symbols_in(residual)]
    f = ca.Function("size", [x, flat.p, flat.scope.time], [residual, ca.gradient(residual, x)])
    p, time = flat.p0, sampler.time
    constant = abs(float(f(ca.DM.zeros(x.numel()), p, time)[0]))
    if np.isfinite(constant) and constant > 0:
        return constant
    nominal = max(flat.variables[i].nominal for i, _ in flat.scope.symbols_in(residual))
    jacobian = [np.linalg.norm(f(w[at], p, time)[1]) for w in samples]
    values = [max(float(np.linalg.norm(w[at])), nominal) for w in samples]
    size = 0.5 * float(median(np.multiply(jacobian, values)))
    return float(f"{size:.3g}") if np.isfinite(size) and size > 0 else 1.0


def condition_block(conditions: Sequence[KnownCondition]) -> SolvedBlock:
    """A block that computes nothing; its margins turn negative where the known values break a condition."""
    labels = [c.label for c in conditions]
    margins = [Margin("condition", CONDITION_TOLERANCE**2 * c.square - c.residual**2, c.label) for c in conditions]
    return SolvedBlock("condition", [], labels, [], margins, detail="holds among the known values")
