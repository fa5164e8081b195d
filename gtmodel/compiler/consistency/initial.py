"""Consistent initialisation: a system of its own, over all chain symbols at the start time."""

from __future__ import annotations

import reprlib
from collections.abc import Iterable, Mapping, Set
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from ...lang.slips import floats
from ...lang.source import ModelError, about
from ..branch import root_derivatives
from ..emission import substituted
from ..matrices import left_over, pivoted_qr
from ..plan import CausalPlan
from ..rows import PointFunction
from ..structure import condition_order

Pair = tuple[int, int]

# start values: squares of larger ones overflow, and an integrator's norms with them
LARGEST = 1e150
STEPS = 80
# residuals relative to the terms of their equation: initial values are states of an integrator that is far looser
TOLERANCE = 1e-10
# and where a closed form gives them, round-off
EXACT = 1e-12
# singular values below this fraction of the largest are directions that the equations leave free
RANK = 1e-9
# what an earlier stage settled is moved this much less than what comes up now
SETTLED = 1e-4
# a correction that leaves more than this part of the residual makes no progress
STALLED = 0.999
# a symbol that moves less than this in every unit direction that the equations leave free does not move
FREE = 1e-6
# values that were guessed are moved this much less than those that were not
SOFT = 1e-3
# corrections this small, in nominals, no longer show whether Newton converges
ROUND_OFF = 1e-8
# prescribed values are reached from the home pose in steps no shorter than this part of the way
SHORTEST = 1.0 / 128
# of a step each Newton correction must shrink to this part of the last, so that no other assembly mode is entered
CONTRACTION = 0.3
# a correction is halved until the residual falls, to this part; to this one where it leaves the domain of a root
SHORTEST_STEP, EDGE = 1e-3, 1e-12
# free symbols approach their target in at most so many steps, until one is this small
APPROACHES, NEAR = 20, 1e-6


@dataclass(frozen=True, eq=False)
class Initial:
    """A consistent point `w` over the plan's `pairs`; `free` are the symbols that may still move there, because
    neither the equations nor prescribed values settle them."""

    w: np.ndarray
    free: frozenset[Pair]


def initial_point(
    plan: CausalPlan,
    held: Mapping[Pair, float],
    guess: Mapping[Pair, float],
    time: float = 0.0,
    p: np.ndarray | None = None,
    samples: np.ndarray | None = None,
) -> Initial:
    """A point that satisfies all differentiated equations and the initial equations.

    held: symbols with a prescribed value (fixed starts, known inputs and their derivatives).
    guess: values that are kept where the equations allow it, else approached.
    p: values of all parameters, where they are not the model's own; the plan must hold those that differ as symbols.
    samples: consistent points for these values, where they are not the plan's.
    States that are free after that start as near to zero as the equations allow, from the side of the plan's samples.
    Where a root leaves a choice, the point lies on the plan's side of it, as in a causal function.

    Raises ModelError naming what contradicts the equations.
    """
    equations = _Equations(plan, time, p)
    place = {pair: n for n, pair in enumerate(plan.pairs)}
    fixed = {place[pair]: value for pair, value in held.items() if pair in place}
    hoped = {place[pair]: value for pair, value in guess.items() if pair in place and place[pair] not in fixed}
    samples = plan.samples if samples is None else samples
    at_rest = samples[0].copy()
    at_rest[[n for n, (_, k) in enumerate(plan.pairs) if k > 0]] = 0.0
    if (direct := equations.in_closed_form(at_rest, fixed)) is not None:
        return Initial(direct, frozenset())
    tries = [(w, kept) for w in (at_rest, *samples[:2]) for kept in ([hoped, {}] if hoped else [{}])]
    for w, kept in tries:
        point = equations.reach(w, fixed | kept, hoped.keys() - kept.keys())
        if point is not None:
            break
    else:
        kept, (point, stage) = {}, equations.straight(at_rest, fixed)
        if stage is not None:
            raise ModelError(equations.contradiction(point, stage, fixed))
    if not equations.on_branch(point):  # the way led through a singular pose to the other side of a root
        from_starts = at_rest.copy()
        for n, value in (hoped | fixed).items():
            from_starts[n] = value
        for w in (equations.moved_to_branch(point), from_starts):
            other = equations.reach(w, fixed, hoped.keys())
            if other is not None and equations.on_branch(other):
                point, kept = other, {}
                break
    taken = fixed | kept
    target = {n: x for n, x in (dict.fromkeys([place[s] for s in plan.states], 0.0) | hoped).items() if n not in taken}
    target |= dict.fromkeys(equations.completing(point, taken.keys(), target.keys()), 0.0)
    point = equations.approach(point, target, taken.keys())
    return Initial(point, frozenset(plan.pairs[n] for n in equations.loose(point, fixed.keys())))


class _Written:
    """All stages, positions first, and the initial equations, with their Jacobian; what the plan computes; and the
    derivatives that show on which side of its roots a point lies. Functions of (point, parameters, time)."""

    def __init__(self, plan: CausalPlan) -> None:
        self._plan, flat, sampler = plan, plan.flat, plan.sampler
        initial = plan.alias.rewrite_all(flat, [e.residual for e in flat.initial])
        residual = ca.SX(ca.vertcat(*sampler.stages, *initial))  # SX also where nothing is left but aliases
        missing = sorted(set(flat.scope.symbols_in(residual)) - set(plan.pairs))
        if missing:
            name = flat.symbol_name(*missing[0])
            raise ModelError(
                f"{flat.title}: an initial equation uses {name}; nothing that the equations need is so high"
            )
        # how many rows belong to each stage and those before it, and the stage in which each symbol comes up first
        self.counts = [*np.cumsum([s.numel() for s in sampler.stages]).tolist()[:-1], residual.numel()]
        self.stage = np.full(len(plan.pairs), len(sampler.stages))
        for n, stage in reversed(list(enumerate(sampler.stages))):
            self.stage[[sampler.position[pair] for pair in flat.scope.symbols_in(stage)]] = n
        jacobian = ca.densify(ca.jacobian(residual, sampler.w))
        self._arguments = [sampler.w, flat.p, flat.scope.time]
        self.residuals = PointFunction(ca.Function("initial", self._arguments, [residual, jacobian]))
        self.nominal = np.array([flat.variables[i].nominal for i, _ in plan.pairs])
        self.roots = np.array([r.value for b in plan.blocks for r in b.roots])

    @cached_property
    def sides(self) -> PointFunction:
        return PointFunction(root_derivatives(self._plan, self._plan.sampler))

    @cached_property
    def computed(self) -> PointFunction:
        """The point with what the plan computes put on its branches, all else as it is."""
        flat = self._plan.flat
        values = ca.cse(substituted(self._plan, [flat.scope.symbol(*pair) for pair in self._plan.pairs], []))
        return PointFunction(ca.Function("computed", self._arguments, [ca.vertcat(*values)]))

    @cached_property
    def read(self) -> frozenset[int] | None:
        """Positions of all that the plan computes a point from; None where it takes more than closed forms."""
        plan = self._plan
        if plan.newton or plan.flat.initial or plan.undetermined or plan.conditions:
            return None
        return frozenset(plan.sampler.position[pair] for pair in {*plan.states, *plan.inputs})

    @cached_property
    def rest(self) -> np.ndarray:
        """Positions of what the plan has no need to compute, such as rates that nothing asks for."""
        plan, owner = self._plan, self._plan.flat.scope.owner
        known = {*plan.states, *plan.inputs, *(owner(s) for b in plan.blocks for s, _ in b.assignments)}
        return np.array([n for n, pair in enumerate(plan.pairs) if pair not in known], dtype=int)


class _Equations:
    """All stages, positions first, and the initial equations, with their Jacobian, at one time."""

    def __init__(self, plan: CausalPlan, time: float, p: np.ndarray | None = None) -> None:
        self._plan, self._time, self._p = plan, time, plan.flat.require_values() if p is None else p
        key = "initial", plan
        if key not in plan.flat.cache:
            plan.flat.cache[key] = _Written(plan)
        self._written: _Written = plan.flat.cache[key]
        self._counts, self._stage, self._nominal = self._written.counts, self._written.stage, self._written.nominal

    def _f(self, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        residual, jacobian = self._written.residuals(w, self._p, self._time)
        return residual, jacobian

    def on_branch(self, w: np.ndarray) -> bool:
        """Whether every root has the sign that declared branches or start values give it, as in a causal function."""
        roots = self._written.roots
        if not roots.size:
            return True
        return bool(np.all(self._written.sides(w, self._p, self._time)[0].reshape(-1) * roots > 0))

    def moved_to_branch(self, w: np.ndarray) -> np.ndarray:
        """The point with what the plan computes put on its branches, all else as it is; w itself if no numbers come
        out."""
        moved = self._written.computed(w, self._p, self._time)[0].reshape(-1)
        return moved if np.all(np.isfinite(moved)) else w

    def in_closed_form(self, w: np.ndarray, fixed: Mapping[int, float]) -> np.ndarray | None:
        """The consistent point with prescribed values, where these are all that the plan computes a point from; None
        where that is no such point, or not the only one near."""
        read = self._written.read
        if read is None or not read <= fixed.keys():
            return None
        at, values = list(fixed), np.array(list(fixed.values()))
        w = w.copy()
        w[at] = values
        w = self._written.computed(w, self._p, self._time)[0].reshape(-1)
        if not np.all(np.abs(w[at] - values) <= EXACT * np.maximum(np.abs(values), self._nominal[at])):
            return None
        w[at] = values
        if not (np.all(np.isfinite(w)) and self.on_branch(w)):
            return None
        residual, jacobian = self(w)
        rest = self._written.rest
        if rest.size and np.all(np.isfinite(jacobian)):
            w[rest] -= np.linalg.lstsq(jacobian[:, rest], residual, rcond=RANK)[0]
            residual, jacobian = self(w)
        if not (np.all(np.isfinite(jacobian)) and np.max(np.abs(residual), initial=0.0) <= EXACT):
            return None
        columns = self._free(fixed.keys())
        a = jacobian[:, columns] * self._nominal[columns]
        if a.shape[0] < a.shape[1] or not a.shape[1]:
            return w if not a.shape[1] else None
        sizes = np.abs(np.diag(pivoted_qr(a, "r")[0]))
        return w if sizes[-1] > RANK * sizes[0] else None

    def __call__(self, w: np.ndarray, count: int | None = None) -> tuple[np.ndarray, np.ndarray]:
        """First `count` residuals and their Jacobian (count, n), rows in units of their largest term."""
        r, jacobian = (x[:count] for x in self._f(w))
        with np.errstate(invalid="ignore"):  # an infinite derivative makes its row NaN, and no step is taken there
            size = np.max(np.abs(jacobian) * np.maximum(np.abs(w), self._nominal), axis=1, initial=0.0)
            size = np.where(size > 0, size, 1.0)
            return r.reshape(-1) / size, jacobian / size[:, None]

    def reach(self, w: np.ndarray, fixed: Mapping[int, float], soft: Set[int]) -> np.ndarray | None:
        """A consistent point with prescribed values, followed from w as far as that goes; None if there is none.

        Each step follows the tangent, and is taken if the corrections are small beside it: from farther away Newton
        would go to the solution that happens to be nearest, which may be another assembly mode.
        """
        w, columns = w.copy(), self._free(fixed.keys())
        at, values = list(fixed), np.array(list(fixed.values()))
        begin, done, step = w[at], 0.0, 1.0
        if not self._correct(w, columns, soft, np.inf):
            step = 0.0
        while done < 1.0 and step >= SHORTEST:
            part = min(1.0, done + step)
            trial = w.copy()
            trial[at] = begin + part * (values - begin) if part < 1.0 else values
            jacobian = self(w)[1]
            trial[columns] += self._least(jacobian[:, columns], -jacobian[:, at] @ (trial - w)[at], columns, soft)
            if self._correct(trial, columns, soft, self._size(trial - w, w)):
                w, done, step = trial, part, 2 * step
            else:
                step /= 2
        if done < 1.0:
            w[at] = values
            if not self._correct(w, columns, soft, np.inf):
                return None
        return w

    def _correct(self, w: np.ndarray, columns: np.ndarray, soft: Set[int], last: float) -> bool:
        """Solve stage after stage in place; False where that does not converge, or not well inside the step `last`."""
        with np.errstate(all="ignore"):
            return all(self._solve(w, columns, soft, last, stage) for stage in range(len(self._counts)))

    def _solve(self, w: np.ndarray, columns: np.ndarray, soft: Set[int], last: float, stage: int) -> bool:
        """Least-norm Gauss-Newton on the equations of one stage and those before it."""
        count, contraction = self._counts[stage], CONTRACTION if np.isfinite(last) else np.inf
        r, jacobian = self(w, count)
        for _ in range(STEPS if columns.size and count else 0):
            if not (np.all(np.isfinite(r)) and np.all(np.isfinite(jacobian))):
                return False
            step = np.zeros(len(w))
            step[columns] = self._least(jacobian[:, columns], -r, columns, soft, stage)
            size = self._size(step, w)
            if size > contraction * last and size > ROUND_OFF:
                return False
            w += step
            old, (r, jacobian) = np.linalg.norm(r), self(w, count)
            part = 1.0
            # too far: back half the way, and farther where no number comes out of a root
            while not np.linalg.norm(r) <= old and part > (SHORTEST_STEP if np.all(np.isfinite(r)) else EDGE):
                part /= 2
                w -= part * step
                r, jacobian = self(w, count)
            if size < 1e-13 or (size < ROUND_OFF and size > 0.5 * last) or np.linalg.norm(r) > STALLED * old:
                break
            last = size
        return bool(np.max(np.abs(r), initial=0.0) <= TOLERANCE)

    def _least(
        self, a: np.ndarray, b: np.ndarray, columns: np.ndarray, soft: Set[int], stage: int | None = None
    ) -> np.ndarray:
        """The smallest x with a x = b; soft symbols, and what earlier stages settled, count as large ones."""
        stage = len(self._counts) - 1 if stage is None else stage
        reach = self._nominal[columns] * np.where(self._stage[columns] < stage, SETTLED, 1.0)
        reach = reach * [SOFT if n in soft else 1.0 for n in columns.tolist()]
        used = np.any(a != 0.0, axis=0)  # an early stage holds few of the symbols
        x = np.zeros(columns.size)
        x[used] = reach[used] * np.linalg.lstsq(a[:, used] * reach[used], b, rcond=RANK)[0]
        left = b - a @ x
        if np.linalg.norm(left) > TOLERANCE * np.linalg.norm(b):
            x[used] += left_over(a[:, used], left, RANK)
        return x

    def _size(self, step: np.ndarray, w: np.ndarray) -> float:
        return float(np.max(np.abs(step) / np.maximum(np.abs(w), self._nominal), initial=0.0))

    def approach(self, w: np.ndarray, target: Mapping[int, float], fixed: Set[int]) -> np.ndarray:
        """The consistent point, reached from w, that comes nearest to target values by position."""
        columns, at = self._free(fixed), sorted(target)
        values = np.array([target[n] for n in at])
        scale, wanted = self._nominal[columns], np.searchsorted(columns, at)
        for _ in range(APPROACHES if at else 0):
            free = self._null_space(w, columns)
            missing = (values - w[at]) / self._nominal[at]
            step = np.zeros(len(w))
            step[columns] = scale * (free @ np.linalg.lstsq(free[wanted], missing, rcond=RANK)[0])
            if not free.size or self._size(step, w) < NEAR:
                break
            for part in (1.0, 0.5, 0.25, 0.125):
                trial = w + part * step
                if self._correct(trial, columns, target.keys(), self._size(part * step, w)) and (
                    np.linalg.norm((values - trial[at]) / self._nominal[at]) < np.linalg.norm(missing)
                ):
                    break
            else:
                break
            w = trial
        return w

    def completing(self, w: np.ndarray, fixed: Set[int], some: Set[int]) -> list[int]:
        """Symbols below the highest derivatives that, with `some`, distinguish all ways to move."""
        columns = self._free(fixed)
        rest = self._null_space(w, columns)
        top = dict(zip(self._plan.structure.unknowns, self._plan.structure.d.tolist(), strict=True))
        pairs = [self._plan.pairs[n] for n in columns]
        may = np.array([k < top.get(i, 0) for i, k in pairs], dtype=bool)
        chosen: list[int] = []
        for group in (np.isin(columns, list(some)), may):
            while rest.size:
                sizes = np.where(group, np.linalg.norm(rest, axis=1), 0.0)
                n = int(np.argmax(sizes))
                if sizes[n] <= FREE:
                    break
                direction = rest[n] / sizes[n]
                rest = rest - np.outer(rest @ direction, direction)
                chosen.append(int(columns[n]))
        return [n for n in chosen if n not in some]

    def loose(self, w: np.ndarray, fixed: Set[int]) -> list[int]:
        """Positions of the symbols that can move without leaving the equations."""
        columns = self._free(fixed)
        free = self._null_space(w, columns)
        return [int(n) for n, row in zip(columns, free, strict=True) if np.max(np.abs(row), initial=0.0) > FREE]

    def _null_space(self, w: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """Orthonormal directions (columns, k), in nominals, that leave the equations satisfied."""
        a = self(w)[1][:, columns] * self._nominal[columns]
        if not a.size:
            return np.eye(columns.size)
        q, r, _ = pivoted_qr(a.T)
        size = np.abs(np.diag(r))
        return q[:, int(np.sum(size > RANK * np.max(size, initial=0.0))) :]

    def _free(self, fixed: Set[int]) -> np.ndarray:
        return np.array([n for n in range(len(self._plan.pairs)) if n not in fixed], dtype=int)

    def straight(self, w: np.ndarray, fixed: Mapping[int, float]) -> tuple[np.ndarray, int | None]:
        """The point that Newton reaches from w with the prescribed values at once, and the first stage that it does not
        solve; None if it solves all."""
        w, columns = w.copy(), self._free(fixed.keys())
        w[list(fixed)] = list(fixed.values())
        with np.errstate(all="ignore"):
            stages = range(len(self._counts))
            return w, next((n for n in stages if not self._solve(w, columns, set(), np.inf, n)), None)

    def contradiction(self, w: np.ndarray, stage: int, fixed: Mapping[int, float]) -> str:
        """A sentence naming the equations and prescribed values that cannot hold together: of a stage at a point where
        Newton does not solve it."""
        r, jacobian = self(w, self._counts[stage])
        flat, labels = self._plan.flat, self._labels()
        if not np.all(np.isfinite(jacobian)) and np.all(np.isfinite(self._f(w)[0])):
            at = "; ".join(labels[i] for i in np.flatnonzero(~np.all(np.isfinite(jacobian), axis=1))[:3])
            return (
                f"{flat.title}: at the start values {at} has a derivative that is not finite; start elsewhere, or make "
                "it smooth there"
            )
        if not np.all(np.isfinite(r)):
            at = ", ".join(labels[i] for i in np.flatnonzero(~np.isfinite(r))[:3])
            return f"{flat.title}: at the start values no number comes out of {at}; give other start values"
        worst = int(np.argmax(np.abs(r)))
        raw = float(np.abs(self._f(w)[0].reshape(-1)[worst]))
        equations = [
            labels[i] for i in np.argsort(-np.abs(r), kind="stable")[:3] if np.abs(r[i]) > 0.1 * np.abs(r[worst])
        ]
        # at a least-squares point only the prescribed values can still pull: those that do contradict each other
        pull = np.abs(jacobian.T @ r) * np.maximum(np.abs(w), self._nominal)
        strongest = max((pull[n] for n in fixed), default=0.0)
        names = [
            f"{flat.symbol_name(*self._plan.pairs[n])} = {fixed[n]:g}"
            for n in sorted(fixed)
            if pull[n] > 1e-3 * strongest
        ]
        rest = f" and {len(names) - 8} more" if len(names) > 8 else ""
        at_fault = f"with the prescribed {', '.join(names[:8])}{rest}" if names else "from the start values"
        advice = "prescribe fewer of them, or mend them" if names else "give start values near a consistent pose"
        return (
            f"{flat.title}: no consistent start was found {at_fault}: a residual of {raw:.3g} is left in "
            f"{'; '.join(equations)}; {advice}"
        )

    def _labels(self) -> list[str]:
        structure, flat = self._plan.structure, self._plan.flat
        labels = []
        first = -int(structure.d.max(initial=0))
        top = condition_order(flat, self._plan.conditions, self._plan.pairs)
        for m in range(max(1 - first, top + 1)):
            for e, c in zip(structure.equations, structure.c, strict=True):
                if 0 <= c + first + m and first + m <= 0:
                    labels.append(f"{e.label}{chr(39) * int(c + first + m)} ({e.where})")
            labels += [f"{e.label}{chr(39) * m} ({e.where})" for e in self._plan.conditions if m <= top]
        return labels + [f"{e.label} ({e.where})" for e in flat.initial]


def start_values(
    plan: CausalPlan, given: Mapping[str, object] | None = None, inputs: Iterable[int] = ()
) -> tuple[dict[Pair, float], dict[Pair, float]]:
    """(held, guess) by kept symbol: fixed starts and what the caller gives are held, other starts guessed.

    `given` maps names such as "T", "der(q)", "x" to values of their shape, or one number for all entries; it
    overrules start attributes. `inputs` are indices of known variables, which nobody may start.

    Raises ModelError for a wrong name or shape, and for two values of one quantity.
    """
    flat, known = plan.flat, set(inputs)
    held: dict[Pair, float] = {}
    guess: dict[Pair, float] = {}
    for v in flat.variables:
        if v.start is not None and v.index not in known:
            sign, kept, order = plan.alias.resolve(v.index, 0)
            (held if v.fixed else guess).setdefault((kept, order), sign * v.start)
    names: dict[Pair, str] = {}
    for name, value in (given or {}).items():
        with about(f"start.{name}"):
            _, indices, order = flat.lookup(name)
            try:
                array = floats(value).reshape(-1)
            except (TypeError, ValueError):
                raise ModelError(f"the start of '{name}' takes numbers; found {reprlib.repr(value)}") from None
            if array.size not in (1, len(indices)):
                raise ModelError(f"the start of '{name}' has {len(indices)} entries; found {array.size}")
            if not np.all(np.isfinite(array)):
                raise ModelError(f"the start of '{name}' must be finite; found {value}")
            if np.any(np.abs(array) > LARGEST):
                size = float(np.max(np.abs(array)))
                raise ModelError(
                    f"the start of '{name}' is of size {size:g}; squares of more than {LARGEST:g} overflow"
                )
            for i, x in zip(indices, np.broadcast_to(array, len(indices)), strict=True):
                sign, kept, k = plan.alias.resolve(i, order)
                if kept in known:
                    raise ModelError(
                        f"'{name}' cannot be started: '{flat.variables[kept].name}' is an input with its own"
                    )
                value_of = sign * float(x)
                if (kept, k) in names and held[(kept, k)] != value_of:
                    raise ModelError(
                        f"the starts of '{names[(kept, k)]}' and '{name}' are the same quantity and differ"
                    )
                names[(kept, k)] = name
                held[(kept, k)] = value_of
                guess.pop((kept, k), None)
    return held, guess
