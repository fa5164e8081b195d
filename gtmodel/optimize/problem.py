"""From an Optimization to a pointwise dynamic problem: states, controls, residuals, bounds, cost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ..compiler.causal import flat_of
from ..compiler.emit import express
from ..compiler.flat import FlatModel
from ..compiler.plan import Plan, make_plan
from ..lang.expression import Expr
from ..lang.optimization import Optimization
from ..lang.source import ModelError
from .attributes import Pair, nominal_of
from .horizon import PointValue, horizon, initial_rows, point_values, require_length
from .relations import Row, as_bound, relations

FORMULATIONS = ("auto", "inverse", "explicit")


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
class DynamicProblem:
    """Everything a transcription needs, as expressions of x, xd (state rates), u, P (free constants) and t.

    Each state has a rate expression, or None where its rate enters `algebraic` rows as xd. `integrals` are
    (symbol, integrand, constant coefficient in the objective).
    """

    model: Optimization
    flat: FlatModel
    plan: Plan
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
    path: list[Row]
    x_bounds: Bounds
    u_bounds: Bounds
    P_bounds: Bounds
    P_guess: np.ndarray
    start_bounds: Bounds
    end_bounds: Bounds
    integrals: list[tuple[ca.SX, ca.SX, float]]
    instants: list[PointValue]
    mayer: ca.SX
    points: list[Row]
    builder: Builder
    base: Plan
    outputs: Any = None  # the function that evaluates every name, made when first asked for

    @property
    def state_names(self) -> list[str]:
        own = [self.flat.symbol_name(*p) for p in self.state_pairs]
        return own + [f"integral {k}" for k in range(self.x.numel() - len(own))]

    @property
    def control_names(self) -> list[str]:
        return [self.flat.variables[i].name for i in self.control_indices]

    @property
    def free_names(self) -> list[str]:
        return [q.name for q in self.flat.parameters if q.free]

    @property
    def x_scale(self) -> np.ndarray:
        own = [nominal_of(self.flat, self.base.alias, p) for p in self.state_pairs]
        return np.array(own + [1.0] * (self.x.numel() - len(own)))

    @property
    def u_scale(self) -> np.ndarray:
        return np.array([nominal_of(self.flat, self.base.alias, (i, 0)) for i in self.control_indices])


def build(model: Optimization, formulation: str = "auto", prefer: Sequence[str] = ()) -> DynamicProblem:
    """Flatten, choose states, and express cost and constraints in them; made once per configuration object.

    formulation: "explicit" (rates as functions of states and controls), "inverse" (controls as functions of
    states and their rates, for fully actuated models: no accelerations are eliminated), or "auto" (inverse
    where it exists and does not bring the only divisions by something that may vanish, as in u = (x' - f) / cos x).
    Raises ModelError with file and line.
    """
    if formulation not in FORMULATIONS:
        raise ValueError(f"formulation is one of {', '.join(FORMULATIONS)}; found '{formulation}'")
    flat = flat_of(model)
    key = ("problem", formulation, tuple(prefer))
    if key not in flat.cache:
        flat.cache[key] = _build(model, flat, formulation, prefer)
    return flat.cache[key]


def _build(model: Optimization, flat: FlatModel, formulation: str, prefer: Sequence[str]) -> DynamicProblem:
    root = flat.root
    if not isinstance(root, Optimization):
        raise ModelError(f"{flat.title} is no Optimization; give it an objective and a horizon")
    flat.scope.instants.clear()  # those of another formulation of the same model
    objective = root.objective()
    if not isinstance(objective, Expr) or objective.shape != ():
        raise ModelError(f"{flat.title}.objective() must return a scalar expression; found {objective!r}")
    constraints = relations(root.constraints(), flat) + initial_rows(flat)
    controls = [v.index for v in flat.variables if v.role == "input"]
    preferred = [i for name in prefer for i in flat.lookup(name)[1]]
    fold = _fold(flat)
    base = make_plan(flat, controls, _all_pairs(flat, constraints), preferred, rates=True, fold=fold)
    _refuse_newton(flat, base)
    states = base.states
    steep = [flat.symbol_name(i, k) for i, k in base.inputs if i in controls and k > 0]
    if steep:
        raise ModelError(
            f"{flat.title} needs {', '.join(steep)}, but a control may jump; make it a state and its derivative "
            "the control"
        )
    plan, kind = base, "explicit"
    if formulation in ("auto", "inverse"):
        inverse = _inverse_plan(flat, controls, states, constraints)
        if inverse is not None and (formulation == "inverse" or not (_pivots(inverse) and not _pivots(base))):
            plan, kind = inverse, "inverse"
        elif formulation == "inverse":
            raise ModelError(
                f"{flat.title}: the controls are not determined by the motion of the states "
                f"({len(controls)} controls for {len({i for i, _ in states})} coordinates); use formulation 'explicit'"
            )
    return Builder(model, root, flat, plan, kind, states, controls, base).problem(objective, constraints)


def _pivots(plan: Plan) -> bool:
    """Does it divide by what depends on the state?"""
    return any(m.kind == "pivot" for b in plan.blocks for m in b.margins)


def _fold(flat: FlatModel) -> ca.SX:
    """Numbers for the parameters, symbols for the free constants."""
    values = flat.require_values()
    return ca.vertcat(*[q.symbol if q.free else ca.SX(values[n]) for n, q in enumerate(flat.parameters)])


def _all_pairs(flat: FlatModel, constraints: list[Row]) -> list[Pair]:
    """Every chain symbol that anything in the model, its cost or its constraints mentions."""
    expressions = [i.expression for i in flat.scope.instants] + [r.expression for r in constraints]
    named = [p for e in expressions for p in flat.scope.symbols_in(e)]
    return sorted({(v.index, 0) for v in flat.variables} | set(named))


def _inverse_plan(flat: FlatModel, controls: list[int], states: list[Pair], constraints: list[Row]) -> Plan | None:
    coordinates = sorted({i for i, _ in states})
    if len(coordinates) != len(controls) or not controls:
        return None
    if any((i, k) not in states for i, top in states for k in range(top)):
        return None
    try:
        plan = make_plan(flat, coordinates, _all_pairs(flat, constraints), fold=_fold(flat))
    except ModelError:
        return None  # not every motion of these coordinates is possible: the explicit form always is
    top = {i: max(k for j, k in states if j == i) + 1 for i in coordinates}
    usable = not plan.newton and not plan.states
    return plan if usable and all(k <= top[i] for i, k in plan.inputs) else None


def _refuse_newton(flat: FlatModel, plan: Plan) -> None:
    """Collocation takes closed forms only, so far."""
    if plan.newton:
        names = "; ".join(", ".join(b.labels) for b in plan.newton)
        raise ModelError(
            f"{flat.title}: the equations for {names} have no closed form, and optimisation needs one; keep one of "
            "these variables as a state, or make it an input with an equality in constraints()"
        )


class Builder:
    """Writes expressions of original names in states, rates, controls, free constants and time."""

    def __init__(
        self,
        model: Optimization,
        root: Optimization,
        flat: FlatModel,
        plan: Plan,
        kind: str,
        states: list[Pair],
        controls: list[int],
        base: Plan,
    ) -> None:
        self.base = base
        self.model, self.root, self.flat, self.plan, self.kind = model, root, flat, plan, kind
        self.states, self.controls = states, controls
        scope = flat.scope
        self.x = ca.vertcat(*[scope.symbol(*p) for p in states]) if states else ca.SX(0, 1)
        self.u = ca.vertcat(*[ca.SX.sym(flat.variables[i].name) for i in controls]) if controls else ca.SX(0, 1)
        self.xd = ca.vertcat(*[ca.SX.sym(f"rate_{n}") for n in range(len(states))]) if states else ca.SX(0, 1)
        free = [q.symbol for q in flat.parameters if q.free]
        self.P = ca.vertcat(*free) if free else ca.SX(0, 1)
        self.parameters = _fold(flat)
        # a control is a variable of its own in both forms; in the inverse form the top rates are xd
        self.control_symbols: dict[Pair, tuple[int, int]] = {}
        for n, i in enumerate(controls):
            sign, kept, order = plan.alias.resolve(i, 0)
            self.control_symbols[(kept, order)] = (n, sign)
        top = [(i, k + 1, n) for n, (i, k) in enumerate(states) if kind == "inverse" and (i, k + 1) not in states]
        self.rates = {(i, k): self.xd[n] for i, k, n in top}

    def express(self, expressions: list[ca.SX], with_controls: bool = True) -> list[ca.SX]:
        """Expressions of original names in x, xd, u, P and t."""
        rewritten = [self.plan.alias.rewrite(self.flat, e) for e in expressions]
        given = dict(self.rates)
        if with_controls:
            given |= {pair: sign * self.u[n] for pair, (n, sign) in self.control_symbols.items()}
        return express(self.plan, rewritten, [(self.flat.scope.symbol(*pair), e) for pair, e in given.items()])

    def problem(self, objective: Expr, constraints: list[Row]) -> DynamicProblem:
        flat, states = self.flat, self.states
        position = {p: n for n, p in enumerate(states)}
        x_bounds, u_bounds = Bounds.free(len(states)), Bounds.free(len(self.controls))
        start, end = Bounds.free(len(states)), Bounds.free(len(states))
        path: list[Row] = []
        for v in flat.variables:
            if not (np.isfinite(v.min) or np.isfinite(v.max)):
                continue
            sign, kept, order = self.plan.alias.resolve(v.index, 0)
            low, high = (v.min, v.max) if sign > 0 else (-v.max, -v.min)
            if (kept, order) in position:
                x_bounds.tighten(position[(kept, order)], low, high)
            elif (kept, order) in self.control_symbols:
                n, s = self.control_symbols[(kept, order)]
                u_bounds.tighten(n, *((low, high) if s > 0 else (-high, -low)))
            else:
                symbol = flat.scope.symbol(v.index, 0)
                path.append(Row(symbol, v.min, v.max, f"bounds of {v.name}", v.where))
        ends = horizon(flat, self.P, self.parameters)
        require_length(flat, ends, constraints)
        instants = point_values(flat, ends, flat.scope.instants, self.parameters)
        points: list[Row] = []
        for row in constraints:
            if self._is_point(row.expression):
                if not self._end_bound(row, instants, position, start, end):
                    points.append(row)
                continue
            rewritten = self.plan.alias.rewrite(flat, row.expression)
            bound = as_bound(rewritten, row, flat, self.parameters)
            if bound is not None and bound[0] in position:
                x_bounds.tighten(position[bound[0]], bound[1], bound[2])
            elif bound is not None and bound[0] in self.control_symbols:
                n, s = self.control_symbols[bound[0]]
                low, high = bound[1:]
                u_bounds.tighten(n, *((low, high) if s > 0 else (-high, -low)))
            else:
                path.append(row)
        self._initial(position, start)
        values = self.express([i.expression for i in instants] + [r.expression for r in path])
        for i, e in zip(instants, values[: len(instants)], strict=True):
            i.expression = e
        path = [Row(e, r.low, r.high, r.label, r.where) for r, e in zip(path, values[len(instants) :], strict=True)]
        P_bounds = Bounds(
            np.array([q.min for q in flat.parameters if q.free]), np.array([q.max for q in flat.parameters if q.free])
        )
        self._check_bounds(x_bounds, u_bounds, P_bounds, start, end)
        rates, algebraic, labels, scale = self._dynamics()
        problem = DynamicProblem(
            model=self.model, flat=flat, plan=self.plan, formulation=self.kind, state_pairs=states,
            control_indices=self.controls, x=self.x, xd=self.xd, u=self.u, P=self.P, t=flat.scope.time,
            t0=ends.t0, tf=ends.tf, rates=rates, algebraic=algebraic, algebraic_labels=labels, algebraic_scale=scale,
            path=path, x_bounds=x_bounds, u_bounds=u_bounds, P_bounds=P_bounds,
            P_guess=np.array([q.value for q in flat.parameters if q.free]),
            start_bounds=start, end_bounds=end, integrals=[], instants=[], mayer=ca.SX(0), points=[],
            builder=self, base=self.base,
        )  # fmt: skip
        self._cost(problem, objective, points, instants)
        return problem

    def explicit_rates(self) -> list[ca.SX]:
        """Rates of the states as functions of x, u, P and t, whatever the formulation."""
        other = Builder(self.model, self.root, self.flat, self.base, "explicit", self.states, self.controls, self.base)
        rates = other.express([self.flat.scope.symbol(i, k + 1) for i, k in self.states])
        return ca.substitute(rates, [other.u], [self.u]) if rates and self.controls else rates

    def _is_point(self, e: ca.SX) -> bool:
        keys = {s.element_hash() for i in self.flat.scope.instants for s in ca.vertsplit(ca.vec(i.symbol))}
        constant = {q.symbol.element_hash() for q in self.flat.parameters}
        found = [s.element_hash() for s in ca.symvar(e)]
        return any(k in keys for k in found) or all(k in constant for k in found)

    def _end_bound(
        self, row: Row, instants: list[PointValue], position: dict[Pair, int], start: Bounds, end: Bounds
    ) -> bool:
        """A point constraint on one state at one end is a bound on a variable."""
        symbols = ca.symvar(row.expression)
        own = [s for s in symbols if s.element_hash() not in {q.symbol.element_hash() for q in self.flat.parameters}]
        if len(own) != 1:
            return False
        value = next((i for i in instants if i.symbol.element_hash() == own[0].element_hash()), None)
        if value is None or value.s not in (0.0, 1.0):
            return False
        chain = self.plan.alias.rewrite(self.flat, value.expression)
        inner = ca.substitute([row.expression], [own[0]], [chain])[0]
        bound = as_bound(inner, row, self.flat, self.parameters)
        if bound is None or bound[0] not in position:
            return False
        (start if value.s == 0.0 else end).tighten(position[bound[0]], bound[1], bound[2])
        return True

    def _initial(self, position: dict[Pair, int], start: Bounds) -> None:
        """Fixed start attributes are initial conditions."""
        for v in self.flat.variables:
            if not v.fixed:
                continue
            if v.start is None:
                raise ModelError(f"'{v.name}' is fixed at the start, but at no value; give it start=...", v.where)
            sign, kept, order = self.plan.alias.resolve(v.index, 0)
            if (kept, order) not in position:
                raise ModelError(
                    f"the fixed start of '{v.name}' cannot be held: it is no state; states are "
                    f"{', '.join(self.flat.symbol_name(*p) for p in self.states)}",
                    v.where,
                )
            start.tighten(position[(kept, order)], sign * v.start, sign * v.start)

    def _check_bounds(self, x: Bounds, u: Bounds, P: Bounds, start: Bounds, end: Bounds) -> None:
        states = [self.flat.symbol_name(*p) for p in self.states]
        controls = [self.flat.variables[i].name for i in self.controls]
        free = [q.name for q in self.flat.parameters if q.free]
        groups: list[tuple[str, list[str], tuple[Bounds, ...]]] = [
            ("", states, (x,)), ("", controls, (u,)), ("", free, (P,)),
            (" at the start", states, (x, start)), (" at the end", states, (x, end)),
        ]  # fmt: skip
        for place, names, bounds in groups:
            for n, name in enumerate(names):
                a, b = max(c.low[n] for c in bounds), min(c.high[n] for c in bounds)
                if a > b:
                    raise ModelError(
                        f"{self.flat.title}: the bounds of '{name}' cross{place}: at least {a:g} and at most {b:g}"
                    )

    def _dynamics(self) -> tuple[list[ca.SX | None], ca.SX, list[str], np.ndarray]:
        flat = self.flat
        rates: list[ca.SX | None] = []
        wanted = []
        for i, k in self.states:
            if (i, k + 1) in self.states:
                rates.append(flat.scope.symbol(i, k + 1))
            elif self.kind == "inverse":
                rates.append(None)
            else:
                rates.append(flat.scope.symbol(i, k + 1))
                wanted.append(len(rates) - 1)
        for n, e in zip(wanted, self.express([r for n in wanted if (r := rates[n]) is not None]), strict=True):
            rates[n] = e
        if self.kind == "explicit":
            return rates, ca.SX(0, 1), [], np.ones(0)
        computed = self.express([flat.scope.symbol(i, 0) for i in self.controls], with_controls=False)
        labels = [f"{flat.variables[i].name} by the motion" for i in self.controls]
        scale = np.array([flat.variables[i].nominal for i in self.controls])
        return rates, self.u - ca.vertcat(*computed), labels, scale

    def _cost(self, p: DynamicProblem, objective: Expr, points: list[Row], instants: list[PointValue]) -> None:
        """Split the objective into constant weights of integrals and a Mayer part; other integrals become states."""
        integrals = [i for i in self.flat.scope.instants if i.time is None]
        cost = self._numbers(objective.sx)
        used_in_points = {s.element_hash() for r in points for s in ca.symvar(r.expression)}
        integrands = self.express([i.expression for i in integrals]) if integrals else []
        along = [p.x, p.xd, p.u, p.P, p.t]
        for instant, integrand in zip(integrals, integrands, strict=True):
            self._require(integrand, along, "the argument of gt.integral() holds a value at an instant or an integral")
            weight = ca.gradient(cost, instant.symbol)
            if weight.is_constant() and instant.symbol.element_hash() not in used_in_points:
                p.integrals.append((instant.symbol, integrand, float(weight)))
                cost = ca.substitute([cost], [instant.symbol], [ca.SX(0)])[0]
                continue
            q = ca.SX.sym(f"integral_{p.x.numel()}")
            p.x, p.xd = ca.vertcat(p.x, q), ca.vertcat(p.xd, ca.SX.sym("rate_integral"))
            p.rates.append(integrand)
            for b, reach in ((p.x_bounds, np.inf), (p.start_bounds, 0.0), (p.end_bounds, np.inf)):
                b.low, b.high = np.append(b.low, -reach), np.append(b.high, reach)
            instants.append(PointValue(instant.symbol, q, 1.0))
        at_points = [p.P, *(i.symbol for i in instants)]
        self._require(cost, at_points, "objective() holds", "; take a value with .at(...) or gt.integral(...)")
        p.mayer = cost
        p.instants = instants
        for r in points:
            e = self._numbers(r.expression)
            self._require(e, at_points, f"{r.label} holds", ", beside a value at an instant or an integral")
            if not ca.symvar(e):
                raise ModelError(f"{r.label} holds no variable and nothing to choose: {r.low:g} <= {e} <= {r.high:g}")
            p.points.append(Row(e, r.low, r.high, r.label, r.where))

    def _numbers(self, e: ca.SX) -> ca.SX:
        """An expression with the numbers of all parameters that are not free."""
        return ca.substitute([e], [self.flat.p], [self.parameters])[0] if self.flat.parameters else e

    def _require(self, e: ca.SX, allowed: list[ca.SX], sentence: str, hint: str = "") -> None:
        """Raises ModelError for symbols in e that are none of these."""
        known = {s.element_hash() for a in allowed for s in ca.vertsplit(ca.vec(a))}
        strange = [s.name() for s in ca.symvar(e) if s.element_hash() not in known]
        if strange:
            named = f" {', '.join(strange)} along the whole path" if hint else ""
            raise ModelError(f"{self.flat.title}: {sentence}{named}{hint}")
