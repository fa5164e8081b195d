"""Consistent initialisation: a separate system of equations over all chain symbols at the start time."""

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

# largest start value: squares of larger ones, and an integrator's norms, overflow
LARGEST = 1e150
STEPS = 80
# residuals relative to the terms of their equation: far tighter than an integrator's tolerance
TOLERANCE = 1e-10
# the same for values from a closed form: round-off
EXACT = 1e-12
# singular values below this fraction of the largest are free directions
RANK = 1e-9
# weight of symbols that an earlier stage has determined
SETTLED = 1e-4
# a correction that leaves more than this fraction of the residual makes no progress
STALLED = 0.999
# a symbol that moves less than this in every free unit direction is determined
FREE = 1e-6
# weight of guessed values
SOFT = 1e-3
# corrections below this, in nominals, do not show whether Newton's method converges
ROUND_OFF = 1e-8
# shortest step from the home pose to the prescribed values, as a fraction of the distance
SHORTEST = 1.0 / 128
# largest ratio of successive Newton corrections, so that no other assembly mode is entered
CONTRACTION = 0.3
# a correction is halved until the residual falls, down to the first fraction; outside a root's domain to the second
SHORTEST_STEP, EDGE = 1e-3, 1e-12
# free symbols approach their target in at most this many steps, until a step is this small
APPROACHES, NEAR = 20, 1e-6


@dataclass(frozen=True, eq=False)
class Initial:
    """A consistent point `w` over the plan's `pairs`; `free` are the symbols that neither the equations nor prescribed
    values determine there."""

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
    """Return a point that satisfies all differentiated equations and the initial equations.

    held: symbols with a prescribed value (fixed starts, known inputs and their derivatives).
    guess: values that are kept if the equations allow it, else approached.
    p: values of all parameters, if they differ from the model's; the plan must hold those that differ as symbols.
    samples: consistent points for these values, if they differ from the plan's.
    Free states start as near to zero as the equations allow, from the side of the plan's samples. The point lies on the
    plan's side of each root, as in a causal function.

    Raises ModelError that names the values and equations in contradiction.
    """
    equations = _Equations(plan, time, p)
    place = {pair: n for n, pair in enumerate(plan.pairs)}
    fixed = {place[pair]: value for pair, value in held.items() if pair in place}
    guessed = {place[pair]: value for pair, value in guess.items() if pair in place and place[pair] not in fixed}
    samples = plan.samples if samples is None else samples
    at_rest = samples[0].copy()
    at_rest[[n for n, (_, k) in enumerate(plan.pairs) if k > 0]] = 0.0
    if (direct := equations.in_closed_form(at_rest, fixed)) is not None:
        return Initial(direct, frozenset())
    tries = [(w, kept) for w in (at_rest, *samples[:2]) for kept in ([guessed, {}] if guessed else [{}])]
    for w, kept in tries:
        point = equations.reach(w, fixed | kept, guessed.keys() - kept.keys())
        if point is not None:
            break
    else:
        kept, (point, stage) = {}, equations.straight(at_rest, fixed)
        if stage is not None:
            raise ModelError(equations.contradiction(point, stage, fixed))
    if not equations.on_branch(point):  # the continuation led through a singular pose to the other side of a root
        from_starts = at_rest.copy()
        for n, value in (guessed | fixed).items():
            from_starts[n] = value
        for w in (equations.moved_to_branch(point), from_starts):
            candidate = equations.reach(w, fixed, guessed.keys())
            if candidate is not None and equations.on_branch(candidate):
                point, kept = candidate, {}
                break
    set_values = fixed | kept
    states = dict.fromkeys([place[s] for s in plan.states], 0.0)
    target = {n: x for n, x in (states | guessed).items() if n not in set_values}
    target |= dict.fromkeys(equations.completing(point, set_values.keys(), target.keys()), 0.0)
    point = equations.approach(point, target, set_values.keys())
    return Initial(point, frozenset(plan.pairs[n] for n in equations.loose(point, fixed.keys())))


class _Written:
    """Functions of (point, parameters, time): all stages, positions first, and the initial equations, with their
    Jacobian; the values that the plan computes; and the derivatives that show the side of each root."""

    def __init__(self, plan: CausalPlan) -> None:
        self._plan, flat, sampler = plan, plan.flat, plan.sampler
        initial = plan.alias.rewrite_all(flat, [e.residual for e in flat.initial])
        residual = ca.SX(ca.vertcat(*sampler.stages, *initial))  # vertcat() of nothing is not an SX
        missing = sorted(set(flat.scope.symbols_in(residual)) - set(plan.pairs))
        if missing:
            name = flat.symbol_name(*missing[0])
            raise ModelError(
                f"{flat.title}: an initial equation uses {name}, but the equations have no derivative of this order"
            )
        # number of rows up to each stage, and the first stage with each symbol
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
        """The point with the plan's values of its computed symbols; other symbols are unchanged."""
        flat = self._plan.flat
        values = ca.cse(substituted(self._plan, [flat.scope.symbol(*pair) for pair in self._plan.pairs], []))
        return PointFunction(ca.Function("computed", self._arguments, [ca.vertcat(*values)]))

    @cached_property
    def read(self) -> frozenset[int] | None:
        """Positions of the symbols from which the plan computes a point; None if it needs more than closed forms."""
        plan = self._plan
        if plan.newton or plan.flat.initial or plan.undetermined or plan.conditions:
            return None
        return frozenset(plan.sampler.position[pair] for pair in {*plan.states, *plan.inputs})

    @cached_property
    def rest(self) -> np.ndarray:
        """Positions of symbols that the plan does not compute, such as rates that are not needed."""
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
        """Return whether every root has the sign from declared branches or start values, as in a causal function."""
        roots = self._written.roots
        if not roots.size:
            return True
        return bool(np.all(self._written.sides(w, self._p, self._time)[0].reshape(-1) * roots > 0))

    def moved_to_branch(self, w: np.ndarray) -> np.ndarray:
        """Return the point with the plan's values of its computed symbols; w itself if they are not finite."""
        moved = self._written.computed(w, self._p, self._time)[0].reshape(-1)
        return moved if np.all(np.isfinite(moved)) else w

    def in_closed_form(self, w: np.ndarray, fixed: Mapping[int, float]) -> np.ndarray | None:
        """Return the consistent point with prescribed values if the plan computes it from these in closed form.

        The result is None if that is not possible, or if the point is not locally unique.
        """
        read = self._written.read
        if read is None or not read <= fixed.keys():
            return None
        columns, values = list(fixed), np.array(list(fixed.values()))
        w = w.copy()
        w[columns] = values
        w = self._written.computed(w, self._p, self._time)[0].reshape(-1)
        if not np.all(np.abs(w[columns] - values) <= EXACT * np.maximum(np.abs(values), self._nominal[columns])):
            return None
        w[columns] = values
        if not (np.all(np.isfinite(w)) and self.on_branch(w)):
            return None
        residual, jacobian = self(w)
        rest = self._written.rest
        if rest.size and np.all(np.isfinite(jacobian)):
            w[rest] -= np.linalg.lstsq(jacobian[:, rest], residual, rcond=RANK)[0]
            residual, jacobian = self(w)
        if not (np.all(np.isfinite(jacobian)) and np.max(np.abs(residual), initial=0.0) <= EXACT):
            return None
        free = self._free(fixed.keys())
        a = jacobian[:, free] * self._nominal[free]
        if a.shape[0] < a.shape[1] or not a.shape[1]:
            return w if not a.shape[1] else None
        sizes = np.abs(np.diag(pivoted_qr(a, "r")[0]))
        return w if sizes[-1] > RANK * sizes[0] else None

    def __call__(self, w: np.ndarray, count: int | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Return the first `count` residuals and their Jacobian (count, n), scaled by the largest term of each row."""
        r, jacobian = (x[:count] for x in self._f(w))
        with np.errstate(invalid="ignore"):  # an infinite derivative makes its row NaN, which prevents a step
            size = np.max(np.abs(jacobian) * np.maximum(np.abs(w), self._nominal), axis=1, initial=0.0)
            size = np.where(size > 0, size, 1.0)
            return r.reshape(-1) / size, jacobian / size[:, None]

    def reach(self, w: np.ndarray, fixed: Mapping[int, float], soft: Set[int]) -> np.ndarray | None:
        """Return a consistent point with prescribed values, by continuation from w; None if there is none.

        Each step follows the tangent and is accepted if the corrections are small relative to it: from farther away
        Newton's method might converge to another assembly mode.
        """
        w, columns = w.copy(), self._free(fixed.keys())
        known, values = list(fixed), np.array(list(fixed.values()))
        begin, done, step = w[known], 0.0, 1.0
        if not self._correct(w, columns, soft, np.inf):
            step = 0.0
        while done < 1.0 and step >= SHORTEST:
            part = min(1.0, done + step)
            trial = w.copy()
            trial[known] = begin + part * (values - begin) if part < 1.0 else values
            jacobian = self(w)[1]
            trial[columns] += self._least(jacobian[:, columns], -jacobian[:, known] @ (trial - w)[known], columns, soft)
            if self._correct(trial, columns, soft, self._size(trial - w, w)):
                w, done, step = trial, part, 2 * step
            else:
                step /= 2
        if done < 1.0:
            w[known] = values
            if not self._correct(w, columns, soft, np.inf):
                return None
        return w

    def _correct(self, w: np.ndarray, columns: np.ndarray, soft: Set[int], last: float) -> bool:
        """Solve stage after stage in place; False without convergence, or if corrections exceed the step `last`."""
        with np.errstate(all="ignore"):
            return all(self._solve(w, columns, soft, last, stage) for stage in range(len(self._counts)))

    def _solve(self, w: np.ndarray, columns: np.ndarray, soft: Set[int], last: float, stage: int) -> bool:
        """Solve the equations of one stage and those before it by least-norm Gauss-Newton steps."""
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
            # step too long: halve it, more often if the point is outside the domain of a root
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
        """Return the weighted least-norm x with a x = b; soft symbols, and those of earlier stages, move less."""
        stage = len(self._counts) - 1 if stage is None else stage
        reach = self._nominal[columns] * np.where(self._stage[columns] < stage, SETTLED, 1.0)
        reach = reach * [SOFT if n in soft else 1.0 for n in columns.tolist()]
        used = np.any(a != 0.0, axis=0)  # an early stage contains few of the symbols
        x = np.zeros(columns.size)
        x[used] = reach[used] * np.linalg.lstsq(a[:, used] * reach[used], b, rcond=RANK)[0]
        residual = b - a @ x
        if np.linalg.norm(residual) > TOLERANCE * np.linalg.norm(b):
            x[used] += left_over(a[:, used], residual, RANK)
        return x

    def _size(self, step: np.ndarray, w: np.ndarray) -> float:
        return float(np.max(np.abs(step) / np.maximum(np.abs(w), self._nominal), initial=0.0))

    def approach(self, w: np.ndarray, target: Mapping[int, float], fixed: Set[int]) -> np.ndarray:
        """Return the consistent point, reached from w, that comes nearest to the target values by position."""
        columns, goals = self._free(fixed), sorted(target)
        values = np.array([target[n] for n in goals])
        scale, rows = self._nominal[columns], np.searchsorted(columns, goals)
        for _ in range(APPROACHES if goals else 0):
            free = self._null_space(w, columns)
            missing = (values - w[goals]) / self._nominal[goals]
            step = np.zeros(len(w))
            step[columns] = scale * (free @ np.linalg.lstsq(free[rows], missing, rcond=RANK)[0])
            if not free.size or self._size(step, w) < NEAR:
                break
            for part in (1.0, 0.5, 0.25, 0.125):
                trial = w + part * step
                if self._correct(trial, columns, target.keys(), self._size(part * step, w)) and (
                    np.linalg.norm((values - trial[goals]) / self._nominal[goals]) < np.linalg.norm(missing)
                ):
                    break
            else:
                break
            w = trial
        return w

    def completing(self, w: np.ndarray, fixed: Set[int], some: Set[int]) -> list[int]:
        """Return symbols below the highest derivatives that, with `some`, determine all free directions."""
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
        """Return the positions of the symbols that can change without violating the equations."""
        columns = self._free(fixed)
        free = self._null_space(w, columns)
        return [int(n) for n, row in zip(columns, free, strict=True) if np.max(np.abs(row), initial=0.0) > FREE]

    def _null_space(self, w: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """Return orthonormal directions (columns, k), in nominals, along which the equations stay satisfied."""
        a = self(w)[1][:, columns] * self._nominal[columns]
        if not a.size:
            return np.eye(columns.size)
        q, r, _ = pivoted_qr(a.T)
        size = np.abs(np.diag(r))
        return q[:, int(np.sum(size > RANK * np.max(size, initial=0.0))) :]

    def _free(self, fixed: Set[int]) -> np.ndarray:
        return np.array([n for n in range(len(self._plan.pairs)) if n not in fixed], dtype=int)

    def straight(self, w: np.ndarray, fixed: Mapping[int, float]) -> tuple[np.ndarray, int | None]:
        """Return the point that Newton's method reaches from w without continuation, and the first stage that it cannot
        solve; None if it solves all."""
        w, columns = w.copy(), self._free(fixed.keys())
        w[list(fixed)] = list(fixed.values())
        with np.errstate(all="ignore"):
            stages = range(len(self._counts))
            return w, next((n for n in stages if not self._solve(w, columns, set(), np.inf, n)), None)

    def contradiction(self, w: np.ndarray, stage: int, fixed: Mapping[int, float]) -> str:
        """Return the message about the equations and prescribed values in contradiction, for a stage that Newton's
        method cannot solve."""
        r, jacobian = self(w, self._counts[stage])
        flat, labels = self._plan.flat, self._labels()
        if not np.all(np.isfinite(jacobian)) and np.all(np.isfinite(self._f(w)[0])):
            names = "; ".join(labels[i] for i in np.flatnonzero(~np.all(np.isfinite(jacobian), axis=1))[:3])
            return (
                f"{flat.title}: at the start values {names} has a derivative that is not finite; set other start "
                "values, or use a smooth expression"
            )
        if not np.all(np.isfinite(r)):
            names = ", ".join(labels[i] for i in np.flatnonzero(~np.isfinite(r))[:3])
            return f"{flat.title}: at the start values {names} is not finite; set other start values"
        worst = int(np.argmax(np.abs(r)))
        raw = float(np.abs(self._f(w)[0].reshape(-1)[worst]))
        equations = [
            labels[i] for i in np.argsort(-np.abs(r), kind="stable")[:3] if np.abs(r[i]) > 0.1 * np.abs(r[worst])
        ]
        # at a least-squares point the gradient shows the prescribed values in contradiction
        pull = np.abs(jacobian.T @ r) * np.maximum(np.abs(w), self._nominal)
        strongest = max((pull[n] for n in fixed), default=0.0)
        names = [
            f"{flat.symbol_name(*self._plan.pairs[n])} = {fixed[n]:g}"
            for n in sorted(fixed)
            if pull[n] > 1e-3 * strongest
        ]
        rest = f" and {len(names) - 8} more" if len(names) > 8 else ""
        at_fault = f"with the prescribed {', '.join(names[:8])}{rest}" if names else "from the start values"
        advice = "prescribe fewer of them, or correct them" if names else "set start values near a consistent pose"
        return (
            f"{flat.title}: no consistent start was found {at_fault}: a residual of {raw:.3g} remains in "
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
    """Return (held, guess) by kept symbol: fixed starts and the caller's values are held, other starts are guesses.

    `given` maps names such as "T", "der(q)", "x" to values of their shape, or one number for all entries; it overrides
    start attributes. `inputs` are indices of known variables, which cannot have start values.

    Raises ModelError for a wrong name or shape, and for different values of one quantity.
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
                raise ModelError(f"the start of '{name}' must be numbers; found {reprlib.repr(value)}") from None
            if array.size not in (1, len(indices)):
                raise ModelError(f"the start of '{name}' has {len(indices)} entries; found {array.size}")
            if not np.all(np.isfinite(array)):
                raise ModelError(f"the start of '{name}' must be finite; found {value}")
            if np.any(np.abs(array) > LARGEST):
                size = float(np.max(np.abs(array)))
                raise ModelError(f"the start of '{name}' has size {size:g}; squares of more than {LARGEST:g} overflow")
            for i, x in zip(indices, np.broadcast_to(array, len(indices)), strict=True):
                sign, kept, k = plan.alias.resolve(i, order)
                if kept in known:
                    raise ModelError(
                        f"'{name}' cannot have a start value: '{flat.variables[kept].name}' is an input with its own"
                    )
                value_of = sign * float(x)
                if (kept, k) in names and held[(kept, k)] != value_of:
                    raise ModelError(
                        f"'{names[(kept, k)]}' and '{name}' are the same quantity, but their start values differ"
                    )
                names[(kept, k)] = name
                held[(kept, k)] = value_of
                guess.pop((kept, k), None)
    return held, guess
