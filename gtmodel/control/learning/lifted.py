"""Linear maps of whole signals with their adjoints: the lifted form of learning control, with filters, not matrices.

A signal of N samples is a vector (N,), or a column of (N, k). In the lifted form a filter is a matrix, Dressler 2012,
(7.8) and (7.9). Here it is a `Lifted` map that runs the filter; its adjoint runs the filter backward in time from zero
state. Long runs therefore need no N x N matrices.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from ..._pickling import Portable
from ...results import ArgumentError
from .plants import Plant, pulse_response, stable

Array = np.ndarray
Apply = Callable[[Array], Array]
CIRCLE = 1 + 1e-6  # largest modulus of a pole: integrators are rounded to either side of 1
SHORT = 64  # samples up to which a direct sum is faster than an FFT


@dataclass(frozen=True, eq=False)
class Lifted(Portable):
    """A linear map of signals of `size` samples. forward, backward: the map and its adjoint, for columns (size, k).

    Maps are composed like matrices: `Q @ L`, `A + B`, `A - B`, `2.0 * A`, `A.adjoint`, `A(x)`. `dense()` is the matrix,
    `operator()` is for scipy's iterative methods.

    >>> from gtmodel.control import learning
    >>> shift = learning.shifted(5, gain=0.5, shift=2)
    >>> shift(np.arange(5.0)).tolist()  # Dressler 2012, (7.10): the last sample is repeated
    [1.0, 1.5, 2.0, 2.0, 2.0]
    >>> x, y = np.arange(5.0), np.ones(5)
    >>> bool(shift(x) @ y == x @ shift.adjoint(y))
    True
    """

    size: int
    forward: Apply
    backward: Apply

    def __call__(self, x: Any) -> Array:
        """Apply the map to a signal (size,) or columns (size, k). Raises ArgumentError for another length."""
        x = np.asarray(x, float)
        if x.ndim not in (1, 2) or len(x) != self.size:
            raise ArgumentError(f"expected a signal of {self.size} samples; found the shape {x.shape}", "x")
        return self.forward(x[:, None])[:, 0] if x.ndim == 1 else self.forward(x)

    @property
    def adjoint(self) -> Lifted:
        """The transposed map: <A x, y> = <x, A' y>."""
        return Lifted(self.size, self.backward, self.forward)

    def __matmul__(self, other: Lifted) -> Lifted:
        a, b = self, self._like(other)
        return Lifted(self.size, lambda x: a.forward(b.forward(x)), lambda y: b.backward(a.backward(y)))

    def __add__(self, other: Lifted) -> Lifted:
        a, b = self, self._like(other)
        return Lifted(self.size, lambda x: a.forward(x) + b.forward(x), lambda y: a.backward(y) + b.backward(y))

    def __sub__(self, other: Lifted) -> Lifted:
        return self + (-1.0) * other

    def __rmul__(self, factor: float) -> Lifted:
        a = self
        return Lifted(self.size, lambda x: factor * a.forward(x), lambda y: factor * a.backward(y))

    def dense(self) -> Array:
        """Return the matrix (size, size)."""
        return self.forward(np.eye(self.size))

    def operator(self) -> Any:
        """Return the map as a `scipy.sparse.linalg.LinearOperator`."""
        return scipy.sparse.linalg.LinearOperator(
            (self.size, self.size), matvec=lambda x: self(np.ravel(x)), rmatvec=lambda y: self.adjoint(np.ravel(y)),
            matmat=self.forward, rmatmat=self.backward, dtype=float,
        )  # fmt: skip

    def _like(self, other: Lifted) -> Lifted:
        if other.size != self.size:
            raise ArgumentError(f"the maps have different sizes, {self.size} and {other.size} samples", "size")
        return other


def identity(size: int) -> Lifted:
    """Return the identity map.

    >>> gt.control.learning.identity(2)([3.0, 4.0]).tolist()
    [3.0, 4.0]
    """
    return Lifted(size, lambda x: x, lambda y: y)


def weighted(weights: Any) -> Lifted:
    """Return the diagonal map of weights (size,), such as Q_w of Dressler 2012, (7.14).

    >>> gt.control.learning.weighted([0.0, 0.5, 1.0])([2.0, 2.0, 2.0]).tolist()
    [0.0, 1.0, 2.0]
    """
    w = np.asarray(weights, float)[:, None]
    return Lifted(len(w), lambda x: w * x, lambda y: w * y)


def toeplitz(pulse: Any) -> Lifted:
    """Return the lower triangular Toeplitz map of a pulse response (size,): Dressler 2012, (7.9).

    >>> learning = gt.control.learning
    >>> learning.toeplitz([1.0, 0.5, 0.25]).dense().tolist()
    [[1.0, 0.0, 0.0], [0.5, 1.0, 0.0], [0.25, 0.5, 1.0]]
    """
    g = np.asarray(pulse, float)
    n = len(g)
    product = _convolution(g, n)

    def forward(x: Array) -> Array:
        if n <= SHORT:
            rows = np.subtract.outer(np.arange(n), np.arange(n))
            return np.where(rows >= 0, g[np.abs(rows)], 0.0) @ x
        return product(x)[:n]

    return Lifted(n, forward, lambda y: forward(y[::-1])[::-1])


def _convolution(g: Array, size: int) -> Apply:
    """Return the convolution of columns (size, k) with g. `scipy.signal.fftconvolve` transforms g anew in each call."""
    count = scipy.fft.next_fast_len(len(g) + size - 1, real=True)
    spectrum = scipy.fft.rfft(g, count)[:, None]
    return lambda x: scipy.fft.irfft(spectrum * scipy.fft.rfft(x, count, axis=0), count, axis=0)


def lifted(plant: Plant, size: int) -> Lifted:
    """Return the map of a plant with one input and one output, from rest: Dressler 2012, (7.5) and (7.9).

    plant: `SampledSystem`, or discrete-time `control.StateSpace` or `TransferFunction`. Raises ArgumentError as
    `pulse_response`, and for a pole outside the unit circle, because rounding errors of the FFT scale with the largest
    sample.

    >>> learning = gt.control.learning
    >>> learning.lifted(learning.delayed_lag(0.5, 0.5, delay=1), 3).dense().tolist()
    [[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [0.25, 0.5, 0.0]]
    """
    return toeplitz(pulse_response(stable(plant, CIRCLE), size))


def shifted(size: int, gain: float, shift: int) -> Lifted:
    """Return L = gain q^shift of Dressler 2012, (7.10): the signal `shift` samples later, its last sample repeated.

    Raises ArgumentError if the shift is negative or not shorter than the signal.

    >>> gt.control.learning.shifted(3, gain=0.9, shift=1).dense().tolist()
    [[0.0, 0.9, 0.0], [0.0, 0.0, 0.9], [0.0, 0.0, 0.9]]
    """
    if not 0 <= shift < size:
        raise ArgumentError(f"must be 0 to {size - 1} for {size} samples; found {shift}", "shift")
    later = np.minimum(np.arange(size) + shift, size - 1)

    def backward(y: Array) -> Array:
        x = np.zeros_like(y)
        x[shift:] = y[: size - shift]
        x[-1] += y[size - shift :].sum(axis=0)
        return gain * x

    return Lifted(size, lambda x: gain * x[later], backward)


def filtered(sections: Any, size: int) -> Lifted:
    """Return the map of a causal filter of second-order sections (scipy's `sos`) from zero state.

    >>> learning = gt.control.learning
    >>> learning.filtered([[0.5, 0.5, 0.0, 1.0, 0.0, 0.0]], 3)([1.0, 1.0, 0.0]).tolist()  # the mean of two samples
    [0.5, 1.0, 0.5]
    """

    def forward(x: Array) -> Array:
        return np.asarray(scipy.signal.sosfilt(sections, x, axis=0))

    return Lifted(size, forward, lambda y: forward(y[::-1])[::-1])


def zero_phase(sections: Any, size: int) -> Lifted:
    """Return Qbar = Qb' Qb of Dressler 2012, (7.11): a filter from zero state, then its adjoint.

    It differs from `filtfilt` at the ends, because `filtfilt` pads the signal.

    >>> Q = gt.control.learning.zero_phase([[0.5, 0.5, 0.0, 1.0, 0.0, 0.0]], 3)  # the mean of two samples
    >>> Q.dense().tolist()
    [[0.5, 0.25, 0.0], [0.25, 0.5, 0.25], [0.0, 0.25, 0.25]]
    """
    causal = filtered(sections, size)
    return causal.adjoint @ causal


def symmetric(taps: Any, size: int) -> Lifted:
    """Return a finite zero-phase filter: taps (m + 1,) at the lags 0 to m and, symmetrically, at negative lags.

    Signals are zero outside their samples. The map is its own adjoint.

    >>> gt.control.learning.symmetric([0.5, 0.25], 3).dense().round(12).tolist()
    [[0.5, 0.25, 0.0], [0.25, 0.5, 0.25], [0.0, 0.25, 0.5]]
    """
    half = np.asarray(taps, float)
    product, m = _convolution(np.concatenate([half[:0:-1], half]), size), len(half) - 1

    def forward(x: Array) -> Array:
        return product(x)[m : m + size]

    return Lifted(size, forward, forward)


def matrix(values: Any) -> Lifted:
    """Return the map of a square matrix (size, size).

    >>> gt.control.learning.matrix([[1.0, 2.0], [0.0, 1.0]])([1.0, 1.0]).tolist()
    [3.0, 1.0]
    """
    M = np.asarray(values, float)
    return Lifted(len(M), lambda x: M @ x, lambda y: M.T @ y)
