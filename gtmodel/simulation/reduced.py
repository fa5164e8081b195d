"""The reduced system of a plan: its rates, outputs, margins and full points as numeric functions, and its integration
with CVODES, or with IDAS if there are Newton unknowns."""

from __future__ import annotations

from contextlib import redirect_stderr
from functools import cached_property
from io import StringIO
from threading import Lock
from typing import Any

import casadi as ca
import numpy as np

from ..compiler.blocks import Margin
from ..compiler.emission import express
from ..compiler.flat import FlatModel
from ..compiler.plan import CausalPlan
from ..compiler.rows import BoundFunction, densified, map_columns
from .inputs import SimulationInputs

# up to this many rows are evaluated in kept memory
FEW = 6


class OverRows:
    """A function over rows: takes an array (n, size) for each input, or (size,) for all rows, and returns an array
    (n, size) for each output."""

    def __init__(self, f: ca.Function) -> None:
        self.function = densified(f)
        self._mapped: dict[int, ca.Function] = {}
        self._few: dict[int, BoundFunction] = {}
        self._lock = Lock()

    def __call__(self, *arguments: np.ndarray) -> list[np.ndarray]:
        rows = next((len(a) for a in arguments if a.ndim == 2), 1)
        if 0 < rows <= FEW:
            with self._lock:
                few = self._few.get(rows) or self._few.setdefault(rows, BoundFunction(self.function, rows))
                for place, values in zip(few.arguments, arguments, strict=True):
                    place[...] = values
                few.run()
                return [r.copy() for r in few.results]
        columns = [a.T if a.ndim == 2 else np.broadcast_to(a[:, None], (a.size, rows)) for a in arguments]
        return [r.T for r in map_columns(self.function, columns, self._mapped)]


# an equation with a larger residual, relative to its largest term, is not solved; round-off of stiff forces is smaller
BROKEN = 1e-6
# residuals below this, in SI units, are accepted
SMALL = 1e-9


class OriginalEquations:
    """The equations before any elimination, over `plan.pairs`; `fold` has numbers for the parameters, and symbols at
    `places` for those that vary."""

    def __init__(self, plan: CausalPlan, fold: ca.SX, places: list[int]) -> None:
        flat = self.flat = plan.flat
        pairs = self.pairs = sorted({pair for e in flat.equations for pair in flat.scope.symbols_in(e.residual)})
        place = {pair: n for n, pair in enumerate(plan.pairs)}
        self._sign, self._place = np.zeros(len(pairs)), np.zeros(len(pairs), dtype=int)
        for n, pair in enumerate(pairs):
            sign, index, order = plan.alias.resolve(*pair)
            self._sign[n], self._place[n] = sign, place[(index, order)]
        symbols = ca.vertcat(*[flat.scope.symbol(*pair) for pair in pairs])
        residuals = ca.densify(ca.vertcat(*[e.residual for e in flat.equations]))
        self.arguments = [symbols, flat.p, flat.scope.time]
        written = ca.Function("equations", self.arguments, [residuals])
        self._places = places
        values, time, varied = ca.SX.sym("values", len(pairs)), ca.SX.sym("time"), ca.SX(fold[places])
        self._residuals = OverRows(ca.Function("equations", [values, time, varied], [written(values, fold, time)]))

    def __call__(self, points: np.ndarray, times: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the values of `pairs` and the residuals, one row for each point; p: values of the parameters."""
        values = self._sign * points[:, self._place]
        return values, self._residuals(values, times[:, None], p[self._places])[0]


class Audit:
    """Checks the equations before any elimination at points over the plan's pairs.

    `residual` is the largest |left - right| of any equation so far, in SI units.
    """

    def __init__(self, equations: OriginalEquations, p: np.ndarray) -> None:
        self._equations, self._p = equations, p
        self.residual = 0.0
        self._worst: tuple[np.ndarray, float, int] | None = None

    def __call__(self, points: np.ndarray, times: np.ndarray) -> None:
        """Check points, one per row."""
        if not len(times) or not self._equations.flat.equations:
            return
        values, residuals = self._equations(points, times, self._p)
        residuals = np.abs(residuals)
        point, equation = np.unravel_index(int(np.argmax(residuals)), residuals.shape)
        if residuals[point, equation] > self.residual:
            self.residual = float(residuals[point, equation])
            self._worst = values[point], float(times[point]), int(equation)

    def verdict(self) -> str | None:
        """Return a sentence if the worst equation is violated, relative to its largest term; else None."""
        if self._worst is None or self.residual <= SMALL:
            return None
        values, time, row = self._worst
        flat, arguments = self._equations.flat, self._equations.arguments
        e = flat.equations[row]
        gradient = ca.Function("gradient", arguments, [ca.densify(ca.jacobian(e.residual, arguments[0]))])
        nominal = np.array([flat.variables[i].nominal for i, _ in self._equations.pairs])
        terms = np.abs(gradient(values, self._p, time).full().reshape(-1)) * np.maximum(np.abs(values), nominal)
        if self.residual <= BROKEN * np.max(terms, initial=0.0):
            return None
        return (
            f"{e.label} ({e.where}) does not hold at {time:.6g} s: its residual is {self.residual:.3g}; use a smaller "
            "tolerance or step"
        )


Pair = tuple[int, int]


class Reduced:
    """x' = f(x, z, t, p), 0 = r(x, z, t, p), with states x, Newton unknowns z, and `p` of SimulationInputs.

    `outputs` are expressions of original symbols, like the energies.
    """

    def __init__(self, plan: CausalPlan, inputs: SimulationInputs, outputs: list[ca.SX]) -> None:
        flat, scope = plan.flat, plan.flat.scope
        self.plan = plan
        self.x = _column([scope.symbol(*s) for s in plan.states])
        self.z = _column([u for b in plan.newton for u in b.unknowns])
        self.t, self.p = inputs.t, inputs.p
        self._arguments = [self.x, self.z, self.t, self.p]
        states = set(plan.states)
        known = [(scope.symbol(*pair), inputs.expression(*pair)) for pair in plan.inputs if pair not in states]
        stored, supplied, dissipated = (energy(flat, kind) for kind in ("stored", "supplied", "dissipated"))
        groups = {
            "rates": [scope.symbol(i, k + 1) for i, k in plan.states],
            "powers": plan.alias.rewrite_all(flat, [supplied, dissipated]),
            "residuals": [r for b in plan.newton for r in b.residuals],
            "margins": [m.expression for b in plan.blocks for m in b.margins],
            "point": [scope.symbol(*pair) for pair in plan.pairs],
            "outputs": plan.alias.rewrite_all(flat, [*outputs, stored]),
        }
        expressions = express(plan, [e for group in groups.values() for e in group], [*known, (scope.time, self.t)])
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
        """(x, z, t, p) -> margins, which must not be negative or vanish, in the order of the plan's blocks."""
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
        """The margins of the plan's blocks with their expressions in (x, z, t, p)."""
        margins = [m for b in self.plan.blocks for m in b.margins]
        return list(zip(margins, ca.vertsplit(self._margins) if margins else [], strict=True))

    @property
    def unknowns(self) -> str:
        """Names of the Newton unknowns, for messages."""
        labels = [label for b in self.plan.newton for label in b.labels]
        return ", ".join(labels[:4]) + (f" and {len(labels) - 4} more" if len(labels) > 4 else "")

    def from_point(self, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the states and Newton unknowns of a point over plan.pairs."""
        place = {pair: n for n, pair in enumerate(self.plan.pairs)}
        scope = self.plan.flat.scope
        unknowns = [scope.owner(u) for b in self.plan.newton for u in b.unknowns]
        return (
            np.array([w[place[s]] for s in self.plan.states]),
            np.array([w[place[pair]] for pair in unknowns if pair is not None]),
        )


def energy(flat: FlatModel, kind: str) -> ca.SX:
    """Return the sum of the declared energies "stored" [J], "supplied" or "dissipated" [W], in original symbols."""
    total = ca.SX(0)
    for e in flat.energies:
        if e.kind == kind:
            total = total + e.expression
    return total


def _column(expressions: list[ca.SX]) -> ca.SX:
    return ca.SX(ca.vertcat(*expressions)) if expressions else ca.SX(0, 1)


# a minimum of a discriminant, relative to its typical size, that is zero within the accuracy of the motion, also in
# tolerances: over a long run, the integrator's error adds up to some thousand tolerances
TOUCH, TOUCH_TOLERANCES = 1e-7, 1e3
# in units of TOUCH: near enough to zero for the parabola through two points to give the minimum
CLOSE = 100.0
# a minimum between two points is distinct from zero if it is at least this share of the smaller end value
KEPT = 0.25
# largest deviation of the change between two points from that given by their rates, relative to the larger value
EXPLAINED = 0.3
# relative round-off of a computed number
ROUND_OFF = 8 * np.finfo(float).eps


class Watched:
    """Expressions of a reduced system with their rates along the motion."""

    def __init__(self, reduced: Reduced, watched: ca.SX) -> None:
        d = watched
        x, z, t, f = reduced.x, reduced.z, reduced.t, reduced.rates
        self.count = d.numel()
        rate = ca.densify(ca.jacobian(d, t) + ca.mtimes(ca.jacobian(d, x), f))
        arguments = [x, z, t, reduced.p]
        self._values = OverRows(ca.Function("watched", arguments, [d, rate]))
        # rates of the Newton unknowns: rz z' = -(rx x' + rt)
        r = reduced.residuals
        moved = ca.densify(ca.jacobian(r, t) + ca.mtimes(ca.jacobian(r, x), f))
        by_z, rz = ca.densify(ca.jacobian(d, z)), ca.densify(ca.jacobian(r, z))
        self.moved_by_inputs = bool(ca.jacobian(d, reduced.p).nnz())
        self._arguments, self._watched = arguments, d
        uses_z = bool(ca.jacobian(d, z).nnz())
        self._through_z = ca.Function("through", arguments, [by_z, rz, moved]) if uses_z else None

    def __call__(
        self, xs: np.ndarray, zs: np.ndarray, times: np.ndarray, p: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the values and their rates [1/s], one row for each time."""
        values, rates = self._values(xs, zs, times[:, None], p)
        if self._through_z is not None:
            rates = rates.copy()
            for n, (x, z, t) in enumerate(zip(xs, zs, times, strict=True)):
                by_z, rz, moved = (np.asarray(v.full()) for v in self._through_z(x, z, t, p))
                try:
                    rates[n] -= by_z @ np.linalg.solve(rz, moved.reshape(-1))
                except np.linalg.LinAlgError:
                    rates[n] = np.nan
        return values, rates

    @cached_property
    def _by_unknowns(self) -> ca.Function:
        x, z = self._arguments[:2]
        derivatives = ca.horzcat(ca.jacobian(self._watched, x), ca.jacobian(self._watched, z))
        return ca.Function("by_unknowns", self._arguments, [ca.fabs(ca.densify(derivatives))])

    def round_off(
        self, x: np.ndarray, z: np.ndarray, time: float, p: np.ndarray, x_scale: np.ndarray, z_scale: np.ndarray
    ) -> np.ndarray:
        """Return the effect on the values at one point of round-off in states and Newton unknowns, whose size is at
        least their nominal; 0 for values whose slope is not finite there."""
        sizes = np.maximum(np.abs(np.append(x, z)), np.append(x_scale, z_scale))
        moved = np.asarray(self._by_unknowns(x, z, time, p).full()) @ (ROUND_OFF * sizes)
        return np.where(np.isfinite(moved), moved, 0.0)

    def values(self, x: np.ndarray, z: np.ndarray, time: float, p: np.ndarray) -> np.ndarray:
        """Return the values at one point for several columns p, one row for each column."""
        return self._values(x, z, np.array([time]), p.T)[0]


class Roots(Watched):
    """All discriminants relative to their typical sizes, with their rates."""

    def __init__(self, reduced: Reduced, tolerance: float) -> None:
        margins = [(m, e) for m, e in reduced.margin_expressions if m.kind == "discriminant"]
        self.labels = [m.label for m, _ in margins]
        self._touch = max(TOUCH, TOUCH_TOLERANCES * tolerance)
        super().__init__(reduced, ca.vertcat(*[e / m.scale for m, e in margins]) if margins else ca.SX(0, 1))

    def __bool__(self) -> bool:
        return self.count > 0

    def judge(self, times: np.ndarray, values: np.ndarray, rates: np.ndarray) -> tuple[np.ndarray, list[str], float]:
        """Return for each interval between rows whether it is resolved; and the labels of the discriminants that touch
        zero in the first unresolved interval, with the time: there the motion ends."""
        h = np.diff(times)[:, None]
        a, b, da, db = values[:-1], values[1:], rates[:-1] * h, rates[1:] * h
        smaller, larger = np.minimum(a, b), np.maximum(a, b)
        explained = np.abs(b - a - (da + db) / 2) <= EXPLAINED * larger
        turns = (da < 0) & (db > 0)
        with np.errstate(divide="ignore", invalid="ignore"):
            s = np.where(turns, -da / (db - da), 0.0)  # minimum of the parabola with these rates
        # value there of the cubic through both ends with their rates
        lowest = (1 + 2 * s) * (1 - s) ** 2 * a + s * (1 - s) ** 2 * da + s**2 * (3 - 2 * s) * b + s**2 * (s - 1) * db
        touching = turns & (lowest <= self._touch) & (smaller <= CLOSE * self._touch)
        resolved = explained & ~touching & (~turns | (lowest >= KEPT * smaller))
        good = np.all(resolved, axis=1)
        first = int(np.argmin(good)) if not good.all() else 0
        touch = np.flatnonzero(touching[first]) if not good.all() else []
        when = float(times[first] + h[first, 0] * min((s[first, j] for j in touch), default=0.0))
        return good, [self.labels[j] for j in touch], when


# largest number of equal intervals in one call, over which the multistep method keeps its order and step size; fewer
# with Newton unknowns, which are then followed row by row: that work is lost if they went to another solution
MOST_ROWS, MOST_FOLLOWED = 500, 50
# fewer intervals for an expensive system, so that a run can be stopped: limit of instructions for all rows of a call
MOST_WORK = 1_000_000
# cached integrators, each for one number of intervals
MOST_INTEGRATORS = 32
# internal steps in one interval; if they are not enough, the interval is halved
MOST_STEPS = 1000
# a call over fewer intervals than this mostly builds up its order, in many short steps whose errors add up; it gets
# this share of the tolerance, but at least FINEST
FEW_INTERVALS, RESTARTED, FINEST = 50, 0.01, 1e-13
# the longest internal step, in intervals, is a power of this
STEP_RATIO = 4.0


class Stepper:
    """Integrates a reduced system over one or several equal intervals; returns None if the integrator fails.

    States and unknowns are scaled by their nominals, so that one tolerance applies to all. The supplied and dissipated
    energies are integrated with the states, with the same error control. `bounded`: internal steps are at most one
    interval long.
    """

    def __init__(self, reduced: Reduced, tolerance: float, method: str, bounded: bool = False) -> None:
        self._reduced = r = reduced
        plan, flat = r.plan, r.plan.flat
        self.x_scale = np.array([flat.variables[i].nominal for i, _ in plan.states])
        self.z_scale = np.concatenate([b.scale for b in plan.newton]) if plan.newton else np.zeros(0)
        s, t0, length = ca.SX.sym("s"), ca.SX.sym("t0"), ca.SX.sym("length")
        x, z = ca.SX.sym("x", r.x.numel()), ca.SX.sym("z", r.z.numel())
        old = [r.x, r.z, r.t]
        new = [ca.DM(self.x_scale) * x, ca.DM(self.z_scale) * z, t0 + s * length]
        rates, powers, residuals = ca.substitute([r.rates, r.powers, r.residuals], old, new)
        self._dae = {
            "x": ca.vertcat(x, ca.SX.sym("work", 2)),
            "t": s,
            "p": ca.vertcat(t0, length, r.p),
            "ode": length * ca.vertcat(rates / self.x_scale, powers),
        }
        self._options: dict[str, Any] = {
            "abstol": tolerance,
            "reltol": tolerance,
            "max_num_steps": MOST_STEPS,
            "disable_internal_warnings": True,
            "show_eval_warnings": False,  # a step that leaves the model's range is repeated with a shorter one
        }
        self._tolerance = tolerance
        self._most = 1.0 if bounded else np.inf  # longest internal step in intervals
        if z.numel():
            self._dae |= {"z": z, "alg": residuals}
            self._options["calc_ic"] = True
        else:
            self._options["linear_multistep_method"] = method
        self._integrators: dict[tuple[int, float, bool], ca.Function] = {}

    @cached_property
    def most(self) -> int:
        """Largest number of intervals in one call."""
        return (
            MOST_FOLLOWED
            if "z" in self._dae
            else max(MOST_FOLLOWED, min(MOST_ROWS, MOST_WORK // max(1, self._reduced.rate.n_instructions())))
        )

    def _longest(self, intervals: float, count: int) -> float:
        """Return the longest internal step in intervals, rounded down so that few different integrators are needed."""
        longest = min(self._most, intervals)
        return STEP_RATIO ** float(np.floor(np.log(longest) / np.log(STEP_RATIO))) if longest < count else np.inf

    def _integrator(self, count: int, longest: float, few: bool) -> ca.Function:
        key = count, longest, few
        if key not in self._integrators:
            if len(self._integrators) >= MOST_INTEGRATORS:
                self._integrators.pop(next(iter(self._integrators)))
            grid = list(map(float, range(1, count + 1)))
            plugin = "idas" if "z" in self._dae else "cvodes"
            options = self._options | ({"max_step_size": longest} if longest < count else {})
            if few:
                options["abstol"] = options["reltol"] = min(self._tolerance, max(FINEST, RESTARTED * self._tolerance))
            self._integrators[key] = ca.integrator(f"step{count}", plugin, self._dae, 0.0, grid, options)
        return self._integrators[key]

    def __call__(
        self,
        x: np.ndarray,
        z: np.ndarray,
        time: float,
        length: float,
        p: np.ndarray,
        count: int = 1,
        longest: float = np.inf,
        likely: int = FEW_INTERVALS,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        """Return states (count, n), Newton unknowns (count, m), and energies supplied and dissipated since the start of
        the call (count, 2), after each of `count` intervals of `length` seconds. `longest`: longest internal step [s].
        `likely`: number of intervals that will probably be used."""
        integrator = self._integrator(count, self._longest(longest / length, count), min(count, likely) < FEW_INTERVALS)
        start = np.concatenate([x / self.x_scale, [0.0, 0.0]])
        try:
            # SUNDIALS also prints its errors, which it returns as status
            with redirect_stderr(StringIO()):
                result = integrator(x0=start, z0=z / self.z_scale, p=np.concatenate([[time, length], p]))
        except RuntimeError:
            return None
        end = np.asarray(result["xf"].full()).T
        unknowns = np.asarray(result["zf"].full()).T if z.size else np.zeros((count, 0))
        if not (np.all(np.isfinite(end)) and np.all(np.isfinite(unknowns))):
            return None
        return end[:, : x.size] * self.x_scale, unknowns * self.z_scale, end[:, x.size :]
