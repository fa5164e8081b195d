"""The part of a flat model that a causality needs: without conditions on known values and undetermined equations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from .blocks import Margin, SolvedBlock, median
from .consistency.points import Sampler
from .flat import FlatEquation, FlatModel
from .structure import overdetermined_and_underdetermined

# a unit quaternion with six digits is accepted, anything coarser is refused; the same for rates
CONDITION_TOLERANCE = 1e-6

Pair = tuple[int, int]


@dataclass(frozen=True, eq=False)
class KnownCondition:
    """A condition on known values, differentiated `order` times, with `symbols` in it.

    `square` is the square of the size that the residual is compared with: the equation's constant (1 for e'e == 1), for
    a rate also its terms.
    """

    label: str
    residual: ca.SX
    order: int
    symbols: frozenset[Pair]
    square: ca.SX

    def folded(self, p: ca.SX, values: ca.SX) -> KnownCondition:
        """Return the condition with values in place of the parameters."""
        residual, square = ca.substitute([self.residual, self.square], [p], [values])
        return replace(self, residual=residual, square=square)


def set_apart(
    flat: FlatModel, equations: Sequence[FlatEquation], known: set[int]
) -> tuple[list[FlatEquation], list[FlatEquation]]:
    """Return (equations to solve, conditions): a condition relates the elements of one known variable, e'e = 1.

    An equation among several known variables is not a condition: there are too many known variables then.
    """
    group_of = {i: n for n, (_, indices) in enumerate(flat.groups.values()) for i in indices}
    remaining: list[FlatEquation] = []
    conditions: list[FlatEquation] = []
    for e in equations:
        inside = flat.scope.symbols_in(e.residual)
        same_group = len({group_of.get(i, -1 - i) for i, _ in inside}) == 1
        is_condition = same_group and len(inside) > 1 and all(i in known and order == 0 for i, order in inside)
        (conditions if is_condition else remaining).append(e)
    return remaining, conditions


def needed(
    flat: FlatModel, equations: list[FlatEquation], unknowns: list[int], targets: set[int]
) -> tuple[list[FlatEquation], list[int], list[int]]:
    """Return (equations, unknowns, undetermined) without the underdetermined part, if it contains no target.

    Unknown loads of a mechanism then do not prevent computing its kinematics: the well-determined part of the
    Dulmage-Mendelsohn decomposition does not contain the forces. A system with surplus equations stays complete.
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
    determined = [e for e in equations if not any(i in dropped for i, _ in flat.scope.symbols_in(e.residual))]
    return determined, [j for j in unknowns if j not in dropped], sorted(dropped)


def conditions_on(
    flat: FlatModel, equations: Sequence[FlatEquation], read: set[Pair], sampler: Sampler, samples: np.ndarray
) -> list[KnownCondition]:
    """Return the conditions on known variables, each differentiated as often as the derivatives that are read.

    If der(e) is read, e'e == 1 implies e'der(e) == 0: otherwise the rate would change the length of the quaternion.
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
    jacobian = [np.linalg.norm(f(w[at], p, time)[1].full()) for w in samples]
    values = [max(float(np.linalg.norm(w[at])), nominal) for w in samples]
    size = 0.5 * float(median(np.multiply(jacobian, values)))
    return float(f"{size:.3g}") if np.isfinite(size) and size > 0 else 1.0


def condition_block(conditions: Sequence[KnownCondition], more: Sequence[Margin] = ()) -> SolvedBlock:
    """Return a block that computes nothing; its margins, and `more`, are negative if the known values violate a
    condition."""
    labels = list(dict.fromkeys(c.label for c in conditions))
    margins = [Margin("condition", CONDITION_TOLERANCE**2 * c.square - c.residual**2, c.label) for c in conditions]
    return SolvedBlock("condition", [], labels, [], [*margins, *more], detail="condition on the known values")
