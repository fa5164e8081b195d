"""How fast a learning law converges: singular value, spectral radius, and the bound in the frequency domain."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import scipy

from .law import DENSE
from .lifted import Lifted

TOLERANCE = 1e-10  # relative, of the squared singular value by Lanczos
VECTORS = 80  # of the Krylov space: the largest singular values of long runs lie close together


def largest_gain(step: Lifted, *, dense: bool | None = None) -> float:
    """sigma, the largest singular value of a map: Dressler 2012, (7.16).

    Where it is below 1 for Q (I - L T), the input approaches its limit by at least this factor in every run. It bounds
    the change of the **input**; the error may fall to a minimum and rise a little. dense: by the matrix; else by
    Lanczos on the map and its adjoint; by length if left out.

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
    """rho, the largest modulus of an eigenvalue: the law is stable if and only if it is below 1, Dressler 2012, (7.15).

    dense: as of `largest_gain`; by Arnoldi's method for long runs.

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
    """The largest value of |Q| |1 - L T| over frequency, and where [Hz]."""

    value: float
    frequency: float


def frequency_bound(Q: Any, rest: Any, frequency: Any) -> Peak:
    """sup |Q| |1 - L T| over the frequencies (k,) [Hz] at which both are given (k,), refined by a parabola.

    Long runs have their sigma at this bound, short ones below.

    >>> learning = gt.control.learning
    >>> learning.frequency_bound([1.0, 1.0, 0.5], [0.1, 0.8, 0.2], [0.0, 10.0, 20.0]).frequency > 9
    True
    """
    values, f = np.abs(np.asarray(Q)) * np.abs(np.asarray(rest)), np.asarray(frequency, float)
    k = int(np.argmax(values))
    if 0 < k < len(f) - 1:
        a, b, _ = np.polyfit(f[k - 1 : k + 2] - f[k], values[k - 1 : k + 2] - values[k], 2)
        if a < 0:
            at = float(np.clip(-b / (2 * a), f[k - 1] - f[k], f[k + 1] - f[k]))
            return Peak(float(values[k] + b * at + a * at**2), float(f[k] + at))
    return Peak(float(values[k]), float(f[k]))


def frequencies(sample_time: float, count: int = 20001) -> np.ndarray:
    """Frequencies (count,) from 0 to half the sampling rate [Hz].

    >>> gt.control.learning.frequencies(0.004, count=3).tolist()
    [0.0, 62.5, 125.0]
    """
    return np.linspace(0.0, 0.5 / sample_time, count)
