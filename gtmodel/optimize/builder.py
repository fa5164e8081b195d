"""Writing a model's expressions in what a transcription has at a point: states, rates, inputs, constants, time."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from ..compiler.emit import express
from ..compiler.flat import FlatModel
from ..compiler.plan import Plan, differentiated
from ..lang.expression import Expr
from ..lang.optimization import Delayed, Optimization
from ..lang.scope import Misfit
from ..lang.source import ModelError
from .attributes import Pair, names_of, nominal_of
from .dynamic import Bounds, DynamicProblem, Quadrature
from .horizon import Horizon, PointValue, horizon, point_values, shortest_length
from .relations import Row, as_bound
from .sizes import Slopes, of_constants, scale_of, within

# what a value that is fixed at the start may miss, in the size of the row: IPOPT's own measure of a solution
START_SLACK = 1e-6
STEPS = 3  # Newton's, from a polynomial's value: from a tenth off to round-off


@dataclass(eq=False)
class Explicit:
    """Rates and point variables in x, the given inputs, P, t and the `unknowns` at which `residuals` vanish."""

    rates: list[ca.SX]
    point: list[ca.SX]
    unknowns: list[ca.SX]
    residuals: list[ca.SX]


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
        fold: ca.SX,
        tunable: tuple[str, ...] = (),
        delayed: dict[int, tuple[int, Delayed]] | None = None,
        told: Mapping[str, float] | None = None,
    ) -> None:
        """told: sizes by the names of variables and free constants, in place of their nominals."""
        self.told = dict(told or {})
        self.base = base
        self.model, self.root, self.flat, self.plan, self.kind = model, root, flat, plan, kind
        self.states, self.controls, self.tunable = states, controls, tunable
        self.delayed = delayed or {}
        scope = flat.scope
        self.x = ca.vertcat(*[scope.symbol(*p) for p in states]) if states else ca.SX(0, 1)
        self.xd = ca.vertcat(*[ca.SX.sym(f"rate_{n}") for n in range(len(states))]) if states else ca.SX(0, 1)
        free = [q.symbol for q in flat.parameters if q.free]
        named = {q.name: q.symbol for q in flat.parameters}
        self.n_free = len(free)
        self.P = ca.vertcat(*free, *[named[n] for n in tunable]) if free or tunable else ca.SX(0, 1)
        self.parameters = fold
        # in these forms the rates of the top states are xd
        implicit = kind in ("inverse", "dae")
        top = [(i, k + 1, n) for n, (i, k) in enumerate(states) if implicit and (i, k + 1) not in states]
        self.rates = {(i, k): self.xd[n] for i, k, n in top}
        inputs = [*controls, *self.delayed]
        self.z_pairs = self._point_unknowns({(i, 0) for i in inputs})
        z = [scope.symbol(*p) for p in self.z_pairs]
        u = [ca.SX.sym(flat.variables[i].name) for i in inputs]
        self.given = ca.vertcat(*u) if u else ca.SX(0, 1)
        self.u = ca.vertcat(self.given, *z)
        # a control is a variable of its own in all forms
        self.control_symbols: dict[Pair, tuple[int, int]] = {}
        for n, i in enumerate(inputs):
            sign, kept, order = plan.alias.resolve(i, 0)
            self.control_symbols[(kept, order)] = (n, sign)

    def _point_unknowns(self, inputs: set[Pair]) -> list[Pair]:
        """Chain symbols that are free at each point."""
        if self.kind == "dae":
            return [p for p in self.plan.pairs if p not in self.states and p not in self.rates and p not in inputs]
        if self.kind == "torn":
            owners = [self.flat.scope.owner(s) for b in self.plan.newton for s in b.unknowns]
            return [p for p in owners if p is not None]
        return []

    def express(self, expressions: list[ca.SX], with_controls: bool = True) -> list[ca.SX]:
        """Expressions of original names in x, xd, u, P and t."""
        rewritten = self.plan.alias.rewrite_all(self.flat, list(expressions))
        given = dict(self.rates)
        if with_controls:
            given |= {pair: sign * self.u[n] for pair, (n, sign) in self.control_symbols.items()}
        pairs = [(self.flat.scope.symbol(*pair), e) for pair, e in given.items()]
        if self.kind != "dae":
            return express(self.plan, rewritten, pairs)
        old, new = [s for s, _ in pairs], [e for _, e in pairs]
        if self.flat.parameters:
            old, new = [*old, self.flat.p], [*new, self.parameters]
        if old and rewritten:
            rewritten = ca.substitute(rewritten, [ca.vertcat(*old)], [ca.vertcat(*new)])
        return ca.cse(rewritten) if rewritten else []

    def expressible(self, pair: Pair) -> bool:
        """Does the problem know this chain symbol of a kept variable?"""
        if pair in self.states or pair in self.rates or pair in self.z_pairs or pair in self.control_symbols:
            return True
        if self.kind == "dae":
            return False
        symbol = self.flat.scope.symbol(*pair).element_hash()
        return symbol in {s.element_hash() for b in self.plan.blocks for s, _ in b.assignments}

    def problem(
        self, objective: Expr, constraints: list[Row], quadratures: Sequence[Quadrature] = ()
    ) -> DynamicProblem:
        flat, states = self.flat, self.states
        position = {p: n for n, p in enumerate(states)}
        place = dict(self.control_symbols) | {p: (self.given.numel() + n, 1) for n, p in enumerate(self.z_pairs)}
        x_bounds, u_bounds = Bounds.free(len(states)), Bounds.free(self.u.numel())
        start, end = Bounds.free(len(states)), Bounds.free(len(states))
        path: list[Row] = []
        for v in flat.variables:
            if not (np.isfinite(v.min) or np.isfinite(v.max)):
                continue
            sign, kept, order = self.plan.alias.resolve(v.index, 0)
            low, high = (v.min, v.max) if sign > 0 else (-v.max, -v.min)
            if (kept, order) in position:
                x_bounds.tighten(position[(kept, order)], low, high)
            elif (kept, order) in place:
                n, s = place[(kept, order)]
                u_bounds.tighten(n, *((low, high) if s > 0 else (-high, -low)))
            else:
                symbol = flat.scope.symbol(v.index, 0)
                nominal = self._nominal((v.index, 0))
                path.append(Row(symbol, v.min, v.max, f"bounds of {v.name}", v.where, nominal))
        ends = horizon(flat, self.P, self.parameters)
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
            elif bound is not None and bound[0] in place:
                n, s = place[bound[0]]
                low, high = bound[1:]
                u_bounds.tighten(n, *((low, high) if s > 0 else (-high, -low)))
            else:
                path.append(row)
        self._initial(position, start, {q.index for q in quadratures})
        values = self.express([i.expression for i in instants] + [r.expression for r in path])
        for i, e, off in zip(
            instants, values, self.off_points([i.expression for i in instants], values[: len(instants)]), strict=False
        ):
            i.expression, i.off = e, off
        written = path
        path = [replace(r, expression=e) for r, e in zip(path, values[len(instants) :], strict=True)]
        tuned = {q.name: q.value for q in flat.parameters}
        held = [tuned[n] for n in self.tunable]
        free = [q for q in flat.parameters if q.free]
        P_bounds = Bounds(np.array([q.min for q in free] + held), np.array([q.max for q in free] + held))
        P_guess, names = np.array([q.value for q in free] + held), [q.name for q in free]
        shortest = shortest_length(flat, ends, constraints, P_guess, self.P[self.n_free :])
        if shortest and not self._bounded_end(ends, shortest, P_bounds):
            points.append(Row(ends.length, shortest, np.inf, "the horizon's shortest length", None))
        self._check_bounds(x_bounds, u_bounds, P_bounds, start, end)
        rates, algebraic, labels = self._dynamics()
        integrands = self.express([q.integrand for q in quadratures]) if quadratures else []
        summed = [Quadrature(q.index, e, q.start) for q, e in zip(quadratures, integrands, strict=True)]
        P_scale = of_constants(P_guess, P_bounds.low, P_bounds.high)
        P_scale = np.array([self.told.get(n, s) for n, s in zip([*names, *self.tunable], P_scale, strict=True)])
        inputs = [(i, 0) for i in (*self.controls, *self.delayed)] + self.z_pairs
        x_scale = within(self._nominals(states), x_bounds.low, x_bounds.high)
        u_scale = within(self._nominals(inputs), u_bounds.low, u_bounds.high)
        slopes = self._slopes(x_scale, u_scale, P_guess)
        for row, size in zip(path, slopes.typical([r.expression for r in path]), strict=True):
            nominal = float(within(np.array(row.scale), np.array(row.low), np.array(row.high)))
            row.scale = scale_of(nominal if nominal != 1.0 else float(size))
        at_start = self._at_start(written, path, x_bounds, u_bounds, start, ends.t0)
        instants += [value for value, _ in at_start]
        points += [row for _, row in at_start]
        scale = slopes.at_one(algebraic)
        if self.kind == "inverse":
            scale[: len(self.controls)] = u_scale[: len(self.controls)]
        problem = DynamicProblem(
            model=self.model, flat=flat, plan=self.plan, formulation=self.kind, state_pairs=states,
            control_indices=self.controls, x=self.x, xd=self.xd, u=self.u, P=self.P, t=flat.scope.time,
            t0=ends.t0, tf=ends.tf, rates=rates, algebraic=algebraic, algebraic_labels=labels, algebraic_scale=scale,
            path=path, x_bounds=x_bounds, u_bounds=u_bounds, P_bounds=P_bounds,
            P_guess=P_guess, delayed=list(self.delayed.values()), delayed_indices=list(self.delayed),
            z_pairs=self.z_pairs, tunable=self.tunable, x_scale=x_scale, u_scale=u_scale,
            P_scale=P_scale,
            start_bounds=start, end_bounds=end, integrals=[], instants=[], mayer=ca.SX(0), points=[],
            builder=self, base=self.base, shortest=shortest, quadratures=summed,
        )  # fmt: skip
        self._cost(problem, objective, points, instants, slopes)
        return problem

    def _bounded_end(self, ends: Horizon, shortest: float, P: Bounds) -> bool:
        """A shortest length as a bound of the end that is a free constant, where the other end is a number."""
        for end, other, sign in ((ends.tf, ends.t0, 1.0), (ends.t0, ends.tf, -1.0)):
            if end.is_symbolic() and other.is_constant():
                n = [s.element_hash() for s in ca.vertsplit(self.P)].index(end.element_hash())
                limit = float(other) + sign * shortest
                P.tighten(n, *((limit, np.inf) if sign > 0 else (-np.inf, limit)))
                return True
        return False

    def off_points(self, written: list[ca.SX], values: list[ca.SX]) -> list[ca.SX | None]:
        """What expressions of original names are between the collocation points, where slopes of states and algebraic
        variables follow from the equations; None for those that hold neither. `values` are they at the points."""
        loose = {s.element_hash() for s in ca.vertsplit(ca.vertcat(self.xd, self.u[self.given.numel() :]))}
        needed = [n for n, e in enumerate(values) if loose & {s.element_hash() for s in ca.symvar(e)}]
        result: list[ca.SX | None] = [None] * len(values)
        if not needed:
            return result
        other, form = self._other(), self.explicit()
        found = other.express([written[n] for n in needed])
        if self.given.numel():
            found = ca.substitute(found, [other.given], [self.given])
        if form.unknowns:
            # the unknowns' polynomials are near: Newton's steps square what they miss
            z, r = ca.vertcat(*form.unknowns), ca.vertcat(*form.residuals)
            step = z - ca.solve(ca.densify(ca.jacobian(r, z)), r)
            for _ in range(STEPS):
                found = ca.substitute(found, [z], [step])
            found = ca.substitute(found, [z], [ca.vertcat(*self.express(form.unknowns))])
        for n, e in zip(needed, found, strict=True):
            result[n] = e
        return result

    def explicit(self) -> Explicit:
        """Rates of the states and all point variables as functions of x, the given inputs, P and t."""
        base, other = self.base, self._other()
        scope = self.flat.scope
        unknowns = [s for b in base.newton for s in b.unknowns]
        residuals = [r for b in base.newton for r in b.residuals]
        wanted = [scope.symbol(i, k + 1) for i, k in self.states] + [scope.symbol(*p) for p in self.z_pairs]
        found = other.express([*wanted, *residuals])
        if found and self.given.numel():
            found = ca.substitute(found, [other.given], [self.given])
        n, m = len(self.states), len(wanted)
        return Explicit(found[:n], found[n:m], unknowns, found[m:])

    def _other(self) -> Builder:
        """The same problem in its explicit form."""
        base = self.base
        return Builder(
            self.model, self.root, self.flat, base, "torn" if base.newton else "explicit", self.states, self.controls,
            base, self.parameters, self.tunable, self.delayed, self.told,
        )  # fmt: skip

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

    def _initial(self, position: dict[Pair, int], start: Bounds, apart: Collection[int]) -> None:
        """Fixed start attributes are initial conditions, but for the variables `apart`."""
        for v in self.flat.variables:
            if not v.fixed or v.start is None or v.index in apart:
                continue
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
        inputs = [(i, 0) for i in (*self.controls, *self.delayed)] + self.z_pairs
        controls = [self.flat.symbol_name(*p) for p in inputs]
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

    def _dynamics(self) -> tuple[list[ca.SX | None], ca.SX, list[str]]:
        """Rates, algebraic rows that vanish, and what these rows say."""
        flat, plan = self.flat, self.plan
        rates: list[ca.SX | None] = []
        wanted = []
        for i, k in self.states:
            if (i, k + 1) in self.states:
                rates.append(flat.scope.symbol(i, k + 1))
            elif self.kind in ("inverse", "dae"):
                rates.append(None)
            else:
                rates.append(flat.scope.symbol(i, k + 1))
                wanted.append(len(rates) - 1)
        for n, e in zip(wanted, self.express([r for n in wanted if (r := rates[n]) is not None]), strict=True):
            rates[n] = e
        rows: list[ca.SX] = []
        labels: list[str] = []
        if self.kind == "inverse":
            computed = self.express([flat.scope.symbol(i, 0) for i in self.controls], with_controls=False)
            rows += [self.u[n] - e for n, e in enumerate(computed)]
            labels += [f"{flat.variables[i].name} by the motion" for i in self.controls]
        elif self.kind == "dae":
            written = differentiated(plan)
            rows += self.express([r for _, r in written])
            labels += [label for label, _ in written]
        elif self.kind == "torn":
            rows += self.express([r for b in plan.newton for r in b.residuals])
            for block in plan.blocks:
                if block.newton is not None:
                    # each equation left over after elimination comes of the whole block
                    said = "; ".join(dict.fromkeys(block.equations))
                    size = block.newton.size
                    labels += [f"block of {said}{f'[{k}]' if size > 1 else ''}" for k in range(size)]
        # what the controls alone must satisfy, as u'u = 1
        rows += self.express([e.residual for e in self.base.conditions])
        labels += [f"{e.label} ({e.where})" for e in self.base.conditions]
        return rates, ca.vertcat(*rows) if rows else ca.SX(0, 1), labels

    def _at_start(
        self, written: list[Row], path: list[Row], x: Bounds, u: Bounds, start: Bounds, t0: ca.SX
    ) -> list[tuple[PointValue, Row]]:
        """Rows at the start of the horizon, where no collocation point lies: what states, constants and time tell.

        Raises ModelError where a start that is fixed breaks one.
        """
        rows = list(path)
        if self.kind == "dae":
            # states tell the unknowns that are free at each point
            offset = self.given.numel()
            for n, pair in enumerate(self.z_pairs):
                low, high = float(u.low[offset + n]), float(u.high[offset + n])
                if np.isfinite(low) or np.isfinite(high):
                    name, size = self.flat.symbol_name(*pair), self._nominal(pair)
                    row = Row(self.flat.scope.symbol(*pair), low, high, f"bounds of {name}", None, size)
                    written, rows = [*written, row], [*rows, row]
            if rows:
                found = self._other().express([r.expression for r in written])
                rows = [replace(r, expression=e) for r, e in zip(rows, found, strict=True)]
        low, high = np.maximum(x.low, start.low), np.minimum(x.high, start.high)
        states = {s.element_hash(): n for n, s in enumerate(ca.vertsplit(self.x))}
        constants = {s.element_hash(): n for n, s in enumerate(ca.vertsplit(self.P))}
        time = self.flat.scope.time.element_hash()
        result = []
        for row in rows:
            keys = {s.element_hash() for s in ca.symvar(row.expression)}
            if not keys & set(states) or not keys <= {*states, *constants, time}:
                continue
            held = all(low[states[k]] == high[states[k]] for k in keys if k in states)
            bounds, label = (row.low, row.high), f"at the start: {row.label}"
            chosen = keys & set(constants) or (time in keys and not t0.is_constant())
            if held and not chosen:
                at = ca.substitute([row.expression], [ca.vertcat(self.x, self.flat.scope.time)],
                                   [ca.vertcat(ca.SX(np.where(np.isfinite(low), low, 0.0)), t0)])[0]  # fmt: skip
                value = float(at)
                miss = max(row.low - value, value - row.high)
                if miss > START_SLACK * row.scale:
                    raise ModelError(
                        f"{self.flat.title}: the values fixed at the start miss '{row.label}' by {miss:g}; change the "
                        "start or the constraint",
                        row.where,
                    )
                continue
            free = any(constants[k] < self.n_free for k in keys if k in constants) or any(
                s.element_hash() in constants and constants[s.element_hash()] < self.n_free for s in ca.symvar(t0)
            )
            if held and not free and row.low == row.high:
                # an equation without an unknown would leave too few of them
                bounds = (row.low - START_SLACK * row.scale, row.high + START_SLACK * row.scale)
            symbol = ca.SX.sym(f"start{len(result)}")
            point = Row(symbol, *bounds, label, row.where, row.scale)
            result.append((PointValue(symbol, row.expression, 0.0), point))
        return result

    def _nominal(self, pair: Pair) -> float:
        told = [self.told[n] for n, _ in names_of(self.flat, self.base.alias, pair) if n in self.told]
        return told[0] if told else nominal_of(self.flat, self.base.alias, pair)

    def _nominals(self, pairs: list[Pair]) -> np.ndarray:
        return np.array([self._nominal(p) for p in pairs])

    def _slopes(self, x_scale: np.ndarray, u_scale: np.ndarray, P: np.ndarray) -> Slopes:
        """Slopes of rows per size of the states, their rates and the inputs."""
        tops = [(i, k + 1) for i, k in self.states]
        inputs = [(i, 0) for i in (*self.controls, *self.delayed)] + self.z_pairs
        arguments = [self.x, self.xd, self.u, self.P, self.flat.scope.time]
        nominal = np.concatenate([x_scale, self._nominals(tops), u_scale])
        return Slopes(self.base, arguments, (self.states, tops, inputs), nominal, P)

    def _cost(
        self, p: DynamicProblem, objective: Expr, points: list[Row], instants: list[PointValue], slopes: Slopes
    ) -> None:
        """Split the objective into constant weights of integrals and a Mayer part; other integrals become states."""
        integrals = [i for i in self.flat.scope.instants if i.time is None]
        cost = self._numbers(objective.sx)
        used_in_points = {s.element_hash() for r in points for s in ca.symvar(r.expression)}
        integrands = self.express([i.expression for i in integrals]) if integrals else []
        along = [p.x, p.xd, p.u, p.P, p.t]
        length = abs(float(ca.Function("length", [p.P], [p.tf - p.t0])(p.P_guess)))
        told = {i.symbol.element_hash(): i.expression for i in instants}
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
            told[instant.symbol.element_hash()] = length * integrand
            p.x_scale = np.append(p.x_scale, scale_of(float(slopes.typical([length * integrand])[0])))
        at_points = [p.P, *(i.symbol for i in instants)]
        self._require(cost, at_points, "objective() holds", "; take a value with .at(...) or gt.integral(...)")
        p.mayer = cost
        p.misfits = [Misfit(self._numbers(m.residual), m.known) for m in self.flat.scope.misfits]
        p.instants = instants
        for r in points:
            e = self._numbers(r.expression)
            self._require(e, at_points, f"{r.label} holds", ", beside a value at an instant or an integral")
            if not ca.symvar(e):
                raise ModelError(f"{r.label} holds no variable and nothing to choose: {r.low:g} <= {e} <= {r.high:g}")
            p.points.append(replace(r, expression=e))
        values = [told[i.symbol.element_hash()] for i in instants]
        symbols = ca.vertcat(*[i.symbol for i in instants])
        sizes = slopes.of_points([r.expression for r in p.points], symbols, values, p.P, p.P_scale)
        for r, size in zip(p.points, sizes, strict=True):
            r.scale = scale_of(float(size)) if r.scale == 1.0 else r.scale

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
