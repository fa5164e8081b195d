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


SETTLED = 1e-9  # Newton correction of |z| = 1 after which, by quadratic convergence, only rounding errors are left


def refined(C: Array, z: Array, iterations: int = 6) -> Array:
    """Refine points z (m, 8) by Newton steps on the system C (7, 18) or (m, 7, 18), each until it is settled, scaled to
    |z| = 1."""
    z = z / np.linalg.norm(z, axis=1, keepdims=True)
    C = np.broadcast_to(C, (len(z), *C.shape[-2:]))
    moving = np.arange(len(z))
    for _ in range(iterations):
        dz = newton_step(C[moving], z[moving], np.conj(z[moving]))
        z[moving] = _unit(z[moving] + dz)
        moving = moving[~(_square(dz) < SETTLED**2)]
        if not moving.size:
            break
    return z


ORDER = 7  # of the power series that predict the next point of a path
LARGEST_STEP = 0.2
SMALLEST_STEP = 1e-9  # a path that needs a smaller step has failed
FIRST_CORRECTION = 3e-3  # largest first Newton correction of an accepted step, |z| = 1
CONTRACTION = 0.1  # largest ratio of the second to the first correction
LAST_CORRECTION = 1e-7  # largest third correction, which the first two give by quadratic convergence
AIM = 3e-4  # first correction that the length of the next step aims at
WITHIN = (
    0.7  # largest step, relative to the estimated distance of the path's nearest singularity in the complex t plane
)
SHORTER = 0.5  # ratio of a step to the rejected step before it
MOST_STEPS = 2000  # per path


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
    """Paths on their way: index, pose and t (m,), series (m, ORDER + 3, 8) from `_Line.corrected`."""

    index: NDArray[np.intp]
    pose: NDArray[np.intp]
    t: Real
    series: Array

    def singularity(self) -> tuple[Array, Real]:
        """Return b (m,), where t + 1 / b estimates the nearest singularity, and the next step (m,).

        All coordinates of a path share its poles and branch points. The coefficients of the series therefore tend to a
        geometric sequence with the ratio b (Fabry's theorem); their deviation from it estimates the prediction's error.
        """
        last = self.series[:, :2]
        products = last @ np.conj(np.swapaxes(last, 1, 2))
        ratio = products[:, 0, 1] / (products[:, 1, 1] + np.finfo(float).tiny)
        size, squared = np.real(products[:, 0, 0]), np.square(np.abs(ratio))
        deviation = np.maximum(size - squared * np.real(products[:, 1, 1]), 1e-12 * size)  # squared
        step = (AIM**2 / (deviation * squared)) ** (0.5 / (ORDER + 1))
        return ratio, np.fmin(np.fmin(step, WITHIN / np.sqrt(squared)), LARGEST_STEP)

    def predicted(self, step: Real, ratio: Array) -> Array:
        """Return the points (m, 8) one step (m,) ahead, |z| = 1: the series, continued as a geometric one."""
        weights = (step[:, None] ** _POWERS).astype(complex)
        weights[:, 0] /= 1.0 - ratio * step
        return _unit((weights[:, None] @ self.series[:, : ORDER + 1])[:, 0])

    def keep(self, rows: NDArray[np.bool_]) -> None:
        """Drop all other paths."""
        self.index, self.pose = self.index[rows], self.pose[rows]
        self.t, self.series = self.t[rows], self.series[rows]


_POWERS = np.arange(ORDER, -1, -1)
_RIGHT = -0.5 * np.eye(EQUATIONS, dtype=complex)


class _Line:
    """The equations F(z, t) = J z / 2 along the lines of all poses; J (m, 7, 8) is linear in z and quadratic in t.

    Products are one for each path, so that the digits of a path do not depend on the other paths.
    """

    def __init__(self, line: Array, paths: int) -> None:
        by_z = np.swapaxes(line[:, :, None] @ gradients(np.eye(VARIABLES)), 3, 4)  # (n, 3, 8, 8, 7)
        n, size = len(line), VARIABLES * EQUATIONS
        self._joined = by_z.reshape(n, 3 * VARIABLES, size)
        self._apart = np.ascontiguousarray(by_z.swapaxes(1, 2)).reshape(n, VARIABLES, 3 * size)
        self._rates = np.empty((paths, ORDER - 1, size), dtype=complex)  # used again at each step

    def corrected(self, z: Array, t: Real, pose: NDArray[np.intp]) -> tuple[Array, Real, Real]:
        """Correct the points z (m, 8), |z| = 1, at t (m,) by two Newton steps and expand the paths there.

        Returns the series (m, ORDER + 3, 8) of the paths about t, the coefficients from the power ORDER down to the
        power 0, which is the point itself, and two zeros; and the squared sizes of both corrections (m,). A path is
        scaled so that its product with the conjugate of its point is constant. The higher coefficients belong to the
        point before the second correction.
        """
        m = len(z)
        powers = np.zeros((m, 3, 3), dtype=complex)  # column k: derivative k of 1, t, t^2, divided by k!
        powers[:, 0, 0] = powers[:, 1, 1] = powers[:, 2, 2] = 1.0
        powers[:, 1, 0], powers[:, 2, 0], powers[:, 2, 1] = t, t * t, 2 * t
        derivatives = np.swapaxes(powers, 1, 2)
        Jt = (derivatives[:, :1] @ self._by_power(z, pose)).reshape(m, VARIABLES, EQUATIONS)
        right = np.swapaxes(-0.5 * (z[:, None] @ Jt), 1, 2)
        dz = solve_rows(np.swapaxes(Jt, 1, 2), np.conj(z), right)[..., 0]
        first, z = _square(dz), _unit(z + dz)

        J = (derivatives @ self._by_power(z, pose)).reshape(m, 3, VARIABLES, EQUATIONS)
        F = z[:, None, None] @ J
        right = np.broadcast_to(_RIGHT, (m, *_RIGHT.shape))
        inverse = np.swapaxes(solve_rows(np.swapaxes(J[:, 0], 1, 2), np.conj(z), right), 1, 2).copy()
        dz = (F[:, 0] @ inverse)[:, 0]
        # J z = 0 at the power k of t - t0, by the symmetry of the equations in z, with their derivatives D_1, D_2 by t:
        # 2 J_0 z_k = -D_1 z_(k-1) - D_2 z_(k-2) - sum of J_i z_(k-i), 0 < i < k. Twice z_0 below adds D_i to J_i.
        series = np.zeros((m, ORDER + 3, VARIABLES), dtype=complex)
        series[:, ORDER] = 2 * z
        rates = self._rates[:m]
        for k in range(1, ORDER + 1):
            known = F[:, k] if k < 3 else 0.0
            if k > 1:
                J_i = rates[:, : k - 1].reshape(m, (k - 1) * VARIABLES, EQUATIONS)
                known = known + series[:, ORDER - k + 1 : ORDER].reshape(m, 1, -1) @ J_i
            np.matmul(known, inverse, out=series[:, ORDER - k : ORDER - k + 1])
            if k < ORDER:
                three = (powers @ series[:, ORDER - k : ORDER - k + 3]).reshape(m, 1, -1)
                self._each(three, self._joined, pose, rates[:, k - 1 : k])
        series[:, ORDER] = z + dz
        return series, first, _square(dz)

    def _by_power(self, z: Array, pose: NDArray[np.intp]) -> Array:
        """Return the factors (m, 3, 56) of 1, t and t^2 in the transposed J at z (m, 8)."""
        out = np.empty((len(z), 1, self._apart.shape[2]), dtype=complex)
        self._each(z[:, None], self._apart, pose, out)
        return out.reshape(len(z), 3, -1)

    def _each(self, rows: Array, tensors: Array, pose: NDArray[np.intp], out: Array) -> None:
        """Write the product of each path's row (m, 1, k) with the tensor of its pose into out; pose: ascending."""
        if len(tensors) == 1:
            np.matmul(rows, tensors[0], out=out)
            return
        edges = np.searchsorted(pose, np.arange(len(tensors) + 1)).tolist()
        for a, b, tensor in zip(edges[:-1], edges[1:], tensors, strict=True):
            np.matmul(rows[a:b], tensor, out=out[a:b])


def _unit(z: Array) -> Array:
    """Return points z (m, 8) with |z| = 1."""
    return z / np.sqrt(_square(z))[:, None]


def _square(z: Array) -> Real:
    """Return |z|^2 of points z (m, 8)."""
    parts = np.ascontiguousarray(z).view(float)
    return np.einsum("mi,mi->m", parts, parts)


def track(line: Array, pose: NDArray[np.intp], z: Array) -> Endpoints:
    """Track paths from t = 0 to t = 1.

    The power series, with one singularity for all coordinates, predicts the next point; two Newton steps correct it
    (after Telen, Van Barel and Verschelde, SIAM J. Sci. Comput. 42 (2020)).

    Args:
        line: C(t) = C0 + t C1 + t^2 C2 per pose, (n, 3, 7, 18), from `straight_line`.
        pose: (m,) index of each path's line, in ascending order.
        z: (m, 8) solutions at t = 0.

    Raises no error for any data: a path that fails keeps the last t that it reached.
    """
    m = len(z)
    equations = _Line(line, m)
    ends = Endpoints(np.empty((m, VARIABLES), dtype=complex), np.zeros(m), np.zeros(m, dtype=np.intp))
    t, steps = np.zeros(m), 0
    with np.errstate(all="ignore"):
        series, _, _ = equations.corrected(_unit(z.astype(complex)), t, pose)
        paths = _Paths(np.arange(m), pose, t, series)
        ratio, h = paths.singularity()
        while paths.index.size:
            step = np.minimum(h, 1.0 - paths.t)
            t = paths.t + step
            t[t > 1.0 - 1e-14] = 1.0
            series, first, second = equations.corrected(paths.predicted(step, ratio), t, paths.pose)
            accepted = (first < FIRST_CORRECTION**2) & (second**3 <= LAST_CORRECTION**2 * first**2)
            accepted &= (second <= CONTRACTION**2 * first) | (second < LAST_CORRECTION**2)
            steps += 1
            if accepted.all():
                paths.t, paths.series = t, series
            else:
                paths.t[accepted], paths.series[accepted] = t[accepted], series[accepted]
            ratio, h = paths.singularity()
            h = np.where(accepted, h, SHORTER * step)
            going = (paths.t < 1.0) & (h >= SMALLEST_STEP) & (steps < MOST_STEPS)
            if not going.all():
                ended = paths.index[~going]
                ends.z[ended] = _unit(paths.series[~going, ORDER])
                ends.t[ended], ends.steps[ended] = paths.t[~going], steps
                paths.keep(going)
                ratio, h = ratio[going], h[going]
    return ends
