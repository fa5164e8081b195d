"""Branches: the sign of each square root, from declared branches, else from the start values."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from ..lang.source import ModelError
from .blocks import Margin, Root, SolvedBlock, median
from .consistency.points import RESIDUAL_TOLERANCE, Sampler
from .flat import FlatModel
from .matrices import substituted_in_order

if TYPE_CHECKING:
    from .plan import CausalPlan

# tolerance of a branch expression that only changes its sign with the root: it is preferred for this root
OWN = 1e-9
# a home pose on another branch is searched from this many starts, at these distances in nominals
STILL_CLOSED = 1e-6  # m or rad by which a dropped constraint may be off
MIRROR_TRIES = 24
MIRRORED = 5
MIRROR_SPREADS = (0.002, 0.02, 0.05)
# of the poses found, keep those at most this much farther from the home pose than the nearest, in nominals: variables
# that need not change with a branch stay unchanged
AS_NEAR = 0.1
# poses far from the start values, at distances up to this in nominals: every branch of an arm has some
FAR_POINTS = 24
FAR = 2.0
CROSSINGS = 4
CROSSING_STEPS = 20
CROSSED = 1e-3  # a step this short, in nominals, ends a crossing; the full equations are solved afterwards
# a combination of branches that moves by less than this fraction of the largest is damped: six rods on three carts
# cannot all be mirrored, and without damping the plate would turn over
DAMPED = 0.1
STILL = 1e-3  # weight of a known variable, or of one that need not move


def check_branches(flat: FlatModel, blocks: Sequence[SolvedBlock], requested: Mapping[str, int]) -> None:
    """Raise ModelError for a branch that neither the model nor a block has, or a sign other than +1 or -1."""
    names = {b.name for b in flat.branches} | {r.name for b in blocks for r in b.roots if r.name}
    for name, sign in requested.items():
        if name not in names:
            raise ModelError(f"{flat.title} has no branch '{name}'; it has {', '.join(sorted(names)) or 'none'}")
        if sign not in (-1, 1):
            raise ModelError(f"branch '{name}' takes +1 or -1; found {sign}")


def settle(plan: CausalPlan, sampler: Sampler, requested: Mapping[str, int]) -> CausalPlan:
    """Return the plan with a sign for every root, and with samples on the selected branches.

    A branch selects the solution of a root if its expression changes sign with the root, in the same sense at every
    sample; the root then gets the requested sign, +1 by default. Other roots take the side of the start values. If
    Newton's method continues a home pose, that pose has the requested signs of the remaining branches.
    """
    plan = _with_settled_roots(plan, sampler, requested)
    if plan.newton:
        settling = {r.settled_by for b in plan.blocks for r in b.roots}
        plan = _with_moved_home(plan, sampler, {name: sign for name, sign in requested.items() if name not in settling})
    return plan


def _with_roots(plan: CausalPlan, roots: list[Root]) -> CausalPlan:
    """Return the plan with these roots, in the order of its blocks."""
    remaining = iter(roots)
    return replace(plan, blocks=[replace(b, roots=[next(remaining) for _ in b.roots]) for b in plan.blocks])


def _with_settled_roots(plan: CausalPlan, sampler: Sampler, requested: Mapping[str, int]) -> CausalPlan:
    roots = RootSigns(plan, sampler)
    if not roots.count:
        return plan
    settled = roots.settled(sampler, plan.samples, requested)
    return replace(_with_roots(plan, settled), samples=roots.samples(sampler, plan.samples, settled))


class RootSigns:
    """Selection of the signs of a plan's roots, for the parameter values of a sampler's model."""

    def __init__(self, plan: CausalPlan, sampler: Sampler) -> None:
        self._roots = [r for b in plan.blocks for r in b.roots]
        if self._roots:
            self._names, self._sides, self._values = _functions(plan, sampler, self._roots)
            self._jacobian = root_derivatives(plan, sampler)

    @property
    def count(self) -> int:
        return len(self._roots)

    def settled(self, sampler: Sampler, samples: np.ndarray, requested: Mapping[str, int]) -> list[Root]:
        """Return the roots with the signs of the requested branches, else of the samples. Raises ModelError."""
        p, names = sampler.flat.p0, self._names
        at_start = np.array([_row(self._jacobian(w, p, sampler.time)) for w in samples])
        signs = np.ones(len(self._roots))
        settled: list[Root] = []
        for n, root in enumerate(self._roots):
            if root.name:
                by = root.name if root.name in requested else ""
                settled.append(replace(root, settled_by=by, value=requested.get(root.name, root.value)))
                signs[n] = settled[n].value
                continue
            values = {}
            for side in (1, -1):
                signs[n] = side
                values[side] = np.array([_row(self._sides(w, p, sampler.time, signs)) for w in samples])
            match = _distinguishing(names, values[1], values[-1], requested)
            if match is not None:
                name = names[match[0]]
                settled.append(replace(root, settled_by=name, value=match[1] * requested.get(name, 1)))
            else:
                positive = int(np.sum(at_start[:, n] > 0))
                if positive not in (0, len(at_start)):
                    raise ModelError(
                        f"{sampler.flat.title}: {root.label} has two solutions and nothing distinguishes them; declare "
                        "gt.branch(name, expression), or set start values near one of them"
                    )
                settled.append(replace(root, settled_by="", value=1 if positive else -1))
            signs[n] = settled[n].value
        return settled

    def samples(self, sampler: Sampler, samples: np.ndarray, settled: list[Root], far: bool = True) -> np.ndarray:
        """Return samples at which the roots have these signs. Raises ModelError if no sample has them.

        far: if roots are branches themselves, and no sample has them, look for poses far from the start values too.
        """
        p, signs = sampler.flat.p0, np.array([r.value for r in settled], float)
        points = []
        for sample in samples:
            w = sample.copy()
            computed, numbers = self._values
            w[computed] = _row(numbers(w, p, sampler.time, signs))
            if not np.all(np.isfinite(w)) or sampler.correct(w) > RESIDUAL_TOLERANCE:
                continue
            if np.all(_row(self._jacobian(w, p, sampler.time)) * signs > 0):
                points.append(w)
        if not points and far and any(r.name for r in settled):
            return self.samples(sampler, _far_points(sampler, samples[0]), settled, far=False)
        if not points:
            raise ModelError(
                f"{sampler.flat.title}: no pose on the selected branches was found; set start values near such a pose"
            )
        return np.array(points)


def _far_points(sampler: Sampler, start: np.ndarray) -> np.ndarray:
    """Return consistent points at growing distances from the start values."""
    points = []
    for seed in range(FAR_POINTS):
        w = sampler.near(np.random.default_rng(seed), FAR * (seed + 1) / FAR_POINTS)
        if sampler.correct(w) <= RESIDUAL_TOLERANCE:
            points.append(w)
    return np.array(points) if points else start[None]


def _with_moved_home(plan: CausalPlan, sampler: Sampler, requested: Mapping[str, int]) -> CausalPlan:
    """Return the plan with samples at which the branches have the requested signs, mirroring them if necessary."""
    flat, p = plan.flat, plan.flat.p0
    expressions = {b.name: plan.alias.rewrite(flat, b.expression) for b in flat.branches}
    inside = {name: flat.scope.symbols_in(e) for name, e in expressions.items()}
    names = [n for n in expressions if n in requested and all(s in sampler.position for s in inside[n])]
    if not names:
        return plan
    # roots keep their signs
    column = _column([*(expressions[n] for n in names), *(r.slope * r.value for b in plan.blocks for r in b.roots)])
    signs = np.array([requested[n] for n in names] + [1] * (column.numel() - len(names)))
    arguments = [sampler.w, flat.p, flat.scope.time]
    sides = ca.Function("sides", arguments, [column])

    def right(w: np.ndarray) -> bool:
        return bool(np.all(_row(sides(w, p, sampler.time)) * signs > 0))

    samples = [w for w in plan.samples if right(w)]
    if not samples:
        # first without the equations that are nonlinear in the symbols of the branches, such as a rod's length: they
        # would pull the point back
        within = ca.vertcat(*[flat.scope.symbol(*p) for p in sorted(set().union(*inside.values()))])
        nonlinear = ca.which_depends(sampler.stages[0], within, 2, True)
        straight = [row for row, b in zip(ca.vertsplit(sampler.stages[0]), nonlinear, strict=True) if not b]
        rows = [_column(straight), column]
        linear = ca.Function("linear", arguments, [*rows, *(ca.densify(ca.jacobian(r, sampler.w)) for r in rows)])
        nominal = np.array([flat.variables[index].nominal for index, _ in sampler.pairs])
        still = np.array([STILL if index in sampler.known else 1.0 for index, _ in sampler.pairs])
        for seed in range(MIRROR_TRIES):
            noise = np.random.default_rng(seed).standard_normal(len(nominal))
            start = plan.samples[0] + MIRROR_SPREADS[seed % len(MIRROR_SPREADS)] * nominal * noise
            w = _cross(lambda w: linear.call([w, p, sampler.time]), start, signs, nominal, still)
            if sampler.correct(w) <= RESIDUAL_TOLERANCE and right(w):
                samples.append(w)
            if len(samples) == MIRRORED:
                break
        started = np.array([pair in sampler.starts for pair in sampler.pairs], dtype=bool)
        distances = [float(np.sum(np.abs(w - plan.samples[0])[started] / nominal[started])) for w in samples]
        samples = [
            w
            for d, w in sorted(zip(distances, samples, strict=True), key=lambda p: p[0])
            if d <= min(distances) + AS_NEAR
        ]
    if not samples:
        selection = ", ".join(f"'{n}' = {requested[n]:+d}" for n in names)
        raise ModelError(
            f"{flat.title}: found no pose with branch {selection} from the start values; set start values near one"
        )
    return replace(plan, samples=np.array(samples))


def _cross(
    linear: Callable[[np.ndarray], list[ca.DM]],
    start: np.ndarray,
    signs: np.ndarray,
    nominal: np.ndarray,
    ease: np.ndarray,
) -> np.ndarray:
    """Return a point on the other side that differs from the start in as few variables as possible.

    linear: point -> residuals of equations, values of the branches, and the derivatives of both. The point satisfies
    the equations, and the branches come as near to their opposites as DAMPED allows. Variables that moved little get a
    smaller weight in the next iteration: a cart changes sides rather than the plate its orientation.
    """
    now = np.abs(_row(linear(start)[1]))
    part = np.where(now > 0, now, 1.0)
    w = start
    for _ in range(CROSSINGS):
        w, reach = start, nominal * ease
        for _ in range(CROSSING_STEPS):
            r, side, by_w, side_by_w = (x.full() for x in linear(w))
            equations, slopes = by_w * reach, side_by_w * reach / part[:, None]
            if not (np.all(np.isfinite(equations)) and np.all(np.isfinite(slopes))):
                return w
            # from the start: a step onto the equations, then a step along them
            distance, inverse = (w - start) / reach, np.linalg.pinv(equations, rcond=1e-10)
            onto = inverse @ (equations @ distance - r[:, 0])
            along = slopes - slopes @ inverse @ equations
            damping = (DAMPED * np.linalg.norm(along, 2)) ** 2 * np.eye(len(side))
            change = (signs * now - side[:, 0]) / part + slopes @ (distance - onto)
            nearest = start + reach * (onto + along.T @ np.linalg.pinv(along @ along.T + damping) @ change)
            step = np.max(np.abs(nearest - w) / nominal)
            w = nearest
            if step <= CROSSED:
                break
        travel = np.abs(w - start) / nominal * ease
        ease = np.maximum(travel / max(float(np.max(travel)), 1e-300), STILL)
    return w


def sides(plan: CausalPlan, sampler: Sampler) -> list[Margin]:
    """Return margins that are positive if Newton's solution lies on the branches of the home pose.

    Only for branches that no root settles, and that depend on the unknowns of a Newton block and on symbols that the
    plan computes. If the samples lie on both sides of a branch, it gets no margin.
    """
    flat = plan.flat
    if not plan.newton or not flat.branches:
        return []
    settling = {r.settled_by for b in plan.blocks for r in b.roots}
    rewritten = {b.name: plan.alias.rewrite(flat, b.expression) for b in flat.branches if b.name not in settling}
    assigned = [a for b in plan.blocks for a in b.assignments]
    computed = list(rewritten.values())
    if assigned:
        given = [s for s, _ in assigned], [e for _, e in assigned]
        computed = substituted_in_order(*given, computed, bool(flat.scope.calls))
    unknown = {s.element_hash() for b in plan.newton for s in b.unknowns}
    available = unknown | {flat.scope.symbol(*pair).element_hash() for pair in plan.inputs}
    margins = []
    for (name, expression), solved in zip(rewritten.items(), computed, strict=True):
        inside = {flat.scope.symbol(*pair).element_hash() for pair in flat.scope.symbols_in(solved)}
        known = all(pair in sampler.position for pair in flat.scope.symbols_in(expression))
        if inside & unknown and inside <= available and known:
            f = ca.Function("side", [sampler.w, flat.p, flat.scope.time], [expression])
            values = np.array([float(f(w, flat.p0, sampler.time)) for w in plan.samples])
            sign = 1 if values[0] > 0 else -1
            if np.all(sign * values > 0):
                margin = sign * expression
                margins.append(Margin("branch", margin, f"{name} = {sign:+d}", float(median(sign * values))))
    return margins


def open_loops(plan: CausalPlan) -> list[Margin]:
    """Return margins that are positive if the constraints that were dropped as redundant hold, to 1e-6 m or rad.

    Only for constraints that do not hold identically, among symbols that the plan computes.
    """
    flat, dropped = plan.flat, plan.flat.loops.dropped
    if not dropped:
        return []
    residuals = ca.substitute(
        plan.alias.rewrite_all(flat, [e.residual for e in dropped]), [flat.p], [ca.SX(plan.parameters)]
    )
    assigned = [a for b in plan.blocks for a in b.assignments]
    computed = residuals
    if assigned:
        _, computed = ca.substitute_inplace([s for s, _ in assigned], [e for _, e in assigned], list(residuals))
    available = {s.element_hash() for b in plan.newton for s in b.unknowns}
    available |= {flat.scope.symbol(*pair).element_hash() for pair in plan.inputs}
    margins = []
    for e, residual, solved in zip(dropped, residuals, computed, strict=True):
        inside = {flat.scope.symbol(*pair).element_hash() for pair in flat.scope.symbols_in(solved)}
        if inside and inside <= available:
            label = f"the redundant constraint '{e.label}', which was dropped"
            margins.append(Margin("condition", STILL_CLOSED**2 - residual**2, label))
    return margins


def follow(plan: CausalPlan, sampler: Sampler) -> CausalPlan:
    """Return the plan with the sign that each root has at the plan's only sample and its time."""
    roots = [r for b in plan.blocks for r in b.roots]
    if not roots:
        return plan
    derivatives = _row(root_derivatives(plan, sampler)(plan.samples[0], plan.flat.p0, sampler.time)).tolist()
    return _with_roots(plan, [replace(r, value=1 if x >= 0 else -1) for r, x in zip(roots, derivatives, strict=True)])


def root_derivatives(plan: CausalPlan, sampler: Sampler) -> ca.Function:
    """Return (point over the plan's pairs, parameters, time) -> derivatives whose signs are those of the roots."""
    column = _column([r.slope for b in plan.blocks for r in b.roots])
    return ca.Function("derivatives", [sampler.w, plan.flat.p, plan.flat.scope.time], [column])


def _functions(
    plan: CausalPlan, sampler: Sampler, roots: list[Root]
) -> tuple[list[str], ca.Function, tuple[list[int], ca.Function]]:
    """Return names and values of the branch expressions that this causality computes, and the computed symbols."""
    flat = plan.flat
    assigned = [a for b in plan.blocks for a in b.assignments]
    computed = [pair for pair in (flat.scope.owner(s) for s, _ in assigned) if pair is not None]
    known = set(plan.known)
    available = {*computed, *plan.inputs, *plan.states}
    names, expressions = [], []
    for b in flat.branches:
        e = plan.alias.rewrite(flat, b.expression)
        inside = flat.scope.symbols_in(e)
        if all((p in available or p[0] in known) and p in sampler.position for p in inside):
            names.append(b.name)
            expressions.append(e)
    symbols = [flat.scope.symbol(*p) for p in computed]
    given = [s for s, _ in assigned], [e for _, e in assigned]
    results = substituted_in_order(*given, [_column(expressions), _column(symbols)], bool(flat.scope.calls))
    arguments = [sampler.w, flat.p, flat.scope.time, _column([r.sign for r in roots])]
    sides, numbers = (ca.Function("sides", arguments, [e]) for e in results)
    return names, sides, ([sampler.position[p] for p in computed], numbers)


def _distinguishing(
    names: list[str], plus: np.ndarray, minus: np.ndarray, requested: Mapping[str, int]
) -> tuple[int, int] | None:
    """Return (branch, sense) of the branch that settles a root, from its values on both sides of the root.

    Preferred is a branch whose expression only changes sign, then a requested one.
    """
    best: tuple[tuple[bool, bool, int], int] | None = None
    for n, name in enumerate(names):
        a, b = plus[:, n], minus[:, n]
        finite = np.isfinite(a) & np.isfinite(b)
        a, b = a[finite], b[finite]
        if not a.size or np.any(a * b >= 0) or np.any(a * a[0] < 0):
            continue
        antisymmetric = bool(np.all(np.abs(a + b) <= OWN * np.abs(a - b)))
        rank = (not antisymmetric, name not in requested, n)
        if best is None or rank < best[0]:
            best = (rank, 1 if a[0] > 0 else -1)
    return None if best is None else (best[0][2], best[1])


def _column(expressions: list[ca.SX]) -> ca.SX:
    return ca.vertcat(*expressions) if expressions else ca.SX(0, 1)


def _row(value: ca.DM) -> np.ndarray:
    return np.asarray(value.full()).reshape(-1)
