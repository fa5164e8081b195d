"""A dynamic problem at one point: states, inputs, residuals, bounds and cost as expressions."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from ...compiler.flat import FlatModel
from ...compiler.plan import CausalPlan
from ...lang.optimization import Delayed
from ...lang.scope import Misfit
from .horizon import ConstraintRow, Pair, PointValue

if TYPE_CHECKING:
    from .builder import ProblemBuilder


@dataclass
class Bounds:
    """Lower and upper bounds."""

    low: np.ndarray
    high: np.ndarray
    origins: dict[int, list[str]] = field(default_factory=dict)  # by entry: who set its bounds

    @classmethod
    def free(cls, n: int) -> Bounds:
        return cls(np.full(n, -np.inf), np.full(n, np.inf))

    def tighten(self, i: int, low: float, high: float, origin: str = "") -> None:
        self.low[i] = max(self.low[i], low)
        self.high[i] = min(self.high[i], high)
        if origin:
            self.origins.setdefault(i, []).append(origin)


@dataclass(eq=False)
class Quadrature:
    """A variable `index` equal to `start` plus the integral of `integrand` from the start of the horizon."""

    index: int
    integrand: ca.SX
    start: float


@dataclass(frozen=True, eq=False)
class DynamicProblem:
    """Everything a transcription needs, as expressions of x, xd (state rates), u, P (constants) and t.

    u: the controls, then the variables free at each point: delayed inputs, with (control, declaration) in `delayed`,
    and the algebraic variables `z_pairs`. P: the free constants, then the parameters that may change between solves
    (`tunable`). Each state has a rate expression, or None if its rate enters the `algebraic` rows as xd. `integrals`:
    (symbol, integrand, constant coefficient in the objective).
    The solver's unknowns are x, u and P divided by `x_scale`, `u_scale` and `P_scale`.
    """

    flat: FlatModel
    plan: CausalPlan
    formulation: str
    state_pairs: list[Pair]
    control_indices: list[int]
    x: ca.SX
    xd: ca.SX
    u: ca.SX
    P: ca.SX
    t: ca.SX
    t0: ca.SX
    tf: ca.SX
    rates: list[ca.SX | None]
    algebraic: ca.SX
    algebraic_labels: list[str]
    algebraic_scale: np.ndarray
    path: list[ConstraintRow]
    x_bounds: Bounds
    u_bounds: Bounds
    P_bounds: Bounds
    P_guess: np.ndarray
    start_bounds: Bounds
    end_bounds: Bounds
    integrals: list[tuple[ca.SX, ca.SX, float]]
    instants: list[PointValue]
    mayer: ca.SX
    points: list[ConstraintRow]
    builder: ProblemBuilder
    base: CausalPlan
    x_scale: np.ndarray
    u_scale: np.ndarray
    P_scale: np.ndarray
    delayed: list[tuple[int, Delayed]] = field(default_factory=list)
    delayed_indices: list[int] = field(default_factory=list)
    z_pairs: list[Pair] = field(default_factory=list)
    tunable: tuple[str, ...] = ()
    branches: dict[str, int] = field(default_factory=dict)
    misfits: list[Misfit] = field(default_factory=list)
    quadratures: list[Quadrature] = field(default_factory=list)  # costs written as states: see quadratures.set_apart
    shortest: float = 0.0  # automatic lower bound of the horizon's length [s]; 0 if the problem has its own
    cache: dict[str, Any] = field(default_factory=dict)  # objects built from the problem on first use

    @property
    def loose(self) -> bool:
        """Whether rates or algebraic variables are unknowns that satisfy the equations at collocation points only."""
        return any(r is None for r in self.rates) or bool(self.z_pairs)

    @property
    def indifferent(self) -> bool:
        """Whether the objective is constant."""
        return not any(weight for _, _, weight in self.integrals) and not self.misfits and self.mayer.is_constant()

    @property
    def arguments(self) -> list[ca.SX]:
        """Arguments of the functions of a point."""
        return [self.x, self.xd, self.u, self.P, self.t]

    @property
    def state_names(self) -> list[str]:
        names = [self.flat.symbol_name(*p) for p in self.state_pairs]
        return names + [f"integral {k}" for k in range(self.x.numel() - len(names))]

    @property
    def integrands(self) -> ca.Function:
        """(x, xd, u, P, t) -> integrands of the quadratures."""
        values = [q.integrand for q in self.quadratures]
        return ca.Function("integrands", self.arguments, [ca.vertcat(*values) if values else ca.SX(0, 1)])

    @property
    def quadrature_names(self) -> list[str]:
        return [self.flat.variables[q.index].name for q in self.quadratures]

    @property
    def control_names(self) -> list[str]:
        return [self.flat.variables[i].name for i in self.control_indices]

    @property
    def point_names(self) -> list[str]:
        """Names of the variables that are free at each point: delayed inputs and algebraic variables."""
        delayed = [self.flat.variables[i].name for i in self.delayed_indices]
        return delayed + [self.flat.symbol_name(*p) for p in self.z_pairs]

    @property
    def input_pairs(self) -> list[Pair]:
        """Variable and derivative order of each entry of u."""
        return [(i, 0) for i in (*self.control_indices, *self.delayed_indices)] + self.z_pairs

    @property
    def free_names(self) -> list[str]:
        return [q.name for q in self.flat.parameters if q.free]
