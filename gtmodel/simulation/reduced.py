"""The reduced system of a plan as numbers see it: rates, outputs, margins and the whole point."""

from __future__ import annotations

from functools import cached_property

import casadi as ca
import numpy as np

from ..compiler.blocks import Margin
from ..compiler.emit import express
from ..compiler.flat import FlatModel
from ..compiler.plan import CausalPlan
from .inputs import SimulationInputs
from .over_rows import OverRows

Pair = tuple[int, int]


class Reduced:
    """x' = f(x, z, t, p), 0 = r(x, z, t, p): x states, z Newton unknowns, p pieces of tables (see Inputs).

    `outputs` are expressions of original symbols, as the energies are.
    """

    def __init__(self, plan: CausalPlan, inputs: SimulationInputs, outputs: list[ca.SX]) -> None:
        flat, scope = plan.flat, plan.flat.scope
        self.plan = plan
        self.x = _column([scope.symbol(*s) for s in plan.states])
        self.z = _column([u for b in plan.newton for u in b.unknowns])
        self.t, self.p = inputs.t, inputs.p
        self._arguments = [self.x, self.z, self.t, self.p]
        own = set(plan.states)
        given = [(scope.symbol(*pair), inputs.expression(*pair)) for pair in plan.inputs if pair not in own]
        stored, supplied, dissipated = (energy(flat, kind) for kind in ("stored", "supplied", "dissipated"))
        groups = {
            "rates": [scope.symbol(i, k + 1) for i, k in plan.states],
            "powers": plan.alias.rewrite_all(flat, [supplied, dissipated]),
            "residuals": [r for b in plan.newton for r in b.residuals],
            "margins": [m.expression for b in plan.blocks for m in b.margins],
            "point": [scope.symbol(*pair) for pair in plan.pairs],
            "outputs": plan.alias.rewrite_all(flat, [*outputs, stored]),
        }
        expressions = express(plan, [e for group in groups.values() for e in group], [*given, (scope.time, self.t)])
        symbols, numbers = inputs.varied
        values = iter(ca.substitute(expressions, [symbols], [numbers]) if inputs.parameters else expressions)
        columns = {name: _column([next(values) for _ in group]) for name, group in groups.items()}
        self.rates, self.powers, self.residuals = columns["rates"], columns["powers"], columns["residuals"]
        self._margins, self._point, self.outputs = columns["margins"], columns["point"], columns["outputs"]

    def _function(self, name: str, *results: ca.SX) -> ca.Function:
        return ca.Function(name, self._arguments, list(results))

    @cached_property
    def row(self) -> OverRows:
        """(x, z, t, p) -> outputs with the stored energy last."""
        return OverRows(self._function("row", self.outputs))

    @cached_property
    def margins(self) -> ca.Function:
        """(x, z, t, p) -> what must not be negative or vanish, in the order of the plan's blocks."""
        return self._function("margins", self._margins)

    @cached_property
    def point(self) -> OverRows:
        """(x, z, t, p) -> values over plan.pairs."""
        return OverRows(self._function("point", self._point))

    @cached_property
    def rate(self) -> ca.Function:
        """(x, z, t, p) -> rates of the states."""
        return self._function("rate", self.rates)

    @property
    def margin_expressions(self) -> list[tuple[Margin, ca.SX]]:
        """Margins of the plan's blocks with their expressions of (x, z, t, p)."""
        margins = [m for b in self.plan.blocks for m in b.margins]
        return list(zip(margins, ca.vertsplit(self._margins) if margins else [], strict=True))

    @property
    def unknowns(self) -> str:
        """Names of the Newton unknowns, for messages."""
        labels = [label for b in self.plan.newton for label in b.labels]
        return ", ".join(labels[:4]) + (f" and {len(labels) - 4} more" if len(labels) > 4 else "")

    def from_point(self, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """States and Newton unknowns of a point over plan.pairs."""
        place = {pair: n for n, pair in enumerate(self.plan.pairs)}
        scope = self.plan.flat.scope
        unknowns = [scope.owner(u) for b in self.plan.newton for u in b.unknowns]
        return (
            np.array([w[place[s]] for s in self.plan.states]),
            np.array([w[place[pair]] for pair in unknowns if pair is not None]),
        )


def energy(flat: FlatModel, kind: str) -> ca.SX:
    """Sum of what the components declare: "stored" [J], "supplied" or "dissipated" [W]; in original symbols."""
    total = ca.SX(0)
    for e in flat.energies:
        if e.kind == kind:
            total = total + e.expression
    return total


def _column(expressions: list[ca.SX]) -> ca.SX:
    return ca.SX(ca.vertcat(*expressions)) if expressions else ca.SX(0, 1)
