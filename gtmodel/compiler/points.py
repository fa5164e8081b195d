"""Consistent points: numbers that satisfy all differentiated equations, found stage by stage."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np
from scipy.sparse import csc_matrix, diags
from scipy.sparse.linalg import splu

from ..lang.source import ModelError
from .flat import FlatModel

MAX_TRIES = 60
HOPELESS = 20  # tries without any point after which none is expected
NEWTON_STEPS = 60
PATIENCE = 10  # steps that must at least halve the residual; Newton that has not found its way by then seldom does
# residuals are in SI units of equations of order one; Gauss-Newton converges quadratically past this
RESIDUAL_TOLERANCE = 1e-11
# spread of sample points round the declared start values, in nominals: large enough to leave symmetric poses
SPREAD = 0.05
# every second one: where constraints are stiff, start values far from consistent lead to another assembly mode
NARROW = 0.005
# what has a start value gives way this much less than what has none: the points stay near the home pose
HELD = 0.1
# steps in which what has none follows what has one or is known, which waits
FOLLOWING_STEPS = 10
# s; some models have no solution at time 0; no round numbers, where roots may meet
OTHER_TIMES = (1.1, 11.3, 0.13, 97.0)


class _Stage:
    def __init__(self, fun: ca.Function, sparsity: ca.Sparsity) -> None:
        self._fun = fun
        self._shape = sparsity.shape
        self._indices, self._pointers = np.array(sparsity.row()), np.array(sparsity.colind())

    def __call__(self, w: np.ndarray, p: np.ndarray, time: float) -> tuple[np.ndarray, csc_matrix | None]:
        r, values = (np.array(x.nonzeros()) for x in self._fun.call([ca.DM(w), ca.DM(p), ca.DM(time)]))
        if not np.all(np.isfinite(r)) or not np.all(np.isfinite(values)):
            return r, None
        return r, csc_matrix((values, self._indices, self._pointers), shape=self._shape)


def _least_norm(jacobian: csc_matrix, reach: np.ndarray, r: np.ndarray) -> np.ndarray:
    scaled: Any = jacobian @ diags(reach)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            step = scaled.T @ splu((scaled @ scaled.T).tocsc()).solve(-r)
        except RuntimeError:
            step = np.full(len(reach), np.nan)
    left = np.linalg.norm(scaled @ step + r)
    if not left <= 1e-6 * np.linalg.norm(r):
        step = np.linalg.lstsq(scaled.toarray(), -r, rcond=1e-10)[0]
    return reach * step


@dataclass
class Sampler:
    """Makes consistent points of a differentiated system.

    `pairs` are the chain symbols in order; `stages` the residuals of each stage, positions first; `starts`
    the declared start values by chain symbol; `known` the variables that are prescribed; `time` [s] of the points;
    `ease` (one for each symbol) how readily it gives way beside the others, 1 if left out.
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
        """`count` consistent points near the start values, the nearest first. Raises ModelError if there is none.

        They belong to time 0, or where the equations have no solution then to one of OTHER_TIMES, which `time` tells.
        """
        found, closest = self._points(count)
        clock = self.flat.scope.time.element_hash()
        if not found and any(s.element_hash() == clock for stage in self.stages for s in ca.symvar(stage)):
            for self.time in OTHER_TIMES:
                found, _ = self._points(count)
                if found:
                    break
        if not found:
            # a later stage may bind what an earlier one left free: the system is singular then, and its rank tells
            found, _ = replace(self, stages=[ca.vertcat(*self.stages)], time=0.0)._points(count)
        if not found:
            raise ModelError(
                f"{self.flat.title}: the equations have no common solution near the start values (closest residual "
                f"{closest:.2g}); check parameters and start values"
            )
        return np.array(sorted(found, key=self._distance))

    def _points(self, count: int) -> tuple[list[np.ndarray], float]:
        """Up to `count` points, and the smallest residual of the tries that failed."""
        found: list[np.ndarray] = []
        closest = np.inf
        for seed in range(MAX_TRIES):
            w = self._start(np.random.default_rng(seed), SPREAD if seed % 2 else NARROW)
            residual = self.correct(w)
            if residual > RESIDUAL_TOLERANCE:
                closest = min(closest, residual)
                if not found and seed + 1 >= HOPELESS:
                    break
                continue
            found.append(w)
            if len(found) == count:
                break
        return found, closest

    def _distance(self, w: np.ndarray) -> float:
        """How far a point is from the start values, in nominals."""
        off = [(w[self.position[pair]] - value) / self.flat.variables[pair[0]].nominal
               for pair, value in self.starts.items() if pair in self.position]  # fmt: skip
        return float(np.linalg.norm(off))

    def _start(self, rng: np.random.Generator, spread: float) -> np.ndarray:
        w = np.empty(len(self.pairs))
        for n, pair in enumerate(self.pairs):
            noise = self.flat.variables[pair[0]].nominal * rng.standard_normal()
            w[n] = self.starts[pair] + spread * noise if pair in self.starts else noise
        return w

    def correct(self, w: np.ndarray) -> float:
        """Gauss-Newton with least-norm steps in each stage; changes w; returns the worst residual."""
        p = self.flat.require_values()
        worst = 0.0
        for fun, new in self._functions:
            norm = np.inf
            first, second = (reach[new] for reach in self._followers)
            self._follow(fun, new, first, w, p)
            if not np.array_equal(first, second):
                self._follow(fun, new, second, w, p)
            norms: list[float] = []
            for _ in range(NEWTON_STEPS):
                r, jacobian = fun(w, p, self.time)
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
                w[new] += step
            scale = max(1.0, float(np.max(np.abs(w[new]), initial=0.0)))
            worst = max(worst, norm / scale)
            if worst > RESIDUAL_TOLERANCE:
                return worst
        return worst

    def _follow(self, fun: _Stage, new: np.ndarray, reach: np.ndarray, w: np.ndarray, p: np.ndarray) -> None:
        """Let what has a reach follow what has none, as far as it goes: else a wrong solution may be the nearest."""
        if not np.any(reach) or np.all(reach):
            return
        best = np.inf
        for _ in range(FOLLOWING_STEPS):
            r, jacobian = fun(w, p, self.time)
            if jacobian is None:
                return
            size = float(np.linalg.norm(r))
            if size > 0.9 * best or size <= RESIDUAL_TOLERANCE * 1e-2:
                return
            best = size
            w[new] += _least_norm(jacobian, reach, r)
