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
    """Lower and upper bounds with the line that set each."""

    low: np.ndarray
    high: np.ndarray

    @classmethod
    def free(cls, n: int) -> Bounds:
        return cls(np.full(n, -np.inf), np.full(n, np.inf))

    def tighten(self, i: int, low: float, high: float) -> None:
        self.low[i] = max(self.low[i], low)
        self.high[i] = min(self.high[i], high)


@dataclass(eq=False)
class Quadrature:
    """A variable `index` that is its start plus the integral of `integrand` from the start of the horizon on."""

    index: int
    integrand: ca.SX
    start: float


@dataclass(frozen=True, eq=False)
class DynamicProblem:
    """Everything a transcription needs, as expressions of x, xd (state rates), u, P (constants) and t.

    u holds the controls, behind them what is free at each point: delayed inputs, with (control, declaration) in
    `delayed`, and the algebraic variables `z_pairs`. P holds the free constants and behind them the parameters that
    may change between solves (`tunable`). Each state has a rate expression, or None where its rate enters
    `algebraic` rows as xd. `integrals` are (symbol, integrand, constant coefficient in the objective).
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
    shortest: float = 0.0  # the horizon's length [s] that nobody wrote, where nothing else bounds it
    cache: dict[str, Any] = field(default_factory=dict)  # what is made of it when first asked for

    @property
    def loose(self) -> bool:
        """Do rates of states or algebraic variables stand for themselves, held by equations at collocation points?"""
        return any(r is None for r in self.rates) or bool(self.z_pairs)

    @property
    def indifferent(self) -> bool:
        """Is the objective a constant, whatever the motion?"""
        return not any(weight for _, _, weight in self.integrals) and not self.misfits and self.mayer.is_constant()

    @property
    def arguments(self) -> list[ca.SX]:
        """What functions of a point take."""
        return [self.x, self.xd, self.u, self.P, self.t]

    @property
    def state_names(self) -> list[str]:
        own = [self.flat.symbol_name(*p) for p in self.state_pairs]
        return own + [f"integral {k}" for k in range(self.x.numel() - len(own))]

    @property
    def integrands(self) -> ca.Function:
        """(x, xd, u, P, t) -> those of the quadratures."""
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
        """Names of what is free at each point: delayed inputs and algebraic variables."""
        delayed = [self.flat.variables[i].name for i in self.delayed_indices]
        return delayed + [self.flat.symbol_name(*p) for p in self.z_pairs]

    @property
    def input_pairs(self) -> list[Pair]:
        """What each entry of u is."""
        return [(i, 0) for i in (*self.control_indices, *self.delayed_indices)] + self.z_pairs

    @property
    def free_names(self) -> list[str]:
        return [q.name for q in self.flat.parameters if q.free]
