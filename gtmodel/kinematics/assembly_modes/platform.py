"""The six legs as the user gives them, and scaled: centred joints, lengths of order one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...lang.source import ModelError
from .homotopy import HomotopyParameters

Real = NDArray[np.float64]
LEGS = 6


@dataclass(frozen=True)
class Legs:
    """The legs of n poses: base joints A (n, 6, 3), platform joints B (n, 6, 3), lengths L (n, 6), one unit."""

    A: Real
    B: Real
    L: Real

    def __len__(self) -> int:
        return len(self.L)

    def __getitem__(self, rows: slice | NDArray[np.intp]) -> Legs:
        return Legs(self.A[rows], self.B[rows], self.L[rows])


@dataclass(frozen=True)
class ScaledLegs:
    """Legs with the centroids of A and of B in the origin, divided by a common size.

    legs: scaled, (n, ...). size: (n,), the largest of the rms length, the rms distance of the base joints from their
    centroid and that of the platform joints. base_centre, platform_centre: (n, 3), unscaled.
    """

    legs: Legs
    size: Real
    base_centre: Real
    platform_centre: Real

    def of(self, i: int) -> ScaledLegs:
        """Pose i alone, still with the leading axis."""
        one = slice(i, i + 1)
        return ScaledLegs(self.legs[one], self.size[one], self.base_centre[one], self.platform_centre[one])

    def parameters(self) -> HomotopyParameters:
        """The coefficients' parameters (A, B, c) of the scaled legs."""
        A, B, L = self.legs.A, self.legs.B, self.legs.L
        return HomotopyParameters(A, B, np.sum(A * A, axis=-1) + np.sum(B * B, axis=-1) - L * L)


def read_legs(A: ArrayLike, B: ArrayLike, L: ArrayLike) -> Legs:
    """Legs of n poses from A, B (n, 6, 3) or (6, 3) and L (n, 6) or (6,); what has no n serves every pose.

    Raises ModelError for a wrong shape, different n, or entries that are not real numbers.
    """
    joints_A, joints_B = _numbers("A", A, (LEGS, 3)), _numbers("B", B, (LEGS, 3))
    lengths = _numbers("L", L, (LEGS,))
    counts = {
        len(a) for a, one in ((joints_A, (LEGS, 3)), (joints_B, (LEGS, 3)), (lengths, (LEGS,))) if a.ndim > len(one)
    }
    if len(counts) > 1:
        raise ModelError(f"A, B and L must be of as many poses each; found {', '.join(map(str, sorted(counts)))}")
    n = counts.pop() if counts else 1
    return Legs(
        np.broadcast_to(joints_A, (n, LEGS, 3)),
        np.broadcast_to(joints_B, (n, LEGS, 3)),
        np.broadcast_to(lengths, (n, LEGS)),
    )


def _numbers(name: str, value: ArrayLike, one: tuple[int, ...]) -> Real:
    try:
        array = np.asarray(value)
        if np.iscomplexobj(array):
            raise ValueError("complex")
        array = array.astype(float)
    except (TypeError, ValueError):
        raise ModelError(f"{name} must hold real numbers in an array of shape {one} or (n, {str(one)[1:]}") from None
    if array.shape != one and array.shape[1:] != one:
        raise ModelError(
            f"{name} has shape {array.shape}; expected {one} for six legs, or (n, {str(one)[1:]} for n poses"
        )
    return array


def scale(legs: Legs) -> ScaledLegs:
    """Centre and scale; the input must be finite and of positive length."""
    base, platform = legs.A.mean(axis=1), legs.B.mean(axis=1)
    A, B = legs.A - base[:, None], legs.B - platform[:, None]
    size = np.sqrt(
        np.max(
            [
                np.mean(legs.L**2, axis=1),
                np.mean(np.sum(A * A, axis=2), axis=1),
                np.mean(np.sum(B * B, axis=2), axis=1),
            ],
            axis=0,
        )
    )
    s = size[:, None, None]
    return ScaledLegs(Legs(A / s, B / s, legs.L / size[:, None]), size, base, platform)


def fault(A: Real, B: Real, L: Real) -> str | None:
    """What forbids the legs A, B (6, 3), L (6,) of one pose as input, in a sentence; None when nothing does."""
    for name, values in (("A", A), ("B", B), ("L", L)):
        if not np.all(np.isfinite(values)):
            leg = int(np.argmax(~np.isfinite(values.reshape(LEGS, -1)).all(axis=1)))
            return f"{name} of leg {leg + 1} is not a finite number"
    if np.any(L <= 0):
        leg = int(np.argmin(L))
        return f"the length of leg {leg + 1} is {L[leg]:g}; a length must be positive (lengths, not their squares)"
    for i in range(LEGS):
        for j in range(i + 1, LEGS):
            if np.array_equal(A[i], A[j]) and np.array_equal(B[i], B[j]):
                return f"legs {i + 1} and {j + 1} join the same two points: five legs do not hold a platform"
    return None
