"""The learning law u(k+1) = Q (u(k) + L e(k)) of Dressler 2012, (7.2) and (7.6), and its rate of convergence."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy

from ...results import ArgumentError
from .lifted import Array, Lifted, identity, shifted, weighted, zero_phase
from .references import RAMP as RAMP

DENSE = 1000  # samples up to which an N x N matrix is faster than repeated filtering
SOLVED = 1e-13  # relative residual of an iterative solution


@dataclass(frozen=True, eq=False)
class LearningLaw:
    """The law u(k+1) = Q (u(k) + L e(k)) with the error e = r - zhat, for one axis. Q, L: maps of signals of a run.

    >>> learning = gt.control.learning
    >>> law = learning.simple_law(825, gain=0.9, shift=5, cutoff=10.0)
    >>> u = law.update(np.zeros(825), np.ones(825))
    >>> u.shape, float(u[0])  # the window of the lead-in starts at zero
    ((825,), 0.0)
    """

    Q: Lifted
    L: Lifted

    def update(self, u: Any, error: Any) -> Array:
        """Return the next input (N,) from the last input and the error of its run."""
        return self.Q(np.asarray(u, float) + self.L(error))

    def map(self, seen: Lifted) -> Lifted:
        """Return Q (I - L seen), the map of the input from run to run; seen: from u to the estimate, F_u + F_y T_uy.

        Dressler 2012, (7.15) and (7.16); the text at Fig. 7.14 prints F_r instead of F_u.
        """
        return self.Q @ (identity(self.Q.size) - self.L @ seen)

    def fixed_point(self, seen: Lifted, first_error: Any) -> Array:
        """Return the limit u (N,) of a converging law, u = Q (u + L e) with e = first_error - seen u.

        first_error: r - zhat of the run with u = 0. Raises ArgumentError if there is no such input.
        """
        step, right = self.map(seen), self.Q(self.L(first_error))
        n = self.Q.size
        if n <= DENSE:
            try:
                return np.linalg.solve(np.eye(n) - step.dense(), right)
            except np.linalg.LinAlgError:
                raise ArgumentError("Q (I - L T) has the eigenvalue 1: there is no fixed point", "seen") from None
        rest = identity(n) - step
        u, info = scipy.sparse.linalg.gmres(rest.operator(), right, rtol=SOLVED, atol=0.0, restart=200, maxiter=20)
        if info != 0:
            raise ArgumentError("GMRES did not reach the fixed point; the law hardly contracts", "seen")
        return u


def ramp_weights(ramp: int = RAMP, tukey: float = 0.95) -> Array:
    """Return w (ramp,) of Dressler 2012, (7.12): the first half of a Tukey window, alpha = 0.95 (section 7.3).

    >>> w = gt.control.learning.ramp_weights()
    >>> len(w), float(w[0]), float(w[-1])
    (100, 0.0, 1.0)
    """
    return np.asarray(scipy.signal.windows.tukey(2 * ramp, tukey))[:ramp]


def input_window(size: int, ramp: int = RAMP, tukey: float = 0.95) -> Array:
    """Return the diagonal (size,) of Q_w, Dressler 2012, (7.14): rising in the lead-in, 1, falling in the lead-out.

    Raises ArgumentError if the run is not longer than lead-in and lead-out together.

    >>> learning = gt.control.learning
    >>> w = learning.input_window(825)
    >>> int(np.sum(w == 1.0)) >= 625, float(w[0]), bool(np.all(w == w[::-1]))
    (True, 0.0, True)
    """
    if size <= 2 * ramp:
        raise ArgumentError(
            f"the run has {size} samples; lead-in and lead-out need {2 * ramp}: use a longer run", "size"
        )
    w = ramp_weights(ramp, tukey)
    return np.concatenate([w, np.ones(size - 2 * ramp), w[::-1]])


def butterworth(cutoff: float, sample_time: float, order: int = 2) -> Array:
    """Return the sections (n, 6) of a low pass. cutoff: [Hz]. Raises ArgumentError above half the sampling rate."""
    if not 0 < cutoff < 0.5 / sample_time:
        raise ArgumentError(f"expected a cutoff above 0 and below {0.5 / sample_time:g} Hz; found {cutoff:g}", "cutoff")
    return np.asarray(scipy.signal.butter(order, cutoff, fs=1 / sample_time, output="sos"))


def simple_law(
    size: int, gain: float, shift: int, cutoff: float, *, sample_time: float = 0.004, ramp: int = RAMP, order: int = 2
) -> LearningLaw:
    """Return the law of case 1, Dressler 2012, 7.4: L = gain q^shift, Q = Q_w Qb' Qb with a Butterworth low pass.

    cutoff: [Hz]. ramp: samples of lead-in and lead-out; 0: without Q_w. Raises ArgumentError if numbers are out of
    range.

    >>> learning = gt.control.learning
    >>> law = learning.simple_law(825, gain=0.9, shift=5, cutoff=10.0)
    >>> law.Q.size
    825
    """
    Q = zero_phase(butterworth(cutoff, sample_time, order), size)
    window = weighted(input_window(size, ramp)) if ramp else identity(size)
    return LearningLaw(window @ Q, shifted(size, gain, shift))


TOLERANCE = 1e-10  # relative, of the squared singular value by Lanczos
VECTORS = 80  # of the Krylov space: the largest singular values of long runs are close together


def largest_gain(step: Lifted, *, dense: bool | None = None) -> float:
    """Return sigma, the largest singular value of a map: Dressler 2012, (7.16).

    If it is below 1 for Q (I - L T), the input approaches its limit by at least this factor in every run. It bounds the
    change of the **input**; the error may reach a minimum and rise slightly. dense: use the matrix, otherwise Lanczos
    iteration on the map and its adjoint; by default depending on the length.

    >>> learning = gt.control.learning
    >>> law = learning.simple_law(825, gain=0.9, shift=5, cutoff=10.0)
    >>> for b, a in learning.ACTUATORS:  # Dressler 2012, (7.28): 0.90, 0.91, 0.93
    ...     print(round(learning.largest_gain(law.map(learning.lifted(learning.delayed_lag(b, a, 5), 825))), 3))
    0.904
    0.907
    0.93
    """
    if (step.size <= DENSE) if dense is None else dense:
        return float(np.linalg.norm(step.dense(), 2))
    square = step.adjoint @ step
    start = np.random.default_rng(0).normal(size=step.size)  # the same at every call
    value = scipy.sparse.linalg.eigsh(
        square.operator(), k=1, which="LA", tol=TOLERANCE, v0=start, ncv=VECTORS, return_eigenvectors=False
    )
    return float(np.sqrt(value[0]))


def spectral_radius(step: Lifted, *, dense: bool | None = None) -> float:
    """Return rho, the largest modulus of an eigenvalue: a law is stable if and only if rho < 1, Dressler 2012, (7.15).

    dense: as in `largest_gain`; Arnoldi iteration for long runs.

    >>> learning = gt.control.learning
    >>> round(learning.spectral_radius(learning.weighted([0.2, -0.7])), 12)
    0.7
    """
    if (step.size <= DENSE) if dense is None else dense:
        return float(np.abs(np.linalg.eigvals(step.dense())).max())
    start = np.random.default_rng(0).normal(size=step.size)
    values = scipy.sparse.linalg.eigs(
        step.operator(), k=1, which="LM", tol=1e-6, v0=start, ncv=VECTORS, return_eigenvectors=False
    )
    return float(np.abs(values).max())


class Peak(NamedTuple):
    """The largest value of |Q| |1 - L T| over frequency, and its frequency [Hz]."""

    value: float
    frequency: float


def frequency_bound(Q: Any, rest: Any, frequency: Any) -> Peak:
    """Return sup |Q| |1 - L T| from values (k,) at frequencies (k,) [Hz], refined with a parabola.

    sigma of long runs equals this bound; sigma of short runs is below.

    >>> learning = gt.control.learning
    >>> learning.frequency_bound([1.0, 1.0, 0.5], [0.1, 0.8, 0.2], [0.0, 10.0, 20.0]).frequency > 9
    True
    """
    values, f = np.abs(np.asarray(Q)) * np.abs(np.asarray(rest)), np.asarray(frequency, float)
    k = int(np.argmax(values))
    if 0 < k < len(f) - 1:
        a, b, _ = np.polyfit(f[k - 1 : k + 2] - f[k], values[k - 1 : k + 2] - values[k], 2)
        if a < 0:
            x = float(np.clip(-b / (2 * a), f[k - 1] - f[k], f[k + 1] - f[k]))
            return Peak(float(values[k] + b * x + a * x**2), float(f[k] + x))
    return Peak(float(values[k]), float(f[k]))


def frequencies(sample_time: float, count: int = 20001) -> np.ndarray:
    """Return frequencies (count,) from 0 to half the sampling rate [Hz].

    >>> gt.control.learning.frequencies(0.004, count=3).tolist()
    [0.0, 62.5, 125.0]
    """
    return np.linspace(0.0, 0.5 / sample_time, count)
