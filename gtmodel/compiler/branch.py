"""Branches: the sign of each root, from the geometry that components declare, else from the start values."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from ..lang.source import ModelError
from .blocks import Margin, Root, median
from .consistency.points import RESIDUAL_TOLERANCE, Sampler
from .flat import FlatModel

if TYPE_CHECKING:
    from .plan import CausalPlan

# a branch expression that only changes its sign with the root is the root's own name, up to round-off
OWN = 1e-9
# a home pose on another branch is sought from this many starts, this far off in nominals
MIRROR_TRIES = 24
MIRRORED = 5
MIRROR_SPREADS = (0.002, 0.02, 0.05)
# of those found count the nearest to the home pose, and what is hardly farther than it, in nominals: what need not
# change with a branch stays as it is
AS_NEAR = 0.1
CROSSINGS = 4
CROSSING_STEPS = 20
CROSSED = 1e-3  # a step as short as this, in nominals, ends a crossing: the equations left out are still to come
# a combination of branches that moves by less than this part of the one that moves most is left to the equations: six
# rods on three carts cannot all be mirrored, and what is left of them would turn the plate right over
DAMPED = 0.1
STILL = 1e-3  # how readily a known variable is moved, or one that need not move


def check_branches(flat: FlatModel, wanted: Mapping[str, int]) -> None:
    """Raises ModelError for a branch that nobody declares, or a sign that is neither +1 nor -1."""
    names = {b.name for b in flat.branches}
    for name, sign in wanted.items():
        if name not in names:
            raise ModelError(f"{flat.title} has no branch '{name}'; it has {', '.join(sorted(names)) or 'none'}")
        if sign not in (-1, 1):
            raise ModelError(f"branch '{name}' takes +1 or -1; found {sign}")


def settle(plan: CausalPlan, sampler: Sampler, wanted: Mapping[str, int]) -> CausalPlan:
    """The plan with a sign for every root, and with samples on the chosen branches.

    A branch distinguishes the solutions of a root if its expression changes sign, in the same sense at every
    sample, when the root does; its sign is the wanted one, +1 by default. A root that no branch settles
    takes the side of the start values. Branches that settle no root of this causality play no part, but where
    Newton continues a home pose, that pose has the wanted signs.
    """
    plan = _with_settled_roots(plan, sampler, wanted)
    if plan.newton:
        settling = {r.settled_by for b in plan.blocks for r in b.roots}
        plan = _with_moved_home(plan, sampler, {name: sign for name, sign in wanted.items() if name not in settling})
    return plan


def _with_roots(plan: CausalPlan, roots: list[Root]) -> CausalPlan:
    """The plan with these roots, in the order of its blocks."""
    given = iter(roots)
    return replace(plan, blocks=[replace(b, roots=[next(given) for _ in b.roots]) for b in plan.blocks])


def _with_settled_roots(plan: CausalPlan, sampler: Sampler, wanted: Mapping[str, int]) -> CausalPlan:
    roots = RootSigns(plan, sampler)
    if not roots.count:
        return plan
    settled = roots.settled(sampler, plan.samples, wanted)
    return replace(_with_roots(plan, settled), samples=roots.samples(sampler, plan.samples, settled))


class RootSigns:
    """What gives the roots of a plan their signs, at numbers of the parameters that are those of a sampler's model."""

    def __init__(self, plan: CausalPlan, sampler: Sampler) -> None:
        self._roots = [r for b in plan.blocks for r in b.roots]
        if self._roots:
            self._names, self._sides, self._values = _functions(plan, sampler, self._roots)
            self._jacobian = root_derivatives(plan, sampler)

    @property
    def count(self) -> int:
        return len(self._roots)

    def settled(self, sampler: Sampler, samples: np.ndarray, wanted: Mapping[str, int]) -> list[Root]:
        """The roots with the signs of wanted branches, or else of samples. Raises ModelError."""
        p, names = sampler.flat.p0, self._names
        at_start = np.array([_row(self._jacobian(w, p, sampler.time)) for w in samples])
        signs = np.ones(len(self._roots))
        settled: list[Root] = []
        for n, root in enumerate(self._roots):
            seen = {}
            for side in (1, -1):
                signs[n] = side
                seen[side] = np.array([_row(self._sides(w, p, sampler.time, signs)) for w in samples])
            teller = _teller(names, seen[1], seen[-1], wanted)
            if teller is not None:
                name = names[teller[0]]
                settled.append(replace(root, settled_by=name, value=teller[1] * wanted.get(name, 1)))
            else:
                positive = int(np.sum(at_start[:, n] > 0))
                if positive not in (0, len(at_start)):
                    raise ModelError(
                        f"{sampler.flat.title}: {root.label} has two solutions and nothing distinguishes them; declare "
                        "gt.branch(name, expression) or give start values near the wanted one"
                    )
                settled.append(replace(root, settled_by="", value=1 if positive else -1))
            signs[n] = settled[n].value
        return settled

    def samples(self, sampler: Sampler, samples: np.ndarray, settled: list[Root]) -> np.ndarray:
        """Samples where the roots have these signs. Raises ModelError where there is none."""
        p, signs = sampler.flat.p0, np.array([r.value for r in settled], float)
        kept = []
        for sample in samples:
            w = sample.copy()
            computed, numbers = self._values
            w[computed] = _row(numbers(w, p, sampler.time, signs))
            if not np.all(np.isfinite(w)) or sampler.correct(w) > RESIDUAL_TOLERANCE:
                continue
            if np.all(_row(self._jacobian(w, p, sampler.time)) * signs > 0):
                kept.append(w)
        if not kept:
            raise ModelError(
                f"{sampler.flat.title}: no pose on the wanted branches was found; give start values near a home pose"
            )
        return np.array(kept)


def _with_moved_home(plan: CausalPlan, sampler: Sampler, wanted: Mapping[str, int]) -> CausalPlan:
    """The plan with samples where the wanted branches have their signs; mirrored there if they have not."""
    flat, p = plan.flat, plan.flat.p0
    expressions = {b.name: plan.alias.rewrite(flat, b.expression) for b in flat.branches}
    inside = {name: flat.scope.symbols_in(e) for name, e in expressions.items()}
    names = [n for n in expressions if n in wanted and all(s in sampler.position for s in inside[n])]
    if not names:
        return plan
    # roots keep their signs
    column = _column([*(expressions[n] for n in names), *(r.slope * r.value for b in plan.blocks for r in b.roots)])
    signs = np.array([wanted[n] for n in names] + [1] * (column.numel() - len(names)))
    arguments = [sampler.w, flat.p, flat.scope.time]
    sides = ca.Function("sides", arguments, [column])

    def right(w: np.ndarray) -> bool:
        return bool(np.all(_row(sides(w, p, sampler.time)) * signs > 0))

    samples = [w for w in plan.samples if right(w)]
    if not samples:
        # first without the equations that bend in what branches are made of, such as a rod's length: they would push
        # back all the way over
        within = ca.vertcat(*[flat.scope.symbol(*p) for p in sorted(set().union(*inside.values()))])
        bent = ca.which_depends(sampler.stages[0], within, 2, True)
        straight = [row for row, b in zip(ca.vertsplit(sampler.stages[0]), bent, strict=True) if not b]
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
        counted = np.array([pair in sampler.starts for pair in sampler.pairs], dtype=bool)
        far = [float(np.sum(np.abs(w - plan.samples[0])[counted] / nominal[counted])) for w in samples]
        samples = [w for d, w in sorted(zip(far, samples, strict=True), key=lambda p: p[0]) if d <= min(far) + AS_NEAR]
    if not samples:
        asked = ", ".join(f"'{n}' = {wanted[n]:+d}" for n in names)
        raise ModelError(
            f"{flat.title}: no pose with branch {asked} was found from the start values; give start values near one"
        )
    return replace(plan, samples=np.array(samples))


def _cross(
    linear: Callable[[np.ndarray], list[ca.DM]],
    start: np.ndarray,
    signs: np.ndarray,
    nominal: np.ndarray,
    ease: np.ndarray,
) -> np.ndarray:
    """A point on the other side that differs from the start in as few variables as possible.

    linear: point -> residuals of equations, values of the branches, and the derivatives of both. The equations hold,
    the branches come as near to their opposites as DAMPED allows. What moved little may move even less the next time:
    a cart changes sides rather than the plate its orientation.
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
            # from the start: onto the equations, and from there along them
            gone, inverse = (w - start) / reach, np.linalg.pinv(equations, rcond=1e-10)
            onto = inverse @ (equations @ gone - r[:, 0])
            along = slopes - slopes @ inverse @ equations
            damping = (DAMPED * np.linalg.norm(along, 2)) ** 2 * np.eye(len(side))
            asked = (signs * now - side[:, 0]) / part + slopes @ (gone - onto)
            nearest = start + reach * (onto + along.T @ np.linalg.pinv(along @ along.T + damping) @ asked)
            step = np.max(np.abs(nearest - w) / nominal)
            w = nearest
            if step <= CROSSED:
                break
        moved = np.abs(w - start) / nominal * ease
        ease = np.maximum(moved / max(float(np.max(moved)), 1e-300), STILL)
    return w


def sides(plan: CausalPlan, sampler: Sampler) -> list[Margin]:
    """Margins that are positive where Newton's answer lies on the branches of the home pose.

    Those that no root takes care of: they depend on the unknowns of a Newton block, and on nothing that the plan does
    not compute. A home pose so near the border of a branch that the samples lie on both sides asks for neither.
    """
    flat = plan.flat
    if not plan.newton or not flat.branches:
        return []
    settling = {r.settled_by for b in plan.blocks for r in b.roots}
    rewritten = {b.name: plan.alias.rewrite(flat, b.expression) for b in flat.branches if b.name not in settling}
    assigned = [a for b in plan.blocks for a in b.assignments]
    computed = list(rewritten.values())
    if assigned:
        _, computed = ca.substitute_inplace([s for s, _ in assigned], [e for _, e in assigned], computed)
    unknown = {s.element_hash() for b in plan.newton for s in b.unknowns}
    given = unknown | {flat.scope.symbol(*pair).element_hash() for pair in plan.inputs}
    margins = []
    for (name, expression), solved in zip(rewritten.items(), computed, strict=True):
        inside = {flat.scope.symbol(*pair).element_hash() for pair in flat.scope.symbols_in(solved)}
        known = all(pair in sampler.position for pair in flat.scope.symbols_in(expression))
        if inside & unknown and inside <= given and known:
            f = ca.Function("side", [sampler.w, flat.p, flat.scope.time], [expression])
            values = np.array([float(f(w, flat.p0, sampler.time)) for w in plan.samples])
            sign = 1 if values[0] > 0 else -1
            if np.all(sign * values > 0):
                margin = sign * expression
                margins.append(Margin("branch", margin, f"{name} = {sign:+d}", float(median(sign * values))))
    return margins


def follow(plan: CausalPlan, sampler: Sampler) -> CausalPlan:
    """The plan with every root's sign as it is at its one sample and its time."""
    roots = [r for b in plan.blocks for r in b.roots]
    if not roots:
        return plan
    derivatives = _row(root_derivatives(plan, sampler)(plan.samples[0], plan.flat.p0, sampler.time)).tolist()
    return _with_roots(plan, [replace(r, value=1 if x >= 0 else -1) for r, x in zip(roots, derivatives, strict=True)])


def root_derivatives(plan: CausalPlan, sampler: Sampler) -> ca.Function:
    """(point over the plan's pairs, parameters, time) -> derivatives, which give the signs of the roots there."""
    column = _column([r.slope for b in plan.blocks for r in b.roots])
    return ca.Function("derivatives", [sampler.w, plan.flat.p, plan.flat.scope.time], [column])


def _functions(
    plan: CausalPlan, sampler: Sampler, roots: list[Root]
) -> tuple[list[str], ca.Function, tuple[list[int], ca.Function]]:
    """Names and values of the branch expressions that this causality computes, and the computed symbols' values."""
    flat = plan.flat
    assigned = [a for b in plan.blocks for a in b.assignments]
    computed = [pair for pair in (flat.scope.owner(s) for s, _ in assigned) if pair is not None]
    known = set(plan.known)
    given = {*computed, *plan.inputs, *plan.states}
    names, expressions = [], []
    for b in flat.branches:
        e = plan.alias.rewrite(flat, b.expression)
        inside = flat.scope.symbols_in(e)
        if all((p in given or p[0] in known) and p in sampler.position for p in inside):
            names.append(b.name)
            expressions.append(e)
    symbols = [flat.scope.symbol(*p) for p in computed]
    _, results = ca.substitute_inplace(
        [s for s, _ in assigned], [e for _, e in assigned], [_column(expressions), _column(symbols)]
    )
    arguments = [sampler.w, flat.p, flat.scope.time, _column([r.sign for r in roots])]
    sides, numbers = (ca.Function("sides", arguments, [e]) for e in results)
    return names, sides, ([sampler.position[p] for p in computed], numbers)


def _teller(names: list[str], plus: np.ndarray, minus: np.ndarray, wanted: Mapping[str, int]) -> tuple[int, int] | None:
    """(branch, sense) of the branch that settles a root, given its values on both sides of the root.

    Of several, one whose expression merely changes sign comes first, then one that was asked for.
    """
    best: tuple[tuple[bool, bool, int], int] | None = None
    for n, name in enumerate(names):
        a, b = plus[:, n], minus[:, n]
        finite = np.isfinite(a) & np.isfinite(b)
        a, b = a[finite], b[finite]
        if not a.size or np.any(a * b >= 0) or np.any(a * a[0] < 0):
            continue
        own = bool(np.all(np.abs(a + b) <= OWN * np.abs(a - b)))
        rank = (not own, name not in wanted, n)
        if best is None or rank < best[0]:
            best = (rank, 1 if a[0] > 0 else -1)
    return None if best is None else (best[0][2], best[1])


def _column(expressions: list[ca.SX]) -> ca.SX:
    return ca.vertcat(*expressions) if expressions else ca.SX(0, 1)


def _row(value: ca.DM) -> np.ndarray:
    return np.asarray(value.full()).reshape(-1)
