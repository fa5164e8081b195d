"""Matrices of learning control written out by hand, as Dressler 2012, (7.9) to (7.14), prints them."""

from __future__ import annotations

import numpy as np
import scipy

TS = 0.004


def toeplitz(b: list[float], a: list[float], size: int) -> np.ndarray:
    """(7.9) of b(q^-1) / a(q^-1): the pulse response by scipy's lfilter, on the diagonals."""
    pulse = np.zeros(size)
    pulse[0] = 1.0
    return scipy.linalg.toeplitz(scipy.signal.lfilter(b, a, pulse), np.zeros(size))


def actuator(b: float, a: float, size: int) -> np.ndarray:
    """(6.11) in lifted form."""
    return toeplitz([0.0] * 5 + [b], [1.0, -a], size)


def shift(gain: float, samples: int, size: int) -> np.ndarray:
    """(7.10), entry by entry."""
    L = np.zeros((size, size))
    for i in range(size):
        L[i, min(i + samples, size - 1)] += gain
    return L


def low_pass(cutoff: float, size: int) -> np.ndarray:
    """(7.11): Qb' Qb of a Butterworth filter of second order."""
    b, a = scipy.signal.butter(2, cutoff, fs=1 / TS)
    Q = toeplitz(b, a, size)
    return Q.T @ Q


def tukey(size: int, ramp: int = 100, alpha: float = 0.95) -> np.ndarray:
    """(7.14) from the closed form of Harris 1978 for the first half of a window of 2 ramp points."""
    n = np.arange(ramp)
    width = alpha * (2 * ramp - 1) / 2
    w = np.where(n < width, 0.5 * (1 + np.cos(np.pi * (n / width - 1))), 1.0)
    return np.concatenate([w, np.ones(size - 2 * ramp), w[::-1]])
