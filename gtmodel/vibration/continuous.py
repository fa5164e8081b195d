"""From discrete to continuous time by the matrix logarithm, with its branch checked."""

from __future__ import annotations

import warnings
from typing import NamedTuple

import numpy as np
import scipy

from ..linear.state_space import held
from ..results import ArgumentError
from .record import check_sample_time

NEAR = 0.8  # of the Nyquist frequency: above, these samples alone do not distinguish an alias from the mode
ON_AXIS = 1e-6  # rad: a pole this near the negative real axis has no real logarithm
EXACT = 1e-8  # relative difference allowed between A and the exponential of what was found
ZERO = 1e-12  # modulus of a pole whose logarithm has no meaning


class Continuous(NamedTuple):
    """x' = A x + B u that gives the discrete model under held inputs.

    `message`: a sentence where its fastest pole is near the Nyquist frequency, else empty.
    """

    A: np.ndarray
    B: np.ndarray
    message: str


def continuous(A: np.ndarray, B: np.ndarray, sample_time: float) -> Continuous:
    """A_c = logm(A) / T_s on the principal branch, and B_c of a held input (no approximate inverse of c2d).

    A (n, n), B (n, m), sample_time [s]. The branch takes every pole to lie below the Nyquist frequency; near it
    `message` warns. Raises ArgumentError for a pole at zero or on the negative real axis, and a logarithm that is not
    real or exact.

    >>> model = gt.vibration.continuous(np.array([[0.9]]), np.array([[0.1]]), sample_time=0.004)
    >>> model.A.round(2), model.B.round(2)  # 1/s
    (array([[-26.34]]), array([[26.34]]))
    """
    check_sample_time(sample_time)
    poles = np.linalg.eigvals(A)
    nyquist = 0.5 / sample_time
    if np.abs(poles).min() < ZERO:
        raise ArgumentError("a pole of the model is at zero (a pure delay): it has no continuous form; lower the order")
    if np.any((poles.real < 0) & (np.abs(np.angle(poles)) > np.pi - ON_AXIS)):
        pole = poles[np.argmin(poles.real)].real
        raise ArgumentError(
            f"the pole {pole:.4g} lies on the negative real axis, at the Nyquist frequency {nyquist:g} Hz: no real "
            "continuous model has it, so lower the order or sample faster"
        )
    n, m = B.shape
    with warnings.catch_warnings():
        # its own estimate of the error; what is found is judged below
        warnings.simplefilter("ignore", RuntimeWarning)
        L = np.asarray(scipy.linalg.logm(A))
        # the same logarithm, of the matrix that also holds the input
        whole = np.asarray(scipy.linalg.logm(np.block([[A, B], [np.zeros((m, n)), np.eye(m)]])))
    if np.abs(np.imag(L)).max() > EXACT * np.abs(L).max():
        raise ArgumentError("the matrix logarithm is not real; lower the order or sample faster")
    A_c = np.real(L) / sample_time
    B_c = np.real(whole)[:n, n:] / sample_time
    A_back, B_back = held(A_c, B_c, sample_time)
    error = max(np.abs(A_back - A).max() / np.abs(A).max(), np.abs(B_back - B).max() / max(np.abs(B).max(), 1e-300))
    if error > EXACT:
        raise ArgumentError(
            f"the matrix logarithm is not exact: {error:.2g} is left of 1, expected {EXACT:g}; lower the order"
        )
    fastest = float(np.abs(np.angle(poles)).max() / (2 * np.pi * sample_time))
    said = ""
    if fastest > NEAR * nyquist:
        said = (
            f"a mode at {fastest:.4g} Hz is near the Nyquist frequency of {nyquist:.4g} Hz: these samples cannot tell "
            f"it from one at {2 * nyquist - fastest:.4g} Hz"
        )
    return Continuous(A_c, B_c, said)
