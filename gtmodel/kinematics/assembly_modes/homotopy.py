"""The straight line between two platforms: coefficients of the leg equations as polynomials in t."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .study import Array, closed_system, leg_rows


@dataclass(frozen=True)
class HomotopyParameters:
    """A platform as 42 free numbers, real or complex, or n of them: A, B (..., 6, 3) and c (..., 6).

    c stands for A.A + B.B - L^2, but is a parameter of its own along a homotopy.
    """

    A: Array
    B: Array
    c: Array

    def system(self) -> Array:
        """The seven equations at these parameters, (..., 7, 18)."""
        return closed_system(leg_rows(self.A, self.B, self.c))

    def of(self, poses: NDArray[np.intp]) -> HomotopyParameters:
        """Some of n platforms."""
        return HomotopyParameters(self.A[poses], self.B[poses], self.c[poses])


def straight_line(start: HomotopyParameters, end: HomotopyParameters) -> Array:
    """Coefficients of the systems C(t) = C0 + t C1 + t^2 C2 between start and end; (n, 3, 7, 18), complex.

    start: one platform, or n; end: n platforms, arrays with a leading axis. The products A B make it quadratic.
    """
    middle = HomotopyParameters(*(0.5 * (a + b) for a, b in zip(_arrays(start), _arrays(end), strict=True)))
    C0, Cm, C1 = np.broadcast_arrays(start.system(), middle.system(), end.system())
    quadratic = 2 * (C0 + C1 - 2 * Cm)
    return np.stack([C0, C1 - C0 - quadratic, quadratic], axis=-3).astype(complex)


def _arrays(parameters: HomotopyParameters) -> tuple[Array, Array, Array]:
    return parameters.A, parameters.B, parameters.c
