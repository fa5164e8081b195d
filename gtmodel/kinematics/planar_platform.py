"""All assembly modes of a planar platform on three rods: 3-RPR, or 3-RRR with its motors held."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..results.refusal import ArgumentError

HARMONICS = 3  # degree of the resultant in cosine and sine: six solutions
SAMPLES = 32  # more than the unreduced degree of its terms needs
ON_CIRCLE = 1e-3  # distance of a root from the unit circle up to which Newton's method decides
CORRECTIONS = 6
CLOSED = 1e-9  # largest error of a squared length, relative to the largest squared length
SAME = 1e-6  # rad between two solutions


def planar_modes(E: ArrayLike, B: ArrayLike, L: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Return all poses of a planar platform whose corners lie at given distances from three points.

    Args:
        E: fixed ends of the rods (3, 2) [m], the elbows of a 3-RRR. B: corners in the platform's frame (3, 2) [m].
        L: lengths of the rods (3,) [m].

    Returns the origins x (k, 2) [m] and angles (k,) [rad] of the platform, k up to six, sorted by angle in (-pi, pi]:
    |x + R(angle) B_i - E_i| = L_i. The differences of the squared equations are linear in x; the third becomes a
    polynomial of degree six in exp(i angle), whose roots are eigenvalues (Gosselin, Sefrioui, Richard, Mech. Mach.
    Theory 27(2), 1992). A pose where two solutions meet may be missing or stand once.

    Raises ArgumentError for wrong shapes, and for two corners at one point.

    >>> x, angle = gt.kinematics.planar_modes(
    ...     [[0.0, 0.0], [1.0, 0.0], [0.5, 1.0]], [[-0.1, 0.0], [0.1, 0.0], [0.0, 0.1]], [0.5, 0.6, 0.7]
    ... )
    >>> x.round(3).tolist(), angle.round(3).tolist()
    ([[0.388, 0.263], [0.497, 0.276]], [-1.192, 1.255])
    """
    E, B, L = (np.asarray(a, dtype=float) for a in (E, B, L))
    for name, a, shape in (("E", E, (3, 2)), ("B", B, (3, 2)), ("L", L, (3,))):
        if a.shape != shape or not np.all(np.isfinite(a)):
            raise ArgumentError(f"{name} must be finite numbers of shape {shape}; found shape {a.shape}", name)
    if min(np.linalg.norm(B[i] - B[j]) for i, j in ((0, 1), (1, 2), (2, 0))) == 0.0:
        raise ArgumentError("two corners of the platform coincide; the rods of one corner fix it alone", "B")
    size = float(np.max(np.abs(E - E.mean(axis=0))) + np.max(np.abs(B)) + np.max(L))
    e, b, l = (E - E[0]) / size, B / size, L / size
    angles = 2 * np.pi * np.arange(SAMPLES) / SAMPLES
    values = np.fft.fft([_resultant(e, b, l, t) for t in angles]) / SAMPLES
    roots = np.roots([values[k] for k in range(HARMONICS, -HARMONICS - 1, -1)])
    solutions: list[tuple[float, np.ndarray]] = []
    for t in np.angle(roots[np.abs(np.abs(roots) - 1) < ON_CIRCLE]).tolist():
        x, t, error = _corrected(e, b, l, t)
        if error < CLOSED and all(abs(np.angle(np.exp(1j * (t - other)))) > SAME for other, _ in solutions):
            solutions.append((float(np.angle(np.exp(1j * t))), x))
    solutions.sort(key=lambda solution: solution[0])
    return np.array([size * x + E[0] for _, x in solutions]).reshape(-1, 2), np.array([t for t, _ in solutions])


def _terms(e: np.ndarray, b: np.ndarray, l: np.ndarray, angle: float) -> tuple[np.ndarray, np.ndarray]:
    """Return d (3, 2) and m (3,) of |x|^2 + 2 x.d_i + m_i == 0."""
    c, s = np.cos(angle), np.sin(angle)
    d = b @ np.array([[c, s], [-s, c]]) - e
    return d, np.sum(d * d, axis=1) - l * l


def _resultant(e: np.ndarray, b: np.ndarray, l: np.ndarray, angle: float) -> float:
    d, m = _terms(e, b, l, angle)
    (a, f), (g, h) = d[1] - d[0], d[2] - d[0]
    r = (m[0] - m[1:]) / 2
    determinant = a * h - f * g
    x = np.array([r[0] * h - f * r[1], a * r[1] - g * r[0]])  # times the determinant
    return float(x @ x + 2 * determinant * (x @ d[0]) + m[0] * determinant**2)


def _corrected(e: np.ndarray, b: np.ndarray, l: np.ndarray, angle: float) -> tuple[np.ndarray, float, float]:
    """Return x, the angle and the largest error of the three equations, after Newton's corrections."""
    d, m = _terms(e, b, l, angle)
    x = np.linalg.lstsq(d[1:] - d[0], (m[0] - m[1:]) / 2, rcond=None)[0]
    error = np.inf
    for _ in range(CORRECTIONS):
        d, m = _terms(e, b, l, angle)
        residual = x @ x + 2 * d @ x + m
        error = float(np.max(np.abs(residual)))
        along = (x + d) @ np.array([[0.0, 1.0], [-1.0, 0.0]])  # derivative by the angle: 2 (x + d).(d + e) turned
        jacobian = np.column_stack([2 * (x + d), 2 * np.sum(-along * (d + e), axis=1)])
        step = np.linalg.lstsq(jacobian, -residual, rcond=1e-12)[0]
        x, angle = x + step[:2], angle + float(step[2])
    return x, angle, error
