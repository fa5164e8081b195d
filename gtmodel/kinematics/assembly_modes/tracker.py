"""Tracking of solution paths of F(z, t) = 0 from t = 0 to t = 1, with all paths of all poses in one batch; Newton's
method in a patch of projective space, and distances between points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .platform import EQUATIONS, VARIABLES, Array, Real, gradients

SAME = 1e-6  # distance below which two points without a certificate count as equal


def projective_distance(z: Array, w: Array) -> Array:
    """Return the distance of points z (..., 8) from the complex line through w (..., 8); both with unit norm."""
    return np.linalg.norm(z - w * np.sum(np.conj(w) * z, axis=-1, keepdims=True), axis=-1)


def distances(z: Array) -> Real:
    """Return the projective distances (..., m, m) between points z (..., m, 8), |z| = 1; the diagonal is infinite."""
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
    """Return the Newton correction (m, 8) of F = C b(z) at z within the patch (m, 8): patch.z does not change."""
    J = C @ gradients(z)
    return solve_rows(J, patch, -0.5 * (J @ z[:, :, None]))[..., 0]


def solve_rows(J: Array, patch: Array, right: Array) -> Array:
    """Solve [J; patch] dz = [right; 0] for J (m, 7, 8), patch (m, 8), right (m, 7, k); NaN if singular."""
    matrix = np.empty((len(J), VARIABLES, VARIABLES), dtype=complex)
    matrix[:, :EQUATIONS] = J
    matrix[:, EQUATIONS] = patch
    full = np.zeros((len(J), VARIABLES, right.shape[2]), dtype=complex)
    full[:, :EQUATIONS] = right
    try:
        return np.linalg.solve(matrix, full)
    except np.linalg.LinAlgError:  # raised for the whole batch if one matrix is exactly singular
        singular = np.linalg.det(matrix) == 0
        matrix[singular] = np.eye(VARIABLES)
        full[singular] = np.nan
        return np.linalg.solve(matrix, full)


def refined(C: Array, z: Array, iterations: int = 6) -> Array:
    """Refine points z (m, 8) by Newton steps on the system C (7, 18) or (m, 7, 18), scaled to |z| = 1."""
    z = z / np.linalg.norm(z, axis=1, keepdims=True)
    C = np.broadcast_to(C, (len(z), *C.shape[-2:]))
    for _ in range(iterations):
        z = z + newton_step(C, z, np.conj(z))
        z = z / np.linalg.norm(z, axis=1, keepdims=True)
    return z


FIRST_STEP = 0.02
LARGEST_STEP = 0.1
SMALLEST_STEP = 1e-9  # a path that needs a smaller step has failed
FIRST_CORRECTION = 3e-3  # largest first Newton correction of an accepted step, relative to |z|
CONTRACTION = 0.1  # largest ratio of the second to the first correction
LAST_CORRECTION = 1e-7  # largest third correction, which the first two give by quadratic convergence
AIM = 3e-4  # first correction that the length of the next step aims at
SHRINKING, GROWTH = 0.25, 2.0  # limits of the ratio of two successive steps
MOST_STEPS = 2000  # per path
NODES = 3  # last points of a path, which with their tangents predict the next one
BEFORE = 1e-3  # interval between the first nodes, before the start
FAR = 1.01  # largest |z| within a patch, whose nearest point has |z| = 1: farther away, polynomials predict worse


@dataclass(frozen=True)
class Endpoints:
    """Endpoints of the paths: z (m, 8) with |z| = 1, t (m,) in [0, 1] (1 = arrived), number of steps tried (m,)."""

    z: NDArray[np.complex128]
    t: NDArray[np.float64]
    steps: NDArray[np.intp]

    @property
    def arrived(self) -> NDArray[np.bool_]:
        """Whether each path reached t = 1 (m,)."""
        return self.t >= 1.0


@dataclass
class _Paths:
    """Paths on their way: index and pose (m,), patch (m, 8) with patch.z = 1, and for the last NODES points the times
    (m, NODES), points and tangents (m, NODES, 2, 8)."""

    index: NDArray[np.intp]
    pose: NDArray[np.intp]
    patch: Array
    times: Real
    nodes: Array

    def predicted(self, t: Real) -> Array:
        """Return the values at t (m,) of the polynomials through all points with all tangents."""
        gap = self.times[:, :, None] - self.times[:, None, :]
        gap[:, _SAME, _SAME] = np.inf
        ahead = t[:, None] - self.times
        ratio = ahead[:, None, :] / gap
        ratio[:, _SAME, _SAME] = 1.0
        square = ratio.prod(axis=2) ** 2
        weights = np.empty((len(t), NODES, 2))
        weights[:, :, 1] = square * ahead
        weights[:, :, 0] = square - weights[:, :, 1] * (2.0 / gap).sum(axis=2)
        return (weights.reshape(-1, 1, 2 * NODES) @ self.nodes.reshape(-1, 2 * NODES, VARIABLES))[:, 0]

    def take(self, accepted: NDArray[np.bool_], t: Real, z: Array, tangent: Array) -> None:
        """Add the accepted points as nodes."""
        ok = slice(None) if accepted.all() else np.flatnonzero(accepted)
        self.times[ok, :-1], self.nodes[ok, :-1] = self.times[ok, 1:], self.nodes[ok, 1:]
        self.times[ok, -1], self.nodes[ok, -1, 0], self.nodes[ok, -1, 1] = t[ok], z[ok], tangent[ok]

    def centre(self, far: NDArray[np.intp]) -> None:
        """Move the patches of these paths to their last points. Within a patch, a path is z / (patch.z)."""
        z = self.nodes[far, -1, 0]
        self.patch[far] = np.conj(z) / np.linalg.norm(z, axis=1, keepdims=True)
        points, tangents = self.nodes[far, :, 0], self.nodes[far, :, 1]
        by, rate = ((v @ self.patch[far][:, :, None]) for v in (points, tangents))
        self.nodes[far, :, 0] = points / by
        self.nodes[far, :, 1] = (tangents - points * (rate / by)) / by

    def keep(self, rows: NDArray[np.bool_]) -> None:
        """Drop all other paths."""
        self.index, self.pose, self.patch = self.index[rows], self.pose[rows], self.patch[rows]
        self.times, self.nodes = self.times[rows], self.nodes[rows]


_SAME = np.arange(NODES)


class _Line:
    """The equations F(z, t) = J z / 2 along the lines of all poses; J (m, 7, 8) is linear in z and quadratic in t."""

    def __init__(self, line: Array) -> None:
        by_z = line[:, :, None] @ gradients(np.eye(VARIABLES))  # (n, 3, 8, 7, 8)
        self._tensor = by_z.reshape(len(line), 3 * VARIABLES, EQUATIONS * VARIABLES)

    def _at(self, z: Array, powers: Real, pose: NDArray[np.intp]) -> Array:
        """Return J (k, m, 7, 8) with the powers 1, t, t^2 of t replaced by `powers` (k, m, 3); pose: ascending."""
        # one product for each path, so that the digits do not depend on the other paths
        products = (powers[..., None] * z[:, None, :]).reshape(*powers.shape[:2], 1, 3 * VARIABLES)
        if len(self._tensor) == 1:
            J = products @ self._tensor[0]
        else:
            edges = np.searchsorted(pose, np.arange(len(self._tensor) + 1)).tolist()
            parts = zip(edges[:-1], edges[1:], self._tensor, strict=True)
            J = np.concatenate([products[:, a:b] @ tensor for a, b, tensor in parts], axis=1)
        return J.reshape(*powers.shape[:2], EQUATIONS, VARIABLES)

    def corrected(self, w: Array, t: Real, patch: Array, pose: NDArray[np.intp]) -> tuple[Array, Array, Real, Real]:
        """Return the points (m, 8) after two Newton steps from w at t (m,) within the patch, the tangents, and the
        squared sizes of both corrections (m,). The tangents belong to the points before the second correction."""
        powers = np.zeros((2, len(t), 3))  # and their derivatives
        powers[0, :, 0] = powers[1, :, 1] = 1.0
        powers[0, :, 1], powers[0, :, 2], powers[1, :, 2] = t, t * t, 2 * t
        J = self._at(w, powers[:1], pose)
        dz = solve_rows(J[0], patch, J[0] @ (-0.5 * w[:, :, None]))[..., 0]
        w, first = w + dz, _square(dz)
        J = self._at(w, powers, pose)
        right = (J @ (-0.5 * w[:, :, None]))[..., 0]
        both = solve_rows(J[0], patch, right.transpose(1, 2, 0))
        dz = np.ascontiguousarray(both[..., 0])
        return w + dz, both[..., 1], first, _square(dz)


def _square(z: Array) -> Real:
    """Return |z|^2 of points z (m, 8) in one piece."""
    parts = z.view(float)
    return np.einsum("mi,mi->m", parts, parts)


def track(line: Array, pose: NDArray[np.intp], z: Array) -> Endpoints:
    """Track paths from t = 0 to t = 1.

    A polynomial through the last points with their tangents predicts the next point; two Newton steps correct it.

    Args:
        line: C(t) = C0 + t C1 + t^2 C2 per pose, (n, 3, 7, 18), from `straight_line`.
        pose: (m,) index of each path's line, in ascending order.
        z: (m, 8) solutions at t = 0.

    Raises no error for any data: a path that fails keeps the last t that it reached.
    """
    m = len(z)
    equations = _Line(line)
    ends = Endpoints(np.empty((m, VARIABLES), dtype=complex), np.zeros(m), np.zeros(m, dtype=np.intp))
    h, steps = np.full(m, FIRST_STEP), 0
    with np.errstate(all="ignore"):
        paths = _at_start(equations, pose, z / np.linalg.norm(z, axis=1, keepdims=True))
        while paths.index.size:
            start = paths.times[:, -1]
            step = np.minimum(h, 1.0 - start)
            t = start + step
            t[t > 1.0 - 1e-14] = 1.0
            w, tangent, first, second = equations.corrected(paths.predicted(t), t, paths.patch, paths.pose)
            accepted = (first < FIRST_CORRECTION**2) & (second**3 <= LAST_CORRECTION**2 * first**2)
            accepted &= (second <= CONTRACTION**2 * first) | (second < LAST_CORRECTION**2)
            steps += 1
            # the prediction's error is of the order 2 NODES in the step
            factor = np.fmax(SHRINKING, np.fmin(GROWTH, (AIM**2 / first) ** (0.25 / NODES)))
            h = np.minimum(step * np.where(accepted, factor, np.fmin(factor, 0.5)), LARGEST_STEP)
            paths.take(accepted, t, w, tangent)
            far = np.flatnonzero(accepted & (_square(w) > FAR**2))
            if far.size:
                paths.centre(far)
            going = (paths.times[:, -1] < 1.0) & (h >= SMALLEST_STEP) & (steps < MOST_STEPS)
            if not going.all():
                ended = paths.index[~going]
                z = paths.nodes[~going, -1, 0]
                ends.z[ended] = z / np.linalg.norm(z, axis=1, keepdims=True)
                ends.t[ended], ends.steps[ended] = paths.times[~going, -1], steps
                paths.keep(going)
                h = h[going]
    return ends


def _at_start(equations: _Line, pose: NDArray[np.intp], z: Array) -> _Paths:
    """Return the paths with nodes at the start and just before it."""
    m = len(z)
    times = np.tile(BEFORE * np.arange(1 - NODES, 1.0), (m, 1))
    paths = _Paths(np.arange(m), pose, np.conj(z), times, np.empty((m, NODES, 2, VARIABLES), dtype=complex))
    for k in reversed(range(NODES)):
        z, tangent, _, _ = equations.corrected(z, times[:, k], paths.patch, pose)
        paths.nodes[:, k, 0], paths.nodes[:, k, 1] = z, tangent
        z = z - BEFORE * tangent
    return paths
