"""Consistent points: values that satisfy all differentiated equations, computed stage by stage."""

from __future__ import annotations

import warnings
from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeAlias

import casadi as ca
import numpy as np

from ...lang.source import ModelError
from ..flat import FlatModel
from ..matrices import SOLVED, called, left_over

if TYPE_CHECKING:
    import scipy

MAX_TRIES = 60
HOPELESS = 20  # tries without any point after which the search stops
NEWTON_STEPS = 60
POINTS = 5  # number of points from which the nearest is selected
PATIENCE = 10  # steps within which the residual must be halved; slower iterations seldom converge
# residuals are in SI units of equations of order one; Gauss-Newton converges quadratically past this
RESIDUAL_TOLERANCE = 1e-11
# spread of sample points around the declared start values, in nominals: large enough to leave symmetric poses
SPREAD = 0.05
# spread of every second point: with stiff constraints, inconsistent start values lead to another assembly mode
NARROW = 0.005
# weight of variables with a start value: the points stay near the home pose
HELD = 0.1
# steps in which variables without a start value follow those that have one or are known
FOLLOWING_STEPS = 10
# longest step from home to a distant guess, in nominals: an angle makes no extra turn
LONGEST = 0.5
FOLLOWED = 1e-7  # a shorter step ends the iteration
# a step that leaves the domain of a root or a logarithm is halved, down to this fraction
SHORTEST_PART = 1e-12
# largest number of random draws for a start outside the domain
DRAWS = 30
# s; some models have no solution at time 0; not round numbers, at which roots may coincide
OTHER_TIMES = (1.1, 11.3, 0.13, 97.0)
# singular values below this fraction of the largest are free directions
RANK = 1e-10
# number of rows or columns up to which a dense matrix is faster than a sparse one
DENSE = 200

Jacobian: TypeAlias = "np.ndarray | scipy.sparse.csc_matrix"


class _Stage:
    def __init__(self, fun: ca.Function, sparsity: ca.Sparsity) -> None:
        self._fun = fun
        self._shape = sparsity.shape
        self._indices, self._pointers = (np.array(x, dtype=int) for x in (sparsity.row(), sparsity.colind()))
        self._columns = np.repeat(np.arange(self._shape[1]), np.diff(self._pointers))
        self._dense = max(self._shape) <= DENSE

    def __call__(self, w: np.ndarray, p: np.ndarray, time: float) -> tuple[np.ndarray, Jacobian | None]:
        r, values = called(self._fun, w, p, time)
        if not np.all(np.isfinite(r)) or not np.all(np.isfinite(values)):
            return r, None  # outside the domain of a root, or at its edge
        if self._dense:
            jacobian = np.zeros(self._shape)
            jacobian[self._indices, self._columns] = values
            return r, jacobian
        import scipy  # here and below: small systems do not need it, and it is slow to import

        return r, scipy.sparse.csc_matrix((values, self._indices, self._pointers), shape=self._shape)

    def outside(self, w: np.ndarray, p: np.ndarray, time: float) -> np.ndarray:
        """Return which columns occur in a row whose value or derivatives are not finite."""
        r, values = called(self._fun, w, p, time)
        rows = ~np.isfinite(r)
        rows[self._indices[~np.isfinite(values)]] = True
        outside = np.zeros(self._shape[1], dtype=bool)
        outside[self._columns[rows[self._indices]]] = True
        return outside


def _in_columns(jacobian: scipy.sparse.csc_matrix, reach: np.ndarray) -> scipy.sparse.csc_matrix:
    import scipy

    return jacobian @ scipy.sparse.diags(reach)


def _least_norm(jacobian: Jacobian, reach: np.ndarray, r: np.ndarray) -> np.ndarray:
    scaled: Any = jacobian * reach if isinstance(jacobian, np.ndarray) else _in_columns(jacobian, reach)
    rows = np.flatnonzero(abs(scaled).sum(axis=1))
    if len(rows) < len(r):  # equations among symbols that do not move
        scaled, r = (scaled if isinstance(scaled, np.ndarray) else scaled.tocsr())[rows], r[rows]
    step = _through_normal_equations(scaled, r)
    if not np.linalg.norm(scaled @ step + r) <= SOLVED * np.linalg.norm(r):
        dense = scaled if isinstance(scaled, np.ndarray) else scaled.toarray()
        step = np.linalg.lstsq(dense, -r, rcond=RANK)[0]
        residual = dense @ step + r
        if np.linalg.norm(residual) > SOLVED * np.linalg.norm(r):
            step += left_over(dense, -residual, RANK)
    return reach * step


def _through_normal_equations(scaled: Any, r: np.ndarray) -> np.ndarray:
    """Return the least-norm step; NaN if the normal equations are singular."""
    try:
        if isinstance(scaled, np.ndarray):
            return scaled.T @ np.linalg.solve(scaled @ scaled.T, -r)
        import scipy

        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return scaled.T @ scipy.sparse.linalg.splu((scaled @ scaled.T).tocsc()).solve(-r)
    except (RuntimeError, np.linalg.LinAlgError):
        return np.full(scaled.shape[1], np.nan)


@dataclass
class Sampler:
    """Computes consistent points of a differentiated system.

    `pairs` are the chain symbols in order; `stages` the residuals of each stage, positions first; `starts`
    the declared start values by chain symbol; `known` the known variables; `time` [s] of the points;
    `ease` (one per symbol): relative weight of its movement, 1 by default.
    """

    flat: FlatModel
    pairs: list[tuple[int, int]]
    stages: list[ca.SX]
    starts: dict[tuple[int, int], float]
    known: frozenset[int] = frozenset()
    time: float = 0.0
    ease: np.ndarray | None = None

    def __post_init__(self) -> None:
        scope = self.flat.scope
        self.position = {pair: n for n, pair in enumerate(self.pairs)}
        self.w = ca.vertcat(*[scope.symbol(*pair) for pair in self.pairs])
        self._functions = []
        fixed: set[int] = set()
        for residual in self.stages:
            inside = {self.position[p] for p in scope.symbols_in(residual)}
            new = sorted(inside - fixed)
            fixed |= inside
            columns = ca.vertcat(*[self.w[n] for n in new]) if new else ca.SX(0, 1)
            jacobian = ca.jacobian(residual, columns)
            arguments = [self.w, self.flat.p, scope.time]
            fun = ca.Function("stage", arguments, [ca.densify(residual), ca.densify(jacobian.nz[:])])
            self._functions.append((_Stage(fun, jacobian.sparsity()), np.array(new, dtype=int)))
        nominal = [self.flat.variables[index].nominal for index, _ in self.pairs]
        started = np.array([pair in self.starts for pair in self.pairs], dtype=bool)
        self._reach = np.multiply(nominal, np.where(started, HELD, 1.0))
        if self.ease is not None:
            self._reach = self._reach * self.ease
        given = np.array([index in self.known for index, _ in self.pairs], dtype=bool)
        self._followers = [np.multiply(nominal, ~started & ~given), np.multiply(nominal, ~started)]

    def points(self, count: int) -> np.ndarray:
        """Return `count` consistent points near the start values, the nearest first; ModelError if there is none.

        They belong to time 0, or to one of OTHER_TIMES if the equations have no solution at 0; `time` is set to it.
        """
        points, closest = self._points(count)
        clock = self.flat.scope.time.element_hash()
        if not points and any(s.element_hash() == clock for stage in self.stages for s in ca.symvar(stage)):
            for self.time in OTHER_TIMES:
                points, _ = self._points(count)
                if points:
                    break
        if not points:
            points = self._past_guesses(count)
        if not points:
            # a later stage may determine what an earlier one left free: then the system is singular, as its rank shows
            points, _ = replace(self, stages=[ca.vertcat(*self.stages)], time=0.0)._points(count)
        if not points:
            if not np.isfinite(closest):
                self._refuse_numberless()
            raise ModelError(
                f"{self.flat.title}: the equations have no common solution near the start values (closest residual "
                f"{closest:.2g}); check parameters and start values"
            )
        return np.array(sorted(points, key=self._distance))

    def _refuse_numberless(self) -> None:
        """Raise ModelError for an equation that is not finite for any values of its variables."""
        flat, rng = self.flat, np.random.default_rng(0)
        for e in flat.equations:
            symbols = [flat.scope.symbol(*pair) for pair in flat.scope.symbols_in(e.residual)]
            column = ca.vertcat(*symbols) if symbols else ca.SX(0, 1)
            function = ca.Function("equation", [column, flat.p, flat.scope.time], [e.residual])
            draws = [rng.standard_normal(len(symbols)) for _ in range(HOPELESS)]
            if not any(np.isfinite(float(function(x, flat.require_values(), self.time))) for x in draws):
                raise ModelError(
                    f"{flat.title}: {e.label} is not finite for any values of its variables; does it divide by a "
                    "parameter that is 0?", e.where,
                )  # fmt: skip

    def keeps(self, held: Collection[tuple[int, int]]) -> bool:
        """Return whether a consistent point has exactly these start values, with any values of the others."""
        free = np.array([pair not in held for pair in self.pairs])
        trial = replace(self, ease=np.where(free, 1.0, 0.0))
        for seed in range(HOPELESS):
            rng = np.random.default_rng(seed)
            near, far = self.near(rng, 0.0), self.near(rng, seed / 4)
            w = np.where(free, far, near)
            if trial.correct(w) <= RESIDUAL_TOLERANCE:
                return True
        return False

    def _past_guesses(self, count: int) -> list[np.ndarray]:
        """Return points that ignore guesses: first only those of unknown variables, then those of known ones too."""
        fixed = {p: x for p, x in self.starts.items() if p[1] or self.flat.variables[p[0]].fixed}
        fixed_or_known = {p: x for p, x in self.starts.items() if p in fixed or p[0] in self.known}
        for kept in (fixed_or_known, fixed):
            points = replace(self, starts=kept, time=0.0)._points(count)[0] if len(kept) < len(self.starts) else []
            if points:
                self.time = 0.0
                return points
        return []

    def _points(self, count: int) -> tuple[list[np.ndarray], float]:
        """Return up to `count` points, and the smallest residual of the failed tries."""
        points: list[np.ndarray] = []
        closest = np.inf
        for seed in range(MAX_TRIES):
            rng = np.random.default_rng(seed)
            w = self.near(rng, SPREAD if seed % 2 else NARROW)
            self._into_domain(w, rng)
            residual = self.correct(w)
            if residual > RESIDUAL_TOLERANCE:
                closest = min(closest, residual)
                if not points and seed + 1 >= HOPELESS:
                    break
                continue
            points.append(w)
            if len(points) == count:
                break
        return points, closest

    def nearest(self) -> np.ndarray | None:
        """Return the nearest to the start values of a few consistent points, None if there is none."""
        points, _ = self._points(POINTS)
        return min(points, key=self._distance) if points else None

    def residual(self, w: np.ndarray) -> float:
        """Return the largest residual at a point, divided by its largest value if that exceeds 1; infinite outside the
        domain."""
        p, scale = self.flat.require_values(), max(1.0, float(np.max(np.abs(w), initial=0.0)))
        results = [fun(w, p, self.time) for fun, _ in self._functions]
        return (
            max((float(np.max(np.abs(r), initial=0.0)) if j is not None else np.inf for r, j in results), default=0.0)
            / scale
        )

    def _distance(self, w: np.ndarray) -> float:
        """Return the distance of a point from the start values, in nominals."""
        off = [(w[self.position[pair]] - value) / self.flat.variables[pair[0]].nominal
               for pair, value in self.starts.items() if pair in self.position]  # fmt: skip
        return float(np.linalg.norm(off))

    def near(self, rng: np.random.Generator, spread: float) -> np.ndarray:
        """Return start values with noise of `spread` nominals, and noise alone for other variables; the point need not
        be consistent."""
        nominal = [self.flat.variables[index].nominal for index, _ in self.pairs]
        noise = np.multiply(nominal, rng.standard_normal(len(self.pairs)))
        start = np.array([self.starts.get(pair, np.nan) for pair in self.pairs], dtype=float)
        return np.where(np.isnan(start), noise, start + spread * noise)

    def _into_domain(self, w: np.ndarray, rng: np.random.Generator) -> None:
        """Redraw the variables of equations that are not finite: closer to a start value, or anywhere without one."""
        p = self.flat.require_values()
        for fun, new in self._functions:
            spread = np.full(new.size, SPREAD)
            for _ in range(DRAWS):
                outside = fun.outside(w, p, self.time)
                if not outside.any():
                    break
                spread[outside] /= 2
                for n in np.flatnonzero(outside):
                    pair = self.pairs[new[n]]
                    noise = self.flat.variables[pair[0]].nominal * rng.standard_normal()
                    w[new[n]] = self.starts[pair] + spread[n] * noise if pair in self.starts else noise

    def correct(self, w: np.ndarray) -> float:
        """Correct w in place by least-norm Gauss-Newton steps in each stage; return the worst residual."""
        p = self.flat.require_values()
        worst = 0.0
        for fun, new in self._functions:
            norm = np.inf
            first, second = (reach[new] for reach in self._followers)
            for reach in (first,) if np.array_equal(first, second) else (first, second):
                if not np.all(reach):
                    self._follow(fun, new, reach, w, p)
            norms: list[float] = []
            r, jacobian = fun(w, p, self.time)
            for _ in range(NEWTON_STEPS):
                if jacobian is None:
                    return np.inf
                norm = float(np.max(np.abs(r), initial=0.0))
                norms.append(norm)
                if len(norms) > PATIENCE and min(norms[-PATIENCE:]) > 0.5 * min(norms[:-PATIENCE]):
                    return min(norms) / max(1.0, float(np.max(np.abs(w[new]), initial=0.0)))
                if norm <= RESIDUAL_TOLERANCE * 1e-2 or new.size == 0:
                    break
                step = _least_norm(jacobian, self._reach[new], r)
                if np.max(np.abs(step)) <= 1e-15 * (1 + np.max(np.abs(w[new]))):
                    break
                r, jacobian = self._step(fun, new, step, w, p)
            scale = max(1.0, float(np.max(np.abs(w[new]), initial=0.0)))
            worst = max(worst, norm / scale)
            if worst > RESIDUAL_TOLERANCE:
                return worst
        return worst

    def follow(self, w: np.ndarray, free: np.ndarray, wanted: Collection[int]) -> None:
        """Let the symbols with nonzero `free` (one per symbol) follow the others in w, as far as possible: the `wanted`
        ones, by position, and those of the same stages or earlier ones."""
        p, nominal = self.flat.require_values(), np.array([self.flat.variables[i].nominal for i, _ in self.pairs])
        stages = [n for n, (_, new) in enumerate(self._functions) if not set(wanted).isdisjoint(new.tolist())]
        for fun, new in self._functions[: max(stages, default=-1) + 1]:
            if not np.any(free[new]):
                continue
            r, jacobian = fun(w, p, self.time)
            for _ in range(NEWTON_STEPS):
                if jacobian is None:
                    return
                step = _least_norm(jacobian, nominal[new] * free[new], r)
                size = float(np.max(np.abs(step) / np.maximum(nominal[new], np.abs(w[new]))))
                if not np.isfinite(size):
                    return
                r, jacobian = self._step(fun, new, min(1.0, LONGEST / max(size, LONGEST)) * step, w, p)
                if size <= FOLLOWED:
                    break

    def _follow(self, fun: _Stage, new: np.ndarray, reach: np.ndarray, w: np.ndarray, p: np.ndarray) -> None:
        """Let symbols with a nonzero reach follow the others as far as possible: otherwise the nearest solution may be
        a wrong one."""
        if not np.any(reach):
            return
        best = np.inf
        r, jacobian = fun(w, p, self.time)
        for _ in range(FOLLOWING_STEPS):
            if jacobian is None:
                return
            size = float(np.linalg.norm(r))
            if size > 0.9 * best or size <= RESIDUAL_TOLERANCE * 1e-2:
                return
            best = size
            r, jacobian = self._step(fun, new, _least_norm(jacobian, reach, r), w, p)

    def _step(
        self, fun: _Stage, new: np.ndarray, step: np.ndarray, w: np.ndarray, p: np.ndarray
    ) -> tuple[np.ndarray, Jacobian | None]:
        """Change w by the step, or by a fraction of it that stays in the domain; return residual and Jacobian."""
        begin, part = w[new].copy(), 1.0
        while True:
            w[new] = begin + part * step
            r, jacobian = fun(w, p, self.time)
            if jacobian is not None or part <= SHORTEST_PART:
                return r, jacobian
            part /= 2
