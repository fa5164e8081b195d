"""Track solution paths of F(z, t) = 0 from t = 0 to t = 1, all paths of all poses in one batch: Newton's method in a
patch of projective space, and distances between points of projective space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .platform import EQUATIONS, VARIABLES, Array, Real, gradients

SAME = 1e-6  # distance below which two points count as equal, without a radius of uniqueness


def projective_distance(z: Array, w: Array) -> Array:
    """Return the distance of points (..., 8) from the complex line through w (..., 8); both with unit norm."""
    return np.linalg.norm(z - w * np.sum(np.conj(w) * z, axis=-1, keepdims=True), axis=-1)


def distances(z: Array) -> Real:
    """Return the projective distances between points z (..., m, 8), |z| = 1; (..., m, m), the diagonal is infinite."""
    inner = np.conj(z) @ np.swapaxes(z, -1, -2)
    gap = z[..., None, :, :] - inner[..., None] * z[..., :, None, :]
    result = np.linalg.norm(gap, axis=-1)
    i = np.arange(z.shape[-2])
    result[..., i, i] = np.inf
    return result


def distance_to_conjugate(z: Array) -> Real:
    """Return the projective distance (m,) of points z (m, 8), |z| = 1, from their conjugates: zero for a real point."""
    w = np.conj(z)
    return np.linalg.norm(w - z * np.sum(w * w, axis=-1, keepdims=True), axis=-1)


def newton_step(C: Array, z: Array, patch: Array) -> Array:
    """Return the Newton correction (m, 8) of F = C b(z) at z within the patch (m, 8), with constant patch.z."""
    J = C @ gradients(z)
    return solve_rows(J, patch, -0.5 * (J @ z[:, :, None])[..., 0])


def solve_rows(J: Array, patch: Array, right: Array) -> Array:
    """Solve [J; patch] dz = [right; 0] for J (m, 7, 8), patch (m, 8), right (m, 7); NaN if singular."""
    matrix = np.empty((len(J), VARIABLES, VARIABLES), dtype=complex)
    matrix[:, :EQUATIONS] = J
    matrix[:, EQUATIONS] = patch
    full = np.zeros((len(J), VARIABLES, 1), dtype=complex)
    full[:, :EQUATIONS, 0] = right
    try:
        return np.linalg.solve(matrix, full)[..., 0]
    except np.linalg.LinAlgError:  # raised for the whole batch if one matrix is exactly singular
        singular = np.linalg.det(matrix) == 0
        matrix[singular] = np.eye(VARIABLES)
        full[singular] = np.nan
        return np.linalg.solve(matrix, full)[..., 0]


def refined(C: Array, z: Array, iterations: int = 6) -> Array:
    """Return points z (m, 8) after Newton steps on the system C (7, 18) or (m, 7, 18), scaled to |z| = 1."""
    z = z / np.linalg.norm(z, axis=1, keepdims=True)
    C = np.broadcast_to(C, (len(z), *C.shape[-2:]))
    for _ in range(iterations):
        z = z + newton_step(C, z, np.conj(z))
        z = z / np.linalg.norm(z, axis=1, keepdims=True)
    return z


FIRST_STEP = 0.02
LARGEST_STEP = 0.1
SMALLEST_STEP = 1e-9  # a path with a smaller step has failed
FIRST_CORRECTION = 3e-3  # largest first Newton correction of an accepted step; |z| = 1
CONTRACTION = 0.1  # largest ratio of the second correction to the first
LAST_CORRECTION = 1e-7  # largest third correction
EASY_CORRECTION = 1e-5  # a smaller first correction doubles the step
GOOD_STEPS = 4  # accepted steps after which the step grows by half
MOST_STEPS = 2000  # per path


@dataclass(frozen=True)
class Endpoints:
    """Endpoints of the paths: z (m, 8) with |z| = 1, t (m,) in [0, 1] (1 = arrived), steps (m,) tried."""

    z: NDArray[np.complex128]
    t: NDArray[np.float64]
    steps: NDArray[np.intp]

    @property
    def arrived(self) -> NDArray[np.bool_]:
        """Whether each path (m,) reached t = 1."""
        return self.t >= 1.0


def track(line: Array, pose: NDArray[np.intp], z: Array) -> Endpoints:
    """Track paths along their lines.

    Args:
        line: C(t) = C0 + t C1 + t^2 C2 per pose, (n, 3, 7, 18), from `straight_line`.
        pose: (m,) index of the line of each path.
        z: (m, 8) solutions at t = 0.

    Raises no error for any numbers: a path that fails keeps the t that it reached.
    """
    m = len(z)
    z = np.array(z, dtype=complex)
    z /= np.linalg.norm(z, axis=1, keepdims=True)
    t, h = np.zeros(m), np.full(m, FIRST_STEP)
    good, steps = np.zeros(m, dtype=np.intp), np.zeros(m, dtype=np.intp)
    active = np.arange(m)
    while active.size:
        start, step = t[active], np.minimum(h[active], 1.0 - t[active])
        target, accepted, first = _step(line[pose[active]], z[active], start, step)
        steps[active] += 1
        ok = active[accepted]
        z[ok] = target[accepted]
        reached = start[accepted] + step[accepted]
        t[ok] = np.where(reached > 1.0 - 1e-14, 1.0, reached)
        good[ok] += 1
        easy = first[accepted] < EASY_CORRECTION
        grown = np.where(easy, 2.0, np.where(good[ok] >= GOOD_STEPS, 1.5, 1.0))
        good[ok[grown > 1.0]] = 0
        h[ok] = np.minimum(h[ok] * grown, LARGEST_STEP)
        bad = active[~accepted]
        h[bad] = 0.5 * step[~accepted]
        good[bad] = 0
        active = active[(t[active] < 1.0) & (h[active] >= SMALLEST_STEP) & (steps[active] < MOST_STEPS)]
    return Endpoints(z, t, steps)


def _step(line: Array, z: Array, t: Array, h: Array) -> tuple[Array, NDArray[np.bool_], Array]:
    """Take one step on every path; return the new points with |z| = 1, acceptance, and size of the first correction."""
    patch = np.conj(z)
    C0, C1, C2 = line[:, 0], line[:, 1], line[:, 2]

    def system(s: Array) -> Array:
        s = s[:, None, None]
        return C0 + s * (C1 + s * C2)

    def rate(s: Array) -> Array:
        return C1 + (2 * s[:, None, None]) * C2

    def tangent(w: Array, C: Array, dC: Array) -> Array:
        D = gradients(w)
        return solve_rows(C @ D, patch, -0.5 * (dC @ (D @ w[:, :, None]))[..., 0])

    middle, end = t + 0.5 * h, t + h
    Cm, dCm, Ce = system(middle), rate(middle), system(end)
    step = h[:, None]
    with np.errstate(all="ignore"):
        k1 = tangent(z, system(t), rate(t))
        k2 = tangent(z + 0.5 * step * k1, Cm, dCm)
        k3 = tangent(z + 0.5 * step * k2, Cm, dCm)
        k4 = tangent(z + step * k3, Ce, rate(end))
        w = z + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        corrections = []
        for _ in range(3):
            dz = newton_step(Ce, w, patch)
            w = w + dz
            corrections.append(np.linalg.norm(dz, axis=1) / np.linalg.norm(w, axis=1))
        first, second, third = corrections
        accepted = (first < FIRST_CORRECTION) & (third < LAST_CORRECTION)
        accepted &= (second < CONTRACTION * first) | (second < LAST_CORRECTION)
        w = w / np.linalg.norm(w, axis=1, keepdims=True)
    return w, accepted, first
