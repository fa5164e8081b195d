"""Newton blocks on many rows at once, with a status for each: continuation from a known point."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from .rows import map_columns

CORRECTIONS = 12
# each correction must shrink to a quarter of the last: then Newton is inside its basin and cannot jump to
# another assembly mode (a Newton-Kantorovich test without constants)
CONTRACTION = 0.25
# corrections this small, in nominals, are round-off of well-scaled equations
CONVERGED = 1e-13
# and no step moves an unknown further than this many nominals: an angle not by a quarter turn, a quaternion not
# to another assembly
REACH = 0.5
# the way gone agrees with the mean of the tangents at its ends to this part of it: beyond a fold they differ widely
TRUST = 0.1
# a way shorter than this, in nominals, may hold a corner, as of piecewise linear friction
CORNER = 1e-3
SHORTEST_STEP = 1.0 / 4096
MOST_STEPS = 2000
# random points, and part of its size, by which a residual is found to be even
EVEN_POINTS = 3
EVEN = 1e-9
# columns at once: their matrices stay near the core, and memory does not grow with the rows
CHUNK = 4096
# smallest over largest singular value below which a solution is called singular: half of the digits are lost
SINGULAR = 1e-8


@dataclass(eq=False)
class NewtonKernel:
    """r(z, a) == 0 with z (m,) unknown and a (k,) given; `start` = (z0, a0) solves it.

    `residual`: (z, a) -> r, dr/dz; `sensitivity`: (z, a) -> dr/da. `even`: places in `a` of numbers that mean the same
    with the opposite sign, as all four of a quaternion do.
    """

    residual: ca.Function
    sensitivity: ca.Function
    z0: np.ndarray
    a0: np.ndarray
    scale: np.ndarray
    label: str
    even: tuple[tuple[int, ...], ...] = ()

    def __post_init__(self) -> None:
        self.even = tuple(places for places in self.even if self._is_even(places))

    def _is_even(self, places: tuple[int, ...]) -> bool:
        """Whether the residual is the same with the opposite sign of these numbers."""
        rng, turned = np.random.default_rng(0), np.ones(len(self.a0))
        turned[list(places)] = -1.0
        for _ in range(EVEN_POINTS):
            z, a = (x + rng.standard_normal(len(x)) for x in (self.z0, self.a0))
            here, there = (self.residual(z, signs * a)[0].full() for signs in (1.0, turned))
            if not np.all(np.abs(here - there) <= EVEN * (1.0 + np.abs(here))):
                return False
        return True

    @property
    def functions(self) -> tuple[ca.Function, ca.Function]:
        """What is evaluated on many rows."""
        return self.residual, self.sensitivity

    def solve(self, a: np.ndarray, guess: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Solutions for columns of a (k, n): z (m, n), converged (n,), singular (n,).

        Follows the straight line from a0 to a in as few steps as contraction allows, usually one. A column
        that cannot be reached so keeps NaN. Where a guess (m, n) is so near that every correction contracts, its
        solution is taken instead.
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
        """The same of few enough columns at once."""
        a = self._as_at_home(np.ascontiguousarray(a))  # sums follow the memory, see _by_given
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
            at = self.a0[:, None] + target * (a[:, rows] - self.a0[:, None])
            at[:, target == 1.0] = a[:, rows][:, target == 1.0]
            # along the tangent: a discontinuity of the inputs may land beside another solution with a tiny correction
            h = target - done[rows]
            ahead = h * tangent[:, rows]
            near = np.all(np.abs(ahead) <= REACH * self.scale[:, None], axis=0)
            corrected, good = self._correct(z[:, rows] + np.where(near, ahead, 0.0), at)
            good &= near
            behind = self._tangent(corrected, at, way[:, rows])
            gone = (corrected - z[:, rows]) / self.scale[:, None]
            off = gone - h / 2 * (tangent[:, rows] + behind) / self.scale[:, None]
            with np.errstate(invalid="ignore"):
                good &= np.max(np.abs(off), axis=0) <= TRUST * np.max(np.abs(gone), axis=0) + CORNER
            z[:, rows[good]] = corrected[:, good]
            tangent[:, rows[good]] = behind[:, good]
            done[rows[good]] = target[good]
            step[rows[good]] = 2.0 * step[rows[good]]
            step[rows[~good]] = 0.5 * step[rows[~good]]
            alive[rows[~good]] &= step[rows[~good]] >= SHORTEST_STEP
        converged = alive & (done >= 1.0)
        z[:, ~converged] = np.nan
        singular = np.zeros(n, dtype=bool)
        ok = np.flatnonzero(converged)
        if ok.size:
            _, jacobian = self._evaluate(z[:, ok], a[:, ok])
            singular[ok] = is_singular(jacobian * self.scale)
        return z, converged, singular

    def _as_at_home(self, a: np.ndarray) -> np.ndarray:
        """`a` with the signs of a0 where the opposite ones mean the same: else the way there is half a turn longer."""
        for places in map(list, self.even):
            signs = np.where(self.a0[places] @ a[places] < 0, -1.0, 1.0)
            a = a.copy()
            a[places] *= signs
        return a

    def _evaluate(self, z: np.ndarray, a: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residuals (m, n) and Jacobians (n, m, m)."""
        n, m = z.shape[1], z.shape[0]
        r, j = map_columns(self.residual, [z, a])
        return r, j.reshape(m, n, m).transpose(1, 0, 2)

    def _correct(self, z: np.ndarray, a: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Newton from z; good where every correction contracts until round-off."""
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
        """Change of z (m, n) along `way`, a direction of a for each column; NaN where dr/dz is singular."""
        _, jacobian = self._evaluate(z, a)
        return solve_rows(jacobian, -np.einsum("mnk,kn->nm", self._by_given(z, a), way)).T

    def _by_given(self, z: np.ndarray, a: np.ndarray) -> np.ndarray:
        """dr/da (m, n, k)."""
        n = z.shape[1]
        # row behind row: in which order a sum over the last axis is taken follows the memory
        return np.ascontiguousarray(map_columns(self.sensitivity, [z, a])[0]).reshape(len(z), n, len(a))

    def derivative(self, z: np.ndarray, a: np.ndarray) -> np.ndarray:
        """dz/da (n, m, k) by the implicit function theorem."""
        n, m, k = z.shape[1], z.shape[0], a.shape[0]
        _, jacobian = self._evaluate(z, a)
        by_a = self._by_given(z, a).transpose(1, 0, 2)
        result = np.full((n, m, k), np.nan)
        for i in range(n):
            if np.all(np.isfinite(jacobian[i])) and np.all(np.isfinite(by_a[i])):
                result[i] = -np.linalg.lstsq(jacobian[i], by_a[i], rcond=None)[0]
        return result


def is_singular(matrices: np.ndarray) -> np.ndarray:
    """Of many small matrices (n, m, m): whether the smallest singular value is below a part of the largest one.

    Most are settled by their determinant: the mean of the squares of all values but the smallest is at most
    |A|^2 / (m - 1), and a product is largest where its factors are equal.
    """
    m = matrices.shape[1]
    with np.errstate(all="ignore"):
        size = np.einsum("nij,nij->n", matrices, matrices)
        smallest = np.abs(np.linalg.det(matrices)) * (max(m - 1, 1) / size) ** ((m - 1) / 2)
        rest = np.flatnonzero(~(smallest > 2.0 * SINGULAR * np.sqrt(size)))  # twice: round-off is far from that
    singular = np.zeros(len(matrices), dtype=bool)
    if rest.size:
        s = np.linalg.svd(matrices[rest], compute_uv=False)
        singular[rest] = ~(s[:, -1] > SINGULAR * s[:, 0])
    return singular


def solve_rows(matrices: np.ndarray, rhs: np.ndarray) -> np.ndarray:
    """Solutions of many small systems; NaN where a matrix is singular or not finite."""
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
