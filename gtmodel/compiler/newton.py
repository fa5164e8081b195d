"""Newton blocks on many rows at once, by continuation from a known point, with a status for each row."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import casadi as ca
import numpy as np

from .rows import map_columns

CORRECTIONS = 12
# each correction must be at most a quarter of the last one: then Newton's method is inside its basin of attraction and
# cannot jump to another assembly mode (a Newton-Kantorovich test without constants)
CONTRACTION = 0.25
# corrections this small, in nominals, are round-off of well-scaled equations
CONVERGED = 1e-13
# largest step of an unknown in nominals: less than a quarter turn of an angle, or the distance to another assembly mode
REACH = 0.5
# largest relative deviation of a step from the mean of the tangents at its ends: beyond a fold they differ widely
TRUST = 0.1
# a step shorter than this, in nominals, may contain a corner, as of piecewise linear friction
CORNER = 1e-3
SHORTEST_STEP = 1.0 / 4096
MOST_STEPS = 2000
# number of random points, and relative tolerance, of the test whether a residual is even
EVEN_POINTS = 3
EVEN = 1e-9
# columns at once: their matrices stay in the cache, and memory does not grow with the rows
CHUNK = 4096
# ratio of the smallest to the largest singular value below which a solution is singular: half of the digits are lost
SINGULAR = 1e-8
# the same at a pose of a chain at which corrections do not contract: then it is the cause
NEARLY_SINGULAR = 1e-4


class StartSource(Protocol):
    """Starts for columns that cannot be continued from home."""

    def wanted(self, z: np.ndarray) -> np.ndarray:
        """Return for which columns of solutions z (m, n), NaN without one, another is to be found."""
        ...

    def guesses(self, a: np.ndarray) -> np.ndarray:
        """Return guesses (m, n) for columns of known values a (k, n), NaN where there is none."""
        ...


@dataclass(eq=False)
class NewtonKernel:
    """r(z, a) == 0 for unknown z (m,) and known a (k,), with the known solution (z0, a0).

    `residual`: (z, a) -> r, dr/dz; `sensitivity`: (z, a) -> dr/da. `even`: groups of entries of `a` whose sign may be
    flipped together, as that of a quaternion. `starts`: others than home, for a chain of joints.
    """

    residual: ca.Function
    sensitivity: ca.Function
    z0: np.ndarray
    a0: np.ndarray
    scale: np.ndarray
    label: str
    even: tuple[tuple[int, ...], ...] = ()
    starts: StartSource | None = None

    def __post_init__(self) -> None:
        self.even = tuple(entries for entries in self.even if self._is_even(entries))

    def _is_even(self, entries: tuple[int, ...]) -> bool:
        """Return whether the residual does not change with the sign of these entries."""
        rng, flipped = np.random.default_rng(0), np.ones(len(self.a0))
        flipped[list(entries)] = -1.0
        for _ in range(EVEN_POINTS):
            z, a = (x + rng.standard_normal(len(x)) for x in (self.z0, self.a0))
            first, second = (self.residual(z, signs * a)[0].full() for signs in (1.0, flipped))
            if not np.all(np.abs(first - second) <= EVEN * (1.0 + np.abs(first))):
                return False
        return True

    @property
    def functions(self) -> tuple[ca.Function, ca.Function]:
        """The functions that are evaluated on many rows."""
        return self.residual, self.sensitivity

    def solve(self, a: np.ndarray, guess: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the solutions for columns of a (k, n): z (m, n), converged (n,), singular (n,).

        Continues along the straight line from a0 to a, in as few steps as contraction allows, usually one. A column
        that cannot be reached is tried from other `starts`, and is NaN without a solution. If a guess (m, n) is so near
        that every correction contracts, its solution is used instead.
        """
        n = a.shape[1]
        parts = [
            self._solve(a[:, k : k + CHUNK], None if guess is None else guess[:, k : k + CHUNK])
            for k in range(0, max(n, 1), CHUNK)
        ]
        if len(parts) == 1:
            return parts[0]
        z, converged, singular = zip(*parts, strict=True)
        return np.hstack(z), np.hstack(converged), np.hstack(singular)

    def _solve(self, a: np.ndarray, guess: np.ndarray | None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Solve one chunk of columns."""
        a = self._with_home_signs(np.ascontiguousarray(a))  # the order of sums follows memory, see _sensitivities
        n = a.shape[1]
        z = np.repeat(self.z0[:, None], n, axis=1)
        done = np.zeros(n)
        step = np.ones(n)
        alive = np.all(np.isfinite(a), axis=0)
        way = a - self.a0[:, None]
        tangent = self._tangent(z, np.repeat(self.a0[:, None], n, axis=1), way)
        if guess is not None:
            rows = np.flatnonzero(alive & np.all(np.isfinite(guess), axis=0))
            corrected, good = self._correct(guess[:, rows], a[:, rows])
            z[:, rows[good]] = corrected[:, good]
            done[rows[good]] = 1.0
        for _ in range(MOST_STEPS):
            rows = np.flatnonzero(alive & (done < 1.0))
            if rows.size == 0:
                break
            target = np.minimum(1.0, done[rows] + step[rows])
            known = self.a0[:, None] + target * (a[:, rows] - self.a0[:, None])
            known[:, target == 1.0] = a[:, rows][:, target == 1.0]
            # predict along the tangent: after a jump of the inputs a tiny correction may lead to another solution
            h = target - done[rows]
            prediction = h * tangent[:, rows]
            near = np.all(np.abs(prediction) <= REACH * self.scale[:, None], axis=0)
            corrected, good = self._correct(z[:, rows] + np.where(near, prediction, 0.0), known)
            good &= near
            new_tangent = self._tangent(corrected, known, way[:, rows])
            change = (corrected - z[:, rows]) / self.scale[:, None]
            deviation = change - h / 2 * (tangent[:, rows] + new_tangent) / self.scale[:, None]
            with np.errstate(invalid="ignore"):
                good &= np.max(np.abs(deviation), axis=0) <= TRUST * np.max(np.abs(change), axis=0) + CORNER
            z[:, rows[good]] = corrected[:, good]
            tangent[:, rows[good]] = new_tangent[:, good]
            done[rows[good]] = target[good]
            step[rows[good]] = 2.0 * step[rows[good]]
            step[rows[~good]] = 0.5 * step[rows[~good]]
            alive[rows[~good]] &= step[rows[~good]] >= SHORTEST_STEP
        converged = alive & (done >= 1.0)
        z[:, ~converged] = np.nan
        blocked = np.zeros(n, dtype=bool)
        if self.starts is not None:
            guessed = np.zeros(n, dtype=bool) if guess is None else np.all(np.isfinite(guess), axis=0) & converged
            rows = np.flatnonzero(self.starts.wanted(z) & ~guessed & np.all(np.isfinite(a), axis=0))
            others = self.starts.guesses(a[:, rows])
            corrected, good = self._correct(others, a[:, rows])
            z[:, rows[good]] = corrected[:, good]
            converged[rows[good]] = True
            # a pose was found, but corrections do not contract there
            slow = np.flatnonzero(~good & np.all(np.isfinite(others), axis=0) & ~converged[rows])
            if slow.size:
                _, jacobian = self._evaluate(others[:, slow], a[:, rows[slow]])
                s = np.linalg.svd(jacobian * self.scale, compute_uv=False)
                near = slow[s[:, -1] <= NEARLY_SINGULAR * s[:, 0]]
                z[:, rows[near]], blocked[rows[near]] = others[:, near], True
                converged[rows[near]] = True
        singular = blocked
        ok = np.flatnonzero(converged & ~blocked)
        if ok.size:
            _, jacobian = self._evaluate(z[:, ok], a[:, ok])
            singular[ok] = is_singular(jacobian * self.scale)
        return z, converged, singular

    def _with_home_signs(self, a: np.ndarray) -> np.ndarray:
        """Return `a` with the signs of a0 in even groups: otherwise the path would be half a turn longer."""
        for entries in map(list, self.even):
            signs = np.where(self.a0[entries] @ a[entries] < 0, -1.0, 1.0)
            a = a.copy()
            a[entries] *= signs
        return a

    def _evaluate(self, z: np.ndarray, a: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return residuals (m, n) and Jacobians (n, m, m)."""
        n, m = z.shape[1], z.shape[0]
        r, j = map_columns(self.residual, [z, a])
        return r, j.reshape(m, n, m).transpose(1, 0, 2)

    def _correct(self, z: np.ndarray, a: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Iterate from z; return the points and whether every correction contracted down to round-off."""
        z = z.copy()
        n = z.shape[1]
        last = np.full(n, np.inf)
        running = np.ones(n, dtype=bool)
        good = np.zeros(n, dtype=bool)
        for _ in range(CORRECTIONS):
            rows = np.flatnonzero(running)
            if rows.size == 0:
                break
            r, jacobian = self._evaluate(z[:, rows], a[:, rows])
            step = solve_rows(jacobian * self.scale, -r.T)
            size = np.max(np.abs(step), axis=1)
            most = np.maximum(CONTRACTION * last[rows], 1e3 * CONVERGED)
            bad = ~(size <= np.where(np.isinf(last[rows]), REACH, most))
            stalled = ~bad & (size > 0.5 * last[rows])  # round-off reached
            move = ~bad
            z[:, rows[move]] += self.scale[:, None] * step[move].T
            finished = move & ((size <= CONVERGED) | stalled)
            good[rows[finished]] = True
            running[rows[finished | bad]] = False
            last[rows] = size
        return z, good

    def _tangent(self, z: np.ndarray, a: np.ndarray, way: np.ndarray) -> np.ndarray:
        """Return the derivative of z (m, n) along `way`, a direction of a per column; NaN if dr/dz is singular."""
        _, jacobian = self._evaluate(z, a)
        return solve_rows(jacobian, -np.einsum("mnk,kn->nm", self._sensitivities(z, a), way)).T

    def _sensitivities(self, z: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return dr/da (m, n, k)."""
        n = z.shape[1]
        # contiguous: the order of a sum over the last axis depends on the memory layout
        return np.ascontiguousarray(map_columns(self.sensitivity, [z, a])[0]).reshape(len(z), n, len(a))

    def derivative(self, z: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return dz/da (n, m, k), from the implicit function theorem."""
        n, m, k = z.shape[1], z.shape[0], a.shape[0]
        _, jacobian = self._evaluate(z, a)
        by_a = self._sensitivities(z, a).transpose(1, 0, 2)
        result = np.full((n, m, k), np.nan)
        for i in range(n):
            if np.all(np.isfinite(jacobian[i])) and np.all(np.isfinite(by_a[i])):
                result[i] = -np.linalg.lstsq(jacobian[i], by_a[i], rcond=None)[0]
        return result


def is_singular(matrices: np.ndarray) -> np.ndarray:
    """Return for many small matrices (n, m, m) whether the smallest singular value is below SINGULAR times the largest.

    The determinant decides most cases: the mean of the squares of all singular values but the smallest is at most
    |A|^2 / (m - 1), and a product is largest if its factors are equal.
    """
    m = matrices.shape[1]
    with np.errstate(all="ignore"):
        size = np.einsum("nij,nij->n", matrices, matrices)
        smallest = np.abs(np.linalg.det(matrices)) * (max(m - 1, 1) / size) ** ((m - 1) / 2)
        rest = np.flatnonzero(~(smallest > 2.0 * SINGULAR * np.sqrt(size)))  # factor 2: a margin for round-off
    singular = np.zeros(len(matrices), dtype=bool)
    if rest.size:
        s = np.linalg.svd(matrices[rest], compute_uv=False)
        singular[rest] = ~(s[:, -1] > SINGULAR * s[:, 0])
    return singular


def solve_rows(matrices: np.ndarray, rhs: np.ndarray) -> np.ndarray:
    """Solve many small systems; NaN if a matrix is singular or not finite."""
    result = np.full(rhs.shape, np.nan)
    ok = np.all(np.isfinite(matrices), axis=(1, 2)) & np.all(np.isfinite(rhs), axis=1)
    try:
        if ok.all():
            return np.linalg.solve(matrices, rhs[:, :, None])[:, :, 0]
        result[ok] = np.linalg.solve(matrices[ok], rhs[ok][:, :, None])[:, :, 0]
    except np.linalg.LinAlgError:
        for i in np.flatnonzero(ok):
            try:
                result[i] = np.linalg.solve(matrices[i], rhs[i])
            except np.linalg.LinAlgError:
                continue
    return result
