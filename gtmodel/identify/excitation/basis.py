"""Families of motions from rest to rest with finitely many unknowns: finite Fourier series and splines.

A motion of d coordinates is x(t) = rows(t) @ c with unknowns c (size, d). In both families velocity and acceleration
are zero at both ends by construction, and the motion ends where it begins, so that it can be repeated.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt
import scipy

from ...results import ArgumentError

Array = np.ndarray
DEGREE = 5  # of the splines: four continuous derivatives, so that forces and their rates are smooth
AT_REST = 3  # equal control points at an end make velocity and acceleration zero there


class Basis(Protocol):
    """A family of motions over one period [s]."""

    @property
    def period(self) -> float: ...

    @property
    def size(self) -> int:
        """Number of unknowns per coordinate."""
        ...

    @property
    def fastest(self) -> float:
        """Shortest time [s] in which the motion can swing back and forth."""
        ...

    def rows(self, times: npt.ArrayLike, order: int = 0) -> Array:
        """(n, size): the derivative of this order at times [s] is rows @ c."""
        ...

    def still(self) -> Array:
        """(size,) unknowns of the constant motion x = 1."""
        ...


@dataclass(frozen=True)
class FourierSeries:
    """x(t) = x0 + sum over k of a_k cos(k w t) + b_k sin(k w t), k = 1 ... harmonics, w = 2 pi / period.

    Rest at the ends requires sum k b_k = 0 and sum k^2 a_k = 0. The unknowns are x0 and the weights of differences of
    neighbouring harmonics, cos(k w t)/k^2 - cos((k + 1) w t)/(k + 1)^2 and sin(k w t)/k - sin((k + 1) w t)/(k + 1),
    each of which is at rest at the ends. The period is in s. Raises ArgumentError if the period is not positive or
    `harmonics` is below 2.

    >>> series = gt.identify.FourierSeries(period=4.0, harmonics=3)
    >>> c = np.array([[1.0], [0.2], [0.0], [0.0], [0.1]])  # x0, two weights of cosines, two of sines
    >>> (series.rows([0.0, 1.0, 4.0]) @ c)[:, 0].round(3)  # position at three instants
    array([1.15 , 1.083, 1.15 ])
    >>> (np.abs(series.rows([0.0, 4.0], order=1) @ c) < 1e-12).tolist()  # at rest at both ends
    [[True], [True]]
    """

    period: float
    harmonics: int = 5

    def __post_init__(self) -> None:
        _positive(self.period)
        if self.harmonics < 2:
            raise ArgumentError(
                f"a Fourier series at rest at its ends needs at least 2 harmonics; found {self.harmonics}"
            )

    @property
    def size(self) -> int:
        return 2 * self.harmonics - 1

    @property
    def fastest(self) -> float:
        return self.period / self.harmonics

    def rows(self, times: npt.ArrayLike, order: int = 0) -> Array:
        k = np.arange(1, self.harmonics + 1)
        w = 2 * np.pi * k / self.period
        phase = np.outer(np.asarray(times, float), w) + order * np.pi / 2  # each derivative adds a quarter turn
        cosine, sine = np.cos(phase) * w**order / k**2, np.sin(phase) * w**order / k
        still = np.full((len(phase), 1), 1.0 if order == 0 else 0.0)
        return np.hstack([still, cosine[:, :-1] - cosine[:, 1:], sine[:, :-1] - sine[:, 1:]])

    def still(self) -> Array:
        return np.eye(self.size)[0]

    def amplitudes(self, c: Array) -> tuple[Array, Array, Array]:
        """x0 (d,), a (harmonics, d) and b (harmonics, d) of unknowns c (size, d)."""
        k = np.arange(1, self.harmonics + 1)[:, None]
        zeros = np.zeros((1, c.shape[1]))
        cosine, sine = np.split(c[1:], 2)
        a, b = (np.vstack([part, zeros]) - np.vstack([zeros, part]) for part in (cosine, sine))
        return c[0].copy(), a / k**2, b / k


@dataclass(frozen=True)
class ClosedSpline:
    """B-spline of degree 5 on `intervals` equal intervals of the period [s].

    Its first and last three control points are one unknown, so that the motion begins and ends at rest. Raises
    ArgumentError if the period is not positive or there are fewer than 2 intervals.

    >>> spline = gt.identify.ClosedSpline(period=4.0, intervals=6)
    >>> spline.size, spline.rows([0.0, 2.0, 4.0]).shape
    (6, (3, 6))
    >>> spline.rows([0.0, 4.0])[:, 0]  # at both ends the first unknown is the place
    array([1., 1.])
    """

    period: float
    intervals: int = 12

    def __post_init__(self) -> None:
        _positive(self.period)
        if self.intervals < 2:
            raise ArgumentError(f"a spline at rest at its ends needs at least 2 intervals; found {self.intervals}")

    @property
    def size(self) -> int:
        return self.intervals + DEGREE - 2 * AT_REST + 1

    @property
    def fastest(self) -> float:
        return 2 * self.period / self.intervals

    def rows(self, times: npt.ArrayLike, order: int = 0) -> Array:
        breaks = np.linspace(0.0, self.period, self.intervals + 1)
        knots = np.concatenate([np.zeros(DEGREE), breaks, np.full(DEGREE, self.period)])
        controls = self.intervals + DEGREE
        tied = np.zeros((controls, self.size))
        tied[:AT_REST, 0] = tied[-AT_REST:, 0] = 1.0
        tied[AT_REST:-AT_REST, 1:] = np.eye(self.size - 1)
        inside = np.clip(np.asarray(times, float), 0.0, self.period)  # 3 * 0.1 is larger than 0.3
        return scipy.interpolate.BSpline(knots, np.eye(controls), DEGREE)(inside, nu=order) @ tied

    def still(self) -> Array:
        return np.ones(self.size)


def _positive(period: float) -> None:
    if not (np.isfinite(period) and period > 0):
        raise ArgumentError(f"the period must be positive and finite; found {period:g} s")
