"""Modes of M x'' + D x' + K x = f, and what the signs of its matrices mean (Dressler 2012, eq. (6.15))."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ..linear.state_space import frequency_and_damping, second_order
from ..results import ArgumentError

REAL = 1e-9  # relative: imaginary, or real, parts below are rounding
FREE = 1e-7  # of the largest pole: the two poles of a free motion are accurate to the root of rounding only
SYMMETRIC = 1e-9  # relative asymmetry that is rounding
# changes of sign of D and K, the printed ones first
SIGNS = {"as printed": (1, 1), "K flipped": (1, -1), "D flipped": (-1, 1), "D and K flipped": (-1, -1)}


@dataclass(frozen=True, eq=False)
class Modes:
    """Modes of a matrix triple of p coordinates, slowest first.

    `eigenvalues` (p,) of M^-1 K [1/s2]; `frequency_Hz` (p,) = sqrt(abs) / 2 pi, those of det(M lambda + K) = 0 with
    lambda = -eigenvalue; `shapes` (p, p) by column, largest entry 1, complex where eigenvalues are. `poles` (2p,) [1/s]
    of M s^2 + D s + K, with `pole_Hz` = abs / 2 pi and `damping` = -Re / abs. `stable`: all poles left of the
    axis by more than rounding. `notes`: definiteness and signs in sentences.
    """

    eigenvalues: np.ndarray
    frequency_Hz: np.ndarray
    shapes: np.ndarray
    poles: np.ndarray
    notes: tuple[str, ...]

    @property
    def pole_Hz(self) -> np.ndarray:
        """Moduli of the poles over 2 pi (2p,) [Hz]."""
        return frequency_and_damping(self.poles)[0]

    @property
    def damping(self) -> np.ndarray:
        """Damping ratios of the poles (2p,), 0 on the imaginary axis, negative for poles that grow."""
        return np.where(on_axis(self.poles), 0.0, frequency_and_damping(self.poles)[1])

    @property
    def stable(self) -> bool:
        """Whether all poles are left of the imaginary axis by more than rounding."""
        return bool(np.all((np.real(self.poles) < 0) & ~on_axis(self.poles)))


def modes(M: ArrayLike, D: ArrayLike, K: ArrayLike) -> Modes:
    """Modes of M x'' + D x' + K x = 0; M, D, K (p, p) [kg, N.s/m, N/m], of any sign, symmetric or not.

    Nothing is repaired: `notes` say what is not symmetric, not positive definite or unstable. Raises ArgumentError for
    shapes that differ, numbers that are not finite, and a singular M.

    >>> M, D = np.diag([30.0, 12.0]), np.array([[210.0, -60.0], [-60.0, 60.0]])
    >>> K = np.array([[150e3, -90e3], [-90e3, 90e3]])
    >>> m = gt.vibration.modes(M, D, K)
    >>> m.frequency_Hz.round(2), m.stable
    (array([ 5.84, 16.81]), True)
    """
    M, D, K = matrices(M, D, K)
    pairs: Any = scipy.linalg.eig(K, M)
    values, shapes = pairs
    if np.abs(np.imag(values)).max() <= REAL * np.abs(values).max():
        values, shapes = np.real(values), np.real(shapes)
    order = np.argsort(np.abs(values), kind="stable")
    shapes = shapes[:, order]
    shapes = shapes / shapes[np.argmax(np.abs(shapes), axis=0), np.arange(len(M))]
    poles = _sorted(pencil_poles(M, D, K))
    notes = [f"{name} is {definiteness(X)}" for name, X in (("M", M), ("D", D), ("K", K))]
    notes += _signs(values[order], poles)
    return Modes(values[order], np.sqrt(np.abs(values[order])) / (2 * np.pi), shapes, poles, tuple(notes))


def on_axis(poles: np.ndarray) -> np.ndarray:
    """Which poles neither grow nor decay but for rounding: undamped vibrations, and free motions of a body."""
    size = np.abs(poles)
    return (np.abs(np.real(poles)) <= REAL * size) | (size <= FREE * size.max(initial=0.0))


def pencil_poles(M: np.ndarray, D: np.ndarray, K: np.ndarray) -> np.ndarray:
    """Roots (2p,) of det(M s^2 + D s + K) = 0 [1/s]."""
    return np.linalg.eigvals(second_order(M, D, K, M[:, :0])[0])


def definiteness(X: np.ndarray) -> str:
    """In words: x'X x over all x by its symmetric part, its asymmetry, and the eigenvalues of X where they differ."""
    ends = np.linalg.eigvalsh((X + X.T) / 2)
    size = np.abs(ends).max()
    if size == 0 and not np.any(X):
        return "zero"
    if ends[0] > REAL * size:
        text = "positive definite"
    elif ends[-1] < -REAL * size:
        text = "negative definite"
    elif ends[0] >= -REAL * size:
        text = "positive semidefinite"
    elif ends[-1] <= REAL * size:
        text = "negative semidefinite"
    else:
        text = "indefinite"
    if np.abs(X - X.T).max() <= SYMMETRIC * np.abs(X).max():
        return f"symmetric and {text}"
    eigenvalues = ", ".join(_number(v) for v in sorted(np.linalg.eigvals(X), key=lambda v: (v.real, v.imag)))
    return f"not symmetric; its symmetric part is {text}, its eigenvalues are {eigenvalues}"


def matrices(*given: ArrayLike) -> tuple[np.ndarray, ...]:
    """Square matrices of one size, M first. Raises ArgumentError."""
    arrays = tuple(np.asarray(X, float) for X in given)
    shape = arrays[0].shape
    if len(shape) != 2 or shape[0] != shape[1] or shape[0] == 0 or any(X.shape != shape for X in arrays):
        raise ArgumentError(
            f"the matrices have the shapes {', '.join(str(X.shape) for X in arrays)}; expected square ones of one size"
        )
    if not all(np.isfinite(X).all() for X in arrays):
        raise ArgumentError("a matrix holds a number that is not finite; expected finite numbers")
    if np.linalg.cond(arrays[0]) > 1 / np.finfo(float).eps:
        raise ArgumentError("M is singular: a coordinate has no inertia; leave it out, or give its mass")
    return arrays


def _signs(values: np.ndarray, poles: np.ndarray) -> list[str]:
    notes = []
    if np.iscomplexobj(values):
        notes.append("M^-1 K has complex eigenvalues: no undamped modes exist")
    elif np.all(values > 0):
        notes.append("M^-1 K has positive eigenvalues only: every mode is a vibration")
    else:
        n = int(np.sum(values <= 0))
        notes.append(f"M^-1 K has {n} of {len(values)} eigenvalues that are not positive: without damping they diverge")
    held = on_axis(poles)
    unstable, still = poles[(np.real(poles) > 0) & ~held], int(np.sum(held))
    if not unstable.size and not still:
        notes.append("M s^2 + D s + K is stable")
    elif not unstable.size:
        notes.append(f"M s^2 + D s + K is undamped: {still} of {len(poles)} poles neither grow nor decay")
    else:
        growth = np.real(unstable).max()
        notes.append(
            f"M s^2 + D s + K is unstable: {unstable.size} of {len(poles)} poles grow, by up to {growth:.4g} 1/s"
        )
    return notes


def sign_question(M: ArrayLike, D: ArrayLike, K: ArrayLike) -> tuple[str, ...]:
    """Which changes of sign of D, K or both make M s^2 + D s + K stable: one sentence for each, with the poles.

    Source of the question: the printed K of Dressler 2012, eq. (6.15).

    >>> M, D = np.diag([30.0, 12.0]), np.array([[210.0, -60.0], [-60.0, 60.0]])
    >>> K = np.array([[150e3, -90e3], [-90e3, 90e3]])
    >>> gt.vibration.sign_question(M, D, -K)[1]
    'K flipped: stable, poles at 5.837, 16.81 Hz'
    """
    M, D, K = matrices(M, D, K)
    said = []
    for name, (d, k) in SIGNS.items():
        m = modes(M, d * D, k * K)
        at = ", ".join(f"{f:.4g}" for f in _distinct(m.pole_Hz))
        said.append(f"{name}: {'stable' if m.stable else 'unstable'}, poles at {at} Hz")
    return tuple(said)


def _distinct(numbers: np.ndarray) -> Sequence[float]:
    kept: list[float] = []
    for x in sorted(numbers):
        if not kept or x - kept[-1] > 1e-9 * max(x, 1e-300):
            kept.append(float(x))
    return kept


def _sorted(poles: np.ndarray) -> np.ndarray:
    """By modulus, a pair together with the positive imaginary part first."""
    return np.array(sorted(poles, key=lambda s: (round(abs(s), 9), round(s.real, 9), -s.imag)))


def _number(v: complex) -> str:
    return f"{v.real:.5g}" if abs(v.imag) <= REAL * abs(v) else f"{v.real:.5g}{v.imag:+.5g}i"
