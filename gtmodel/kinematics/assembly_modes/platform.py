"""Platforms on six legs in Study coordinates: scaled leg equations as quadrics in projective 7-space, the straight line
between two platforms, and architecturally singular platforms."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...lang.source import ModelError

Array = NDArray[Any]  # of float or complex numbers

VARIABLES = 8
EQUATIONS = 7  # six legs and x.y = 0; the patch is the eighth
BASIS = 18
MODES = 40  # of a general platform over the complex numbers


def _basis_rows() -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Return index and sign, both (18, 8), of the gradients D(z)[k, i] = sign[k, i] * z[index[k, i]]."""
    index = np.zeros((BASIS, VARIABLES), dtype=np.intp)
    sign = np.zeros((BASIS, VARIABLES))

    def product(k: int, i: int, j: int, factor: float) -> None:
        """Add factor z_i z_j to quadric k; each variable occurs in at most one product of a quadric."""
        index[k, i], index[k, j] = j, i
        sign[k, i] = sign[k, j] = 2 * factor if i == j else factor

    for i in range(4):
        product(0, i, i, 1)
        product(16, 4 + i, 4 + i, 1)
        product(17, i, 4 + i, 1)
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        for k, turn in ((1 + a, 1.0), (4 + a, -1.0)):  # vec(y x*) and vec(x* y) differ in the cross product
            product(k, 5 + a, 0, 1)
            product(k, 4, 1 + a, -1)
            product(k, 5 + b, 1 + c, -turn)
            product(k, 5 + c, 1 + b, turn)
        for i in range(4):
            product(7 + 4 * a, i, i, 1 if i in (0, 1 + a) else -1)
        product(7 + 3 * a + b, 1 + a, 1 + b, 2)
        product(7 + 3 * a + b, 0, 1 + c, -2)
        product(7 + 3 * b + a, 1 + a, 1 + b, 2)
        product(7 + 3 * b + a, 0, 1 + c, 2)
    return index, sign


_INDEX, _SIGN = _basis_rows()


def gradients(z: Array) -> Array:
    """Return D(z) (..., 18, 8), the gradients of the 18 basis quadrics at z (..., 8)."""
    return _SIGN * z[..., _INDEX]


def basis(z: Array) -> Array:
    """Return b(z) (..., 18), the values of the 18 basis quadrics at z (..., 8)."""
    return 0.5 * (gradients(z) @ z[..., None])[..., 0]


def leg_rows(A: Array, B: Array, c: Array) -> Array:
    """Return the coefficients (..., 6, 18) of the leg equations: A, B (..., 6, 3), c = A.A + B.B - L^2 (..., 6)."""
    rows = np.zeros((*c.shape, BASIS), dtype=np.result_type(A, B, c))
    rows[..., 0] = c
    rows[..., 1:4] = -4 * A
    rows[..., 4:7] = 4 * B
    rows[..., 7:16] = -2 * (A[..., :, None] * B[..., None, :]).reshape(*c.shape, 9)
    rows[..., 16] = 4
    return rows


def closed_system(rows: Array) -> Array:
    """Return the seven equations C (..., 7, 18) from leg rows (..., 6, 18): leg 1, legs 2 to 6 minus leg 1, and x.y.

    The differences eliminate the common term y.y, which improves the scaling.
    """
    system = np.zeros((*rows.shape[:-2], EQUATIONS, BASIS), dtype=rows.dtype)
    system[..., 0, :] = rows[..., 0, :]
    system[..., 1:6, :] = rows[..., 1:, :] - rows[..., :1, :]
    system[..., 6, 17] = 1
    return system


def rotation_and_position(z: Array) -> tuple[Array, Array]:
    """Return R (..., 3, 3) and T (..., 3) of points z (..., 8) of any scale; x.x must not be zero."""
    b = basis(z)
    n = b[..., 0, None]
    return (b[..., 7:16] / n).reshape(*b.shape[:-1], 3, 3), 2 * b[..., 1:4] / n


@dataclass(frozen=True)
class HomotopyParameters:
    """The 42 free parameters, real or complex, of one or n platforms: A, B (..., 6, 3) and c (..., 6).

    c is A.A + B.B - L^2, but it is an independent parameter along a homotopy.
    """

    A: Array
    B: Array
    c: Array

    def system(self) -> Array:
        """Return the seven equations (..., 7, 18) at these parameters."""
        return closed_system(leg_rows(self.A, self.B, self.c))

    def of(self, poses: NDArray[np.intp]) -> HomotopyParameters:
        """Return some of the n platforms."""
        return HomotopyParameters(self.A[poses], self.B[poses], self.c[poses])


def straight_line(start: HomotopyParameters, end: HomotopyParameters) -> Array:
    """Return the coefficients (n, 3, 7, 18) of the systems C(t) = C0 + t C1 + t^2 C2 between start and end, complex.

    start: one platform, or n; end: n platforms, arrays with a leading axis. The products A B make C(t) quadratic.
    """
    middle = HomotopyParameters(*(0.5 * (a + b) for a, b in zip(_arrays(start), _arrays(end), strict=True)))
    C0, Cm, C1 = np.broadcast_arrays(start.system(), middle.system(), end.system())
    quadratic = 2 * (C0 + C1 - 2 * Cm)
    return np.stack([C0, C1 - C0 - quadratic, quadratic], axis=-3).astype(complex)


def _arrays(parameters: HomotopyParameters) -> tuple[Array, Array, Array]:
    return parameters.A, parameters.B, parameters.c


Real = NDArray[np.float64]
LEGS = 6


@dataclass(frozen=True)
class Legs:
    """The legs of n poses: base joints A (n, 6, 3), platform joints B (n, 6, 3), lengths L (n, 6), in the same unit."""

    A: Real
    B: Real
    L: Real

    def __len__(self) -> int:
        return len(self.L)

    def __getitem__(self, rows: slice | NDArray[np.intp]) -> Legs:
        return Legs(self.A[rows], self.B[rows], self.L[rows])


@dataclass(frozen=True)
class ScaledLegs:
    """Legs divided by a common size, with the centroids of A and of B at the origin.

    legs: scaled, (n, ...). size: (n,), the largest of the rms leg length and the rms distances of the base joints and
    of the platform joints from their centroids. base_centre, platform_centre: (n, 3), unscaled.
    """

    legs: Legs
    size: Real
    base_centre: Real
    platform_centre: Real

    def of(self, i: int) -> ScaledLegs:
        """Return pose i alone, with the leading axis."""
        row = slice(i, i + 1)
        return ScaledLegs(self.legs[row], self.size[row], self.base_centre[row], self.platform_centre[row])

    def parameters(self) -> HomotopyParameters:
        """Return the parameters (A, B, c) of the scaled legs."""
        A, B, L = self.legs.A, self.legs.B, self.legs.L
        return HomotopyParameters(A, B, np.sum(A * A, axis=-1) + np.sum(B * B, axis=-1) - L * L)


def read_legs(A: ArrayLike, B: ArrayLike, L: ArrayLike) -> Legs:
    """Return the legs of n poses from A, B (n, 6, 3) or (6, 3) and L (n, 6) or (6,); arrays without n are for all.

    Raises ModelError for a wrong shape, different n, or entries that are not real numbers.
    """
    joints_A, joints_B = _numbers("A", A, (LEGS, 3)), _numbers("B", B, (LEGS, 3))
    lengths = _numbers("L", L, (LEGS,))
    counts = {
        len(a) for a, shape in ((joints_A, (LEGS, 3)), (joints_B, (LEGS, 3)), (lengths, (LEGS,))) if a.ndim > len(shape)
    }
    if len(counts) > 1:
        raise ModelError(f"A, B and L must have the same number of poses; found {', '.join(map(str, sorted(counts)))}")
    n = counts.pop() if counts else 1
    return Legs(
        np.broadcast_to(joints_A, (n, LEGS, 3)),
        np.broadcast_to(joints_B, (n, LEGS, 3)),
        np.broadcast_to(lengths, (n, LEGS)),
    )


def _numbers(name: str, value: ArrayLike, shape: tuple[int, ...]) -> Real:
    try:
        array = np.asarray(value)
        if np.iscomplexobj(array):
            raise ValueError("complex")
        array = array.astype(float)
    except (TypeError, ValueError):
        raise ModelError(f"{name} must be an array of real numbers, {shape} or (n, {str(shape)[1:]}") from None
    if array.shape != shape and array.shape[1:] != shape:
        raise ModelError(
            f"{name} has shape {array.shape}; expected {shape} for six legs, or (n, {str(shape)[1:]} for n poses"
        )
    return array


def scale(legs: Legs) -> ScaledLegs:
    """Centre and scale the legs, which must be finite, with positive lengths."""
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
    """Return why the legs A, B (6, 3), L (6,) of one pose are invalid, in a sentence; None if they are valid."""
    for name, values in (("A", A), ("B", B), ("L", L)):
        if not np.all(np.isfinite(values)):
            leg = int(np.argmax(~np.isfinite(values.reshape(LEGS, -1)).all(axis=1)))
            return f"{name} of leg {leg + 1} is not finite"
    if np.any(L <= 0):
        leg = int(np.argmin(L))
        return f"the length of leg {leg + 1} is {L[leg]:g}; a length must be positive (lengths, not their squares)"
    joints = np.concatenate([A, B], axis=1)
    pairs = np.argwhere(np.triu((joints[:, None] == joints).all(axis=2), 1))
    if len(pairs):
        i, j = pairs[0]
        return f"legs {i + 1} and {j + 1} join the same two points: five legs do not constrain a platform"
    return None


POSES = 6
SEED = 20121
DEPENDENT = 1e-10  # smallest over largest singular value; below it the legs count as linearly dependent


def architecturally_singular(scaled: ScaledLegs) -> NDArray[np.bool_]:
    """Return (n,) whether the leg Jacobian is singular in all of a few fixed random poses."""
    z = np.random.default_rng(SEED).normal(size=(POSES, 8))
    R, T = rotation_and_position(z)  # T does not depend on the component of y along x
    independent = np.zeros(len(scaled.legs), dtype=bool)
    for rotation, position in zip(R, T, strict=True):
        rows = leg_jacobian(scaled.legs.A, scaled.legs.B, rotation, position)
        values = np.linalg.svd(rows, compute_uv=False)
        independent |= values[:, -1] > DEPENDENT * values[:, 0]
        if independent.all():
            break
    return ~independent


def leg_jacobian(A: Real, B: Real, R: Real, T: Real) -> Real:
    """Return the Jacobian (n, 6, 6) with rows d.dT + (R B x d).omega of the legs d = T + R B - A, A, B (n, 6, 3).

    The rows are divided by the length of d unless it is zero.
    """
    arm = B @ R.T
    d = T + arm - A
    length = np.linalg.norm(d, axis=-1, keepdims=True)
    return np.concatenate([d, np.cross(arm, d)], axis=-1) / np.where(length > 0, length, 1.0)
