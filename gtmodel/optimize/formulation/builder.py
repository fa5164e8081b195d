"""Express a model in the quantities of a transcription (states, rates, inputs), and split the objective."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import casadi as ca
import numpy as np

from ...compiler.emission import express
from ...compiler.flat import FlatModel
from ...compiler.plan import CausalPlan, differentiated
from ...lang.expression import Expr
from ...lang.optimization import Delayed
from ...lang.scope import Misfit
from ...lang.source import ModelError
from .horizon import ConstraintRow, Horizon, Pair, PointValue, names_of, nominal_of
from .scaling import Jacobians, scale_of

STEPS = 3  # Newton steps from a polynomial's value: reduce an error of 0.1 to rounding


@dataclass(eq=False)
class Explicit:
    """Rates and point variables in x, the given inputs, P, t and the `unknowns`, the roots of `residuals`."""

    rates: list[ca.SX]
    point: list[ca.SX]
    unknowns: list[ca.SX]
    residuals: list[ca.SX]


@dataclass(eq=False)
class ProblemBuilder:
    """Expresses original names in states, rates, controls, free constants and time.

    base: the plan of the explicit form. parameters: numbers or symbols that replace the parameters. delayed: variable
    index -> (source control, declaration). sizes: values by name that replace nominals.
    """

    flat: FlatModel
    plan: CausalPlan
    kind: str
    states: list[Pair]
    controls: list[int]
    base: CausalPlan
    parameters: ca.SX
    tunable: tuple[str, ...]
    delayed: dict[int, tuple[int, Delayed]]
    sizes: Mapping[str, float]

    def __post_init__(self) -> None:
        flat, states = self.flat, self.states
        scope = flat.scope
        self.x = ca.vertcat(*[scope.symbol(*p) for p in states]) if states else ca.SX(0, 1)
        self.xd = ca.vertcat(*[ca.SX.sym(f"rate_{n}") for n in range(len(states))]) if states else ca.SX(0, 1)
        free = [q.symbol for q in flat.parameters if q.free]
        named = {q.name: q.symbol for q in flat.parameters}
        self.n_free = len(free)
        self.P = ca.vertcat(*free, *[named[n] for n in self.tunable]) if free or self.tunable else ca.SX(0, 1)
        # in these forms the rates of the top states are xd
        implicit = self.kind in ("inverse", "dae")
        top = [(i, k + 1, n) for n, (i, k) in enumerate(states) if implicit and (i, k + 1) not in states]
        self.rates = {(i, k): self.xd[n] for i, k, n in top}
        inputs = [*self.controls, *self.delayed]
        self.z_pairs = self._point_unknowns({(i, 0) for i in inputs})
        z = [scope.symbol(*p) for p in self.z_pairs]
        u = [ca.SX.sym(flat.variables[i].name) for i in inputs]
        self.given = ca.vertcat(*u) if u else ca.SX(0, 1)
        self.u = ca.vertcat(self.given, *z)
        # controls are unknowns in all forms
        self.control_symbols: dict[Pair, tuple[int, int]] = {}
        for n, i in enumerate(inputs):
            sign, kept, order = self.plan.alias.resolve(i, 0)
            self.control_symbols[(kept, order)] = (n, sign)

    def _point_unknowns(self, inputs: set[Pair]) -> list[Pair]:
        """Return the variables and derivatives that are free at each point."""
        if self.kind == "dae":
            return [p for p in self.plan.pairs if p not in self.states and p not in self.rates and p not in inputs]
        if self.kind == "torn":
            owners = [self.flat.scope.owner(s) for b in self.plan.newton for s in b.unknowns]
            return [p for p in owners if p is not None]
        return []

    def express(self, expressions: list[ca.SX], with_controls: bool = True) -> list[ca.SX]:
        """Express original names in x, xd, u, P and t."""
        rewritten = self.plan.alias.rewrite_all(self.flat, list(expressions))
        replacements = dict(self.rates)
        if with_controls:
            replacements |= {pair: sign * self.u[n] for pair, (n, sign) in self.control_symbols.items()}
        pairs = [(self.flat.scope.symbol(*pair), e) for pair, e in replacements.items()]
        if self.kind != "dae":
            return express(self.plan, rewritten, pairs)
        old, new = [s for s, _ in pairs], [e for _, e in pairs]
        if self.flat.parameters:
            old, new = [*old, self.flat.p], [*new, self.parameters]
        if old and rewritten:
            rewritten = ca.substitute(rewritten, [ca.vertcat(*old)], [ca.vertcat(*new)])
        return ca.cse(rewritten) if rewritten else []

    def expressible(self, pair: Pair) -> bool:
        """Return whether the problem can express this derivative of a kept variable."""
        if pair in self.states or pair in self.rates or pair in self.z_pairs or pair in self.control_symbols:
            return True
        if self.kind == "dae":
            return False
        symbol = self.flat.scope.symbol(*pair).element_hash()
        return symbol in {s.element_hash() for b in self.plan.blocks for s, _ in b.assignments}

    def off_points(self, written: list[ca.SX], values: list[ca.SX]) -> list[ca.SX | None]:
        """Return the expressions between collocation points, where rates of states and algebraic variables must be
        solved from the equations; None for expressions without these. values: the expressions at the points."""
        loose = {s.element_hash() for s in ca.vertsplit(ca.vertcat(self.xd, self.u[self.given.numel() :]))}
        needed = [n for n, e in enumerate(values) if loose & {s.element_hash() for s in ca.symvar(e)}]
        result: list[ca.SX | None] = [None] * len(values)
        if not needed:
            return result
        explicit_builder, form = self.other(), self.explicit()
        expressions = explicit_builder.express([written[n] for n in needed])
        if self.given.numel():
            expressions = ca.substitute(expressions, [explicit_builder.given], [self.given])
        if form.unknowns:
            # Newton steps from the unknowns' polynomials, whose error they square
            z, r = ca.vertcat(*form.unknowns), ca.vertcat(*form.residuals)
            step = z - ca.solve(ca.densify(ca.jacobian(r, z)), r)
            for _ in range(STEPS):
                expressions = ca.substitute(expressions, [z], [step])
            expressions = ca.substitute(expressions, [z], [ca.vertcat(*self.express(form.unknowns))])
        for n, e in zip(needed, expressions, strict=True):
            result[n] = e
        return result

    def explicit(self) -> Explicit:
        """Return rates and point variables as functions of x, the given inputs, P and t."""
        base, explicit_builder = self.base, self.other()
        scope = self.flat.scope
        unknowns = [s for b in base.newton for s in b.unknowns]
        residuals = [r for b in base.newton for r in b.residuals]
        targets = [scope.symbol(i, k + 1) for i, k in self.states] + [scope.symbol(*p) for p in self.z_pairs]
        expressions = explicit_builder.express([*targets, *residuals])
        if expressions and self.given.numel():
            expressions = ca.substitute(expressions, [explicit_builder.given], [self.given])
        n, m = len(self.states), len(targets)
        return Explicit(expressions[:n], expressions[n:m], unknowns, expressions[m:])

    def other(self) -> ProblemBuilder:
        """Return the builder of the explicit (or torn) form."""
        return replace(self, plan=self.base, kind="torn" if self.base.newton else "explicit")

    def dynamics(self) -> tuple[list[ca.SX | None], ca.SX, list[str]]:
        """Return rates, algebraic rows that must vanish, and the labels of these rows."""
        flat, plan = self.flat, self.plan
        rates: list[ca.SX | None] = []
        missing = []
        for i, k in self.states:
            if (i, k + 1) in self.states:
                rates.append(flat.scope.symbol(i, k + 1))
            elif self.kind in ("inverse", "dae"):
                rates.append(None)
            else:
                rates.append(flat.scope.symbol(i, k + 1))
                missing.append(len(rates) - 1)
        for n, e in zip(missing, self.express([r for n in missing if (r := rates[n]) is not None]), strict=True):
            rates[n] = e
        rows: list[ca.SX] = []
        labels: list[str] = []
        if self.kind == "inverse":
            computed = self.express([flat.scope.symbol(i, 0) for i in self.controls], with_controls=False)
            rows += [self.u[n] - e for n, e in enumerate(computed)]
            labels += [f"{flat.variables[i].name} by the motion" for i in self.controls]
        elif self.kind == "dae":
            equations_dae = differentiated(plan)
            rows += self.express([r for _, r in equations_dae])
            labels += [label for label, _ in equations_dae]
        elif self.kind == "torn":
            rows += self.express([r for b in plan.newton for r in b.residuals])
            for block in plan.blocks:
                if block.newton is not None:
                    # each remaining equation after elimination derives from the whole block
                    equations = "; ".join(dict.fromkeys(block.equations))
                    size = block.newton.size
                    labels += [f"block of {equations}{f'[{k}]' if size > 1 else ''}" for k in range(size)]
        # conditions on the controls alone, such as u'u = 1
        rows += self.express([e.residual for e in self.base.conditions])
        labels += [f"{e.label} ({e.where})" for e in self.base.conditions]
        return rates, ca.vertcat(*rows) if rows else ca.SX(0, 1), labels

    @property
    def input_pairs(self) -> list[Pair]:
        """Variable and derivative order of each entry of u."""
        return [(i, 0) for i in (*self.controls, *self.delayed)] + self.z_pairs

    def nominal(self, pair: Pair) -> float:
        """Return the size of a variable's derivative: from `sizes`, else its nominal."""
        declared = [self.sizes[n] for n, _ in names_of(self.flat, self.base.alias, pair) if n in self.sizes]
        return declared[0] if declared else nominal_of(self.flat, self.base.alias, pair)

    def nominals(self, pairs: list[Pair]) -> np.ndarray:
        """Return the sizes of several derivatives."""
        return np.array([self.nominal(p) for p in pairs])

    def jacobian(self, x_scale: np.ndarray, u_scale: np.ndarray, P: np.ndarray) -> Jacobians:
        """Return the derivatives of rows per size of the states, their rates and the inputs."""
        tops = [(i, k + 1) for i, k in self.states]
        inputs = self.input_pairs
        arguments = [self.x, self.xd, self.u, self.P, self.flat.scope.time]
        nominal = np.concatenate([x_scale, self.nominals(tops), u_scale])
        return Jacobians(self.base, arguments, (self.states, tops, inputs), nominal, P)

    def numbers(self, e: ca.SX) -> ca.SX:
        """Insert the values of all parameters that are not free."""
        return ca.substitute([e], [self.flat.p], [self.parameters])[0] if self.flat.parameters else e

    def require(self, e: ca.SX, allowed: list[ca.SX], sentence: str, hint: str = "") -> None:
        """Raise ModelError for symbols in e that are not in `allowed`."""
        known = {s.element_hash() for a in allowed for s in ca.vertsplit(ca.vec(a))}
        strange = [s.name() for s in ca.symvar(e) if s.element_hash() not in known]
        if strange:
            named = f" {', '.join(strange)} along the whole path" if hint else ""
            raise ModelError(f"{self.flat.title}: {sentence}{named}{hint}")


@dataclass(eq=False)
class CostTerms:
    """integrals: (symbol, integrand, constant coefficient); mayer: the remaining objective in values at `instants`;
    points: rows in these values. states: integrals turned into states, with integrand and size."""

    mayer: ca.SX
    misfits: list[Misfit]
    instants: list[PointValue]
    integrals: list[tuple[ca.SX, ca.SX, float]] = field(default_factory=list)
    points: list[ConstraintRow] = field(default_factory=list)
    states: list[tuple[ca.SX, ca.SX, float]] = field(default_factory=list)


def cost_of(
    b: ProblemBuilder, objective: Expr, points: list[ConstraintRow], instants: list[PointValue], jacobian: Jacobians,
    ends: Horizon, guess: np.ndarray, scale: np.ndarray,
) -> CostTerms:  # fmt: skip
    """Split the objective into integrals and values at instants. guess, scale: of the free constants.

    Raises ModelError if the objective or a row contains anything else.
    """
    terms = CostTerms(ca.SX(0), [], list(instants))
    integrals = [i for i in b.flat.scope.instants if i.time is None]
    cost = b.numbers(objective.sx)
    used_in_points = {s.element_hash() for r in points for s in ca.symvar(r.expression)}
    integrands = b.express([i.expression for i in integrals]) if integrals else []
    along = [b.x, b.xd, b.u, b.P, b.flat.scope.time]
    length = abs(float(ca.Function("length", [b.P], [ends.tf - ends.t0])(guess)))
    sizes_of = {i.symbol.element_hash(): i.expression for i in instants}
    for instant, integrand in zip(integrals, integrands, strict=True):
        b.require(integrand, along, "the argument of gt.integral() contains a value at an instant or an integral")
        weight = ca.gradient(cost, instant.symbol)
        if weight.is_constant() and instant.symbol.element_hash() not in used_in_points:
            terms.integrals.append((instant.symbol, integrand, float(weight)))
            cost = ca.substitute([cost], [instant.symbol], [ca.SX(0)])[0]
            continue
        q = ca.SX.sym(f"integral_{b.x.numel() + len(terms.states)}")
        terms.states.append((q, integrand, scale_of(float(jacobian.typical([length * integrand])[0]))))
        terms.instants.append(PointValue(instant.symbol, q, 1.0))
        sizes_of[instant.symbol.element_hash()] = length * integrand
    at_points = [b.P, *(i.symbol for i in terms.instants)]
    if getattr(type(b.flat.root), "_counts_from_one", False):  # of Modelica
        words = "objective contains", "; use a value at an instant, x(finalTime), or objectiveIntegrand"
    else:
        words = "objective() contains", "; use a value .at(...) or gt.integral(...)"
    b.require(cost, at_points, *words)
    terms.mayer = cost
    terms.misfits = [Misfit(b.numbers(m.residual), m.known) for m in b.flat.scope.misfits]
    for r in points:
        e = b.numbers(r.expression)
        b.require(e, at_points, f"{r.label} contains", ", together with a value at an instant or an integral")
        if not ca.symvar(e):
            raise ModelError(f"{r.label} contains no variable or free constant: {r.low:g} <= {e} <= {r.high:g}")
        terms.points.append(replace(r, expression=e))
    values = [sizes_of[i.symbol.element_hash()] for i in terms.instants]
    symbols = ca.vertcat(*[i.symbol for i in terms.instants])
    sizes = jacobian.of_points([r.expression for r in terms.points], symbols, values, b.P, scale)
    for r, size in zip(terms.points, sizes, strict=True):
        r.scale = scale_of(float(size)) if r.scale == 1.0 else r.scale
    return terms
