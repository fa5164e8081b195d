"""The reduced system of a plan as numbers see it: rates, outputs, and how well its states are chosen."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from ..compiler.emit import express
from ..compiler.plan import Plan
from ..compiler.states import conditioning, stage_choices
from ..lang.source import ModelError
from .inputs import Inputs

Pair = tuple[int, int]


@dataclass(eq=False)
class Reduced:
    """x' = f(x, z, t, p), 0 = r(x, z, t, p), y = g(x, z, t, p).

    x: states and the integrals of power; z: Newton unknowns; p: of each table input its value and slope at a
    reference time. `outputs` are (name, expression of original symbols).
    """

    plan: Plan
    inputs: Inputs
    outputs: list[ca.SX]

    def __post_init__(self) -> None:
        plan, flat = self.plan, self.plan.flat
        scope = flat.scope
        self.x = ca.vertcat(*[scope.symbol(*s) for s in plan.states]) if plan.states else ca.SX(0, 1)
        self.t = self.inputs.t
        self.p = ca.SX.sym("p", 1 + 2 * len(self.inputs.tables))
        extra: list[tuple[ca.SX, ca.SX]] = []
        for index, order in plan.inputs:
            if (index, order) in plan.states:
                continue
            extra.append((scope.symbol(index, order), self._known(index, order)))
        extra.append((scope.time, self.t))
        unknowns = [u for b in plan.newton for u in b.unknowns]
        self.z = ca.vertcat(*unknowns) if unknowns else ca.SX(0, 1)
        rates = [scope.symbol(i, k + 1) for i, k in plan.states]
        powers = [plan.alias.rewrite(flat, e) for e in _powers(plan)]
        outputs = [plan.alias.rewrite(flat, e) for e in self.outputs]
        residuals = [r for b in plan.newton for r in b.residuals]
        margins = [m.expression for b in plan.blocks for m in b.margins]
        values = express(plan, [*rates, *powers, *residuals, *margins, *outputs], extra)
        n, m = len(rates), len(powers)
        k = n + m + len(residuals)
        self.rates = ca.vertcat(*values[:n]) if n else ca.SX(0, 1)
        self.powers = ca.vertcat(*values[n : n + m])
        self.residuals = ca.vertcat(*values[n + m : k]) if residuals else ca.SX(0, 1)
        self.margins = ca.vertcat(*values[k : k + len(margins)]) if margins else ca.SX(0, 1)
        self.outputs_x = ca.vertcat(*values[k + len(margins) :])
        self._extra = extra

    def _known(self, index: int, order: int) -> ca.SX:
        """Expression of a known variable's derivative in t and p."""
        if index in self.inputs.functions:
            e = self.inputs.functions[index]
            for _ in range(order):
                e = ca.jacobian(e, self.t)
            return ca.densify(e)
        if index in self.inputs.tables:
            k = sorted(self.inputs.tables).index(index)
            value, slope = self.p[1 + 2 * k], self.p[2 + 2 * k]
            if order == 0:
                return value + slope * (self.t - self.p[0])
            if order == 1:
                return slope
            name = self.plan.flat.symbol_name(index, order)
            raise ModelError(f"the model needs {name}, which a table does not have; give a function of time")
        name = self.plan.flat.variables[index].name
        raise ModelError(f"input '{name}' needs a value; give inputs={{'{name}': ...}}")

    def table_parameters(self, left: float, right: float) -> np.ndarray:
        """p for the piece of the tables between two neighbouring knots."""
        if not self.inputs.tables:
            return np.array([left])
        a, b = self.inputs.table_values(left), self.inputs.table_values(right)
        slope = (b - a) / (right - left)
        return np.concatenate([[left], np.column_stack([a, slope]).reshape(-1)])

    @cached_property
    def output(self) -> ca.Function:
        return ca.Function("output", [self.x, self.z, self.t, self.p], [self.outputs_x])

    @cached_property
    def margin(self) -> ca.Function:
        return ca.Function("margin", [self.x, self.z, self.t, self.p], [self.margins])

    @cached_property
    def point(self) -> ca.Function:
        """(x, z, t, p) -> values over plan.pairs."""
        flat = self.plan.flat
        values = express(self.plan, [flat.scope.symbol(*pair) for pair in self.plan.pairs], self._extra)
        f = ca.Function("point", [self.x, self.z, self.t, self.p], [ca.vertcat(*values)], {"allow_free": True})
        if f.has_free():
            # symbols that no target needs: they are found by initialisation where they matter
            free = ca.vertcat(*f.free_sx())
            vector = ca.substitute([ca.vertcat(*values)], [free], [ca.SX.zeros(*free.shape)])[0]
            f = ca.Function("point", [self.x, self.z, self.t, self.p], [vector])
        return f

    @cached_property
    def _quality(self) -> ca.Function:
        e = express(self.plan, [ca.densify(self.plan.system)], self._extra)[0]
        f = ca.Function("system", [self.x, self.z, self.t, self.p], [e], {"allow_free": True})
        if f.has_free():
            e = ca.substitute([e], [ca.vertcat(*f.free_sx())], [ca.SX.zeros(len(f.free_sx()), 1)])[0]
            f = ca.Function("system", [self.x, self.z, self.t, self.p], [e])
        return f

    def quality(self, x: np.ndarray, z: np.ndarray, t: float, p: np.ndarray) -> float:
        """How well conditioned the chosen columns are, relative to the best choice at this point; 1 is best."""
        if not stage_choices(self.plan.stages):
            return 1.0
        matrix = np.asarray(self._quality(x, z, t, p).full())
        if not np.all(np.isfinite(matrix)):
            return 0.0
        return conditioning(self.plan.flat, self.plan.structure, self.plan.stages, matrix)


def _powers(plan: Plan) -> list[ca.SX]:
    """Total supplied and dissipated power [W]."""
    result = []
    for kind in ("supplied", "dissipated"):
        total = ca.SX(0)
        for e in plan.flat.energies:
            if e.kind == kind:
                total = total + e.expression
        result.append(total)
    return result


def stored_energy(plan: Plan) -> ca.SX:
    """Total stored energy [J] in original symbols."""
    total = ca.SX(0)
    for e in plan.flat.energies:
        if e.kind == "stored":
            total = total + e.expression
    return total
