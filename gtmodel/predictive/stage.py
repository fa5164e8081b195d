"""One stage of a horizon, declared by expressions that are linear and quadratic in the state and the input."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import casadi as ca

from .._pickling import Portable
from ..results.refusal import ArgumentError


@dataclass(frozen=True, eq=False)
class LimitedRow(Portable):
    """A quantity of a stage with limits: low <= value <= high.

    value: an expression, linear in state and input, in units in which its typical size is 1. low, high: numbers,
    expressions of the data, or None for no limit.
    price: None for a limit that holds exactly. Else the limit is soft: exceeding it by e costs
    price[0] * e + price[1] * e^2 / 2, so that a solution always exists; it is exceeded only where no other solution
    exists if price[0] is larger than the multiplier of the exact limit.
    """

    value: Any
    low: Any = None
    high: Any = None
    price: tuple[float, float] | None = None


@dataclass(frozen=True, eq=False)
class Side(Portable):
    """One limit as sign * row >= bound; prices of a soft one."""

    row: int
    sign: int
    bound: Any
    price: tuple[float, float] | None


@dataclass(frozen=True, eq=False)
class HorizonStage(Portable):
    """One stage of a horizon, in CasADi SX symbols and expressions.

    The expressions hold what is constant as numbers; only what changes from stage to stage or from cycle to cycle
    stands in `data`. Zeros and constants then cost nothing, neither in Python nor in C.

    Args:
        x: symbols of the state, a column.
        u: symbols of the input, a column; None for the last stage of a horizon.
        data: symbols of the numbers that are given with each solution.
        after: state after the stage, linear in x and u; None for the last stage.
        cost: quadratic in x and u, convex, and strictly convex in u together with what follows.
        rows: quantities with limits. `sides` lists their limits, the exact ones first.

    Raises ArgumentError if an expression depends on other symbols, or is not linear or quadratic.

    >>> import casadi as ca
    >>> x, u, goal = ca.SX.sym("x", 2), ca.SX.sym("u"), ca.SX.sym("goal")
    >>> after = ca.vertcat(x[0] + 0.1 * x[1] + 0.005 * u, x[1] + 0.1 * u)
    >>> rows = [gt.predictive.LimitedRow(u, -1, 1)]
    >>> stage = gt.predictive.HorizonStage(x, u, goal, after, (x[0] - goal) ** 2 + 0.01 * u**2, rows)
    >>> stage.inputs, len(stage.sides)
    (1, 2)
    """

    x: Any
    u: Any
    data: Any
    after: Any
    cost: Any
    rows: Sequence[LimitedRow] = ()
    sides: list[Side] = field(init=False)
    matrices: dict[str, Any] = field(init=False)

    def __post_init__(self) -> None:
        x, u = self.x, ca.SX(0, 1) if self.u is None else self.u
        z = ca.vertcat(x, u)
        values = ca.vertcat(ca.SX(0, 1), *[row.value for row in self.rows])
        after = ca.SX(0, 1) if self.after is None else self.after
        for name, expression in (("after", after), ("cost", self.cost), ("rows", values)):
            _check_symbols(name, expression, x, u, self.data)
        _check_linear("after", after, z)
        _check_linear("rows", values, z)
        H, g = ca.hessian(self.cost, z)
        if ca.depends_on(H, z):
            raise ArgumentError("expected an expression quadratic in the state and the input; found another", "cost")
        n, at_zero = x.numel(), lambda e: ca.substitute(e, z, ca.SX.zeros(z.numel()))
        G, C, g = ca.jacobian(after, z), ca.jacobian(values, z), at_zero(g)
        object.__setattr__(
            self,
            "matrices",
            {
                "A": G[:, :n], "B": G[:, n:], "b": at_zero(after), "Q": H[:n, :n], "S": H[n:, :n], "R": H[n:, n:],
                "q": g[:n], "r": g[n:], "C": C[:, :n], "D": C[:, n:], "constant": at_zero(self.cost),
            },
        )  # fmt: skip
        object.__setattr__(self, "sides", self._sides(at_zero(values)))

    def _sides(self, offset: Any) -> list[Side]:
        sides = []
        for i, row in enumerate(self.rows):
            if row.price is not None and not (row.price[0] >= 0 and row.price[1] >= 0 and sum(row.price) > 0):
                raise ArgumentError(
                    f"expected two prices of at least 0, not both 0; found {row.price}", f"rows[{i}].price"
                )
            if row.low is None and row.high is None:
                raise ArgumentError("expected a low or a high limit; found none", f"rows[{i}]")
            for sign, limit in ((1, row.low), (-1, row.high)):
                if limit is not None:
                    _check_symbols(f"rows[{i}]", ca.SX(limit), ca.SX(0, 1), ca.SX(0, 1), self.data)
                    sides.append(Side(i, sign, sign * (ca.SX(limit) - offset[i]), row.price))
        return sorted(sides, key=lambda side: side.price is not None)  # the exact ones first

    @property
    def states(self) -> int:
        """Number of states."""
        return self.x.numel()

    @property
    def inputs(self) -> int:
        """Number of inputs; 0 in the last stage."""
        return 0 if self.u is None else self.u.numel()

    @property
    def numbers(self) -> int:
        """Number of data."""
        return self.data.numel()

    @property
    def positives(self) -> int:
        """Number of distances and excesses with their multipliers, which are all positive."""
        return 2 * (len(self.sides) + len(self.soft))

    @property
    def soft(self) -> list[int]:
        """Places of the soft limits among `sides`."""
        return [j for j, side in enumerate(self.sides) if side.price is not None]


def _check_symbols(name: str, expression: Any, x: Any, u: Any, data: Any) -> None:
    known = {s.element_hash() for s in ca.symvar(ca.veccat(x, u, data))}
    other = [s.name() for s in ca.symvar(ca.SX(expression)) if s.element_hash() not in known]
    if other:
        raise ArgumentError(f"expected only the symbols of x, u and data; found '{other[0]}'", name)


def _check_linear(name: str, expression: Any, z: Any) -> None:
    if ca.depends_on(ca.jacobian(expression, z), z):
        raise ArgumentError("expected expressions linear in the state and the input; found another", name)
