"""Oscillators over the redundant angle from a few known angles."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import scipy
from numpy.typing import ArrayLike

from .oscillators import Oscillators

ROUNDING = 1e-9  # rad, of an angle given in degrees


class AngleTable:
    """Oscillators that are known at angles (n,) [rad]; between these, monotone cubics through log m, log c and log k.

    Angles are the same after whole turns. Beyond the first and last angle nothing is known. Raises ValueError for fewer
    than two angles or unequal numbers.

    >>> robots = gt.milling.Oscillators.with_damping_ratio([[350] * 3] * 2, [[2e6] * 3, [1.5e6] * 3], [[0.03] * 3] * 2)
    >>> table = gt.milling.AngleTable(np.radians([0.0, 60.0]), robots)
    >>> table.at(np.radians(30.0)).k.round(-3)
    array([[1732000., 1732000., 1732000.]])
    >>> table.covers(np.radians([30.0, 90.0]))
    array([ True, False])
    """

    def __init__(self, angles: ArrayLike, oscillators: Oscillators) -> None:
        angles = np.asarray(angles, float).ravel()
        if len(angles) != len(oscillators) or len(angles) < 2:
            raise ValueError(
                f"found {len(angles)} angles for {len(oscillators)} oscillators; expected two or more each"
            )
        order = np.argsort(angles)
        if np.any(np.diff(angles[order]) <= 0):
            raise ValueError("the same angle stands twice; expected different angles")
        if angles[order[-1]] - angles[order[0]] > 2 * np.pi + ROUNDING:
            low, high = np.rad2deg(angles[order[[0, -1]]])
            raise ValueError(f"the angles run from {low:g} to {high:g} deg; expected one turn of 360 deg at most")
        self.angles = angles[order]
        o = oscillators[order]
        self._curve = scipy.interpolate.PchipInterpolator(
            self.angles, np.log(np.hstack([o.m, o.c, o.k])), extrapolate=False
        )

    def covers(self, angles: ArrayLike) -> np.ndarray:
        """(n,) whether these angles [rad] lie within the table."""
        return self.turned(angles) <= self.angles[-1] + ROUNDING

    def turned(self, angles: ArrayLike) -> np.ndarray:
        """The same angles (n,) [rad], by whole turns, from the first of the table to one turn beyond it."""
        a, first = np.asarray(angles, float).ravel(), self.angles[0] - ROUNDING
        return np.where(self._within(a), a, first + (a - first) % (2 * np.pi))

    def _within(self, a: np.ndarray) -> np.ndarray:
        """(n,) whether angles [rad] lie within the table as they are."""
        return (a >= self.angles[0] - ROUNDING) & (a <= self.angles[-1] + ROUNDING)

    def at(self, angles: ArrayLike) -> Oscillators:
        """The oscillators at angles (n,) [rad]. Raises ValueError beyond the table."""
        a = np.asarray(angles, float).ravel()
        if not np.all(self.covers(a)):
            worst = a[~self.covers(a)][0]
            low, high = np.rad2deg(self.angles[[0, -1]])
            raise ValueError(f"the angle {np.rad2deg(worst):g} deg is outside the table, {low:g} to {high:g} deg")
        values = np.exp(self._curve(np.clip(self.turned(a), *self.angles[[0, -1]])))
        return Oscillators(values[:, :3], values[:, 3:6], values[:, 6:])

    def casadi_function(self) -> Any:
        """The same curve as a CasADi function A [rad] -> m, c, k (3 each); beyond its ends the last cubics continue."""
        A = ca.SX.sym("A")
        pieces = []
        for i, knot in enumerate(self.angles[:-1]):
            d = A - knot
            c = self._curve.c[:, i, :]
            pieces.append(((ca.DM(c[0]) * d + ca.DM(c[1])) * d + ca.DM(c[2])) * d + ca.DM(c[3]))
        value = pieces[0]
        for knot, piece in zip(self.angles[1:-1], pieces[1:], strict=True):
            value = ca.if_else(A < knot, value, piece)
        p = ca.exp(value)
        return ca.Function("oscillators", [A], [p[:3], p[3:6], p[6:]], ["A"], ["m", "c", "k"])
