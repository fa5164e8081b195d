"""The assembly modes of one pose: poses of the platform from the solutions of the scaled equations, and the certificate
of the search."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...geometry.rotations import angle_between
from ...results.status import ModesStatus
from .platform import MODES, Array, Real, ScaledLegs, rotation_and_position
from .sorting import Isolation, ModesSearch, are_same, residuals
from .tracker import distance_to_conjugate, distances, newton_step, projective_distance


@dataclass(frozen=True)
class Certificate:
    """Evidence that the set of modes is complete.

    Attributes:
        paths: paths of one start system, 40.
        finite: finite modes over the complex numbers, none multiple.
        distinct: finite modes outside the radius of uniqueness of every other; equals `finite` if all are distinct.
        certified: finite modes that pass the Newton-Kantorovich test (a solution nearby, no other within a radius).
        real: real modes.
        conjugate_pairs: pairs of complex conjugate modes; real + 2 conjugate_pairs = finite for a complete set.
        infinite: paths of the last start system that ended at infinity (x.x = 0).
        multiple: paths of the last start system that ended in finite modes with singular equations.
        lost: paths of the last start system that failed, or ended in a regular mode that another path had reached.
        start_systems: start systems used, 1 if the first sufficed.
        retries: paths tracked again from another start system.
        steps_mean, steps_most: steps per path.
        worst_residual: largest residual |F(z)| of the scaled equations, |z| = 1, over the modes; the terms have size 1.
        worst_closure: largest error of a leg length over the real modes, relative to the platform's size.
        worst_condition: largest condition number of the equations at a mode.
        least_separation: smallest distance of two modes as points of projective space; at most 1.
        nearest_distance: distance of the centroid of the platform joints between the two closest real modes
            (`AssemblyModes.nearest_other`), in the unit of the input; infinite for fewer than two.
        nearest_angle_deg: angle between these two modes [deg].
    """

    paths: int = 40
    finite: int = 0
    distinct: int = 0
    certified: int = 0
    real: int = 0
    conjugate_pairs: int = 0
    infinite: int = 0
    multiple: int = 0
    lost: int = 0
    start_systems: int = 0
    retries: int = 0
    steps_mean: float = 0.0
    steps_most: int = 0
    worst_residual: float = 0.0
    worst_closure: float = 0.0
    worst_condition: float = 0.0
    least_separation: float = np.inf
    nearest_distance: float = np.inf
    nearest_angle_deg: float = np.inf

    def text(self, *, unit: str = "m") -> str:
        """Return the certificate as text; ``unit`` is the unit of the input, metres are printed as millimetres."""
        factor, label = (1000.0, "mm") if unit == "m" else (1.0, unit)
        lines = [
            ("modes found", f"{self.finite} of {self.paths}, {self.distinct} distinct, {self.certified} certified"),
            ("real", f"{self.real}, and {self.conjugate_pairs} conjugate pairs"),
            ("elsewhere", f"{self.infinite} at infinity, {self.multiple} multiple, {self.lost} lost"),
            ("worst residual", f"{self.worst_residual:.1e} scaled; leg lengths {self.worst_closure:.1e}"),
            ("condition", f"{self.worst_condition:.1e}; least separation {self.least_separation:.1e}"),
            (
                "nearest modes",
                f"{self.nearest_distance * factor:.3f} {label} and {self.nearest_angle_deg:.3f} deg apart",
            ),
            ("start systems", f"{self.start_systems}, {self.retries} paths tracked again"),
            ("steps per path", f"{self.steps_mean:.0f} mean, {self.steps_most} most"),
        ]
        if self.real < 2:
            del lines[5]
        return "\n".join(f"{name:<15} {value}" for name, value in lines)


@dataclass(frozen=True)
class AssemblyModes:
    """All assembly modes of a platform on six legs of known lengths.

    A platform joint B has the position T + R B in the frame of the base joints. Lengths are in the unit of the input.

    Attributes:
        status: whether the set is complete.
        message: the status in a sentence with numbers.
        R: orientations of the m real modes, (m, 3, 3).
        T: positions of the real modes, (m, 3). They are sorted by the centroid of the platform joints, by x, then y,
            then z; differences below 1e-9 of the size are ignored.
        quaternion: orientations as unit quaternions, (m, 4), scalar first, first nonzero entry positive.
        nearest_other: (m,) index of the closest other real mode, -1 if there is none. The measure is
            (distance / size)^2 + angle^2, with the distance between the centroids of the platform joints.
        nearest_distance: (m,) this distance, in the unit of the input; infinite if there is no other mode.
        nearest_angle_deg: (m,) angle to that mode [deg].
        R_complex: all k finite modes, first the real ones in the order of R, then pairs of conjugates;
            (k, 3, 3) complex with R R' = 1.
        T_complex: (k, 3) complex.
        infinite: directions x of the modes at infinity as complex quaternions with x.x = 0, |x| = 1, (j, 4).
        R_multiple: one for each finite mode with singular equations, (l, 3, 3), complex in general.
        T_multiple: (l, 3); accurate to about half the digits only.
        size: length by which the legs were divided.
        certificate: the evidence.
    """

    status: ModesStatus
    message: str
    R: Real
    T: Real
    quaternion: Real
    nearest_other: NDArray[np.intp]
    nearest_distance: Real
    nearest_angle_deg: Real
    R_complex: NDArray[np.complex128]
    T_complex: NDArray[np.complex128]
    infinite: NDArray[np.complex128]
    R_multiple: NDArray[np.complex128]
    T_multiple: NDArray[np.complex128]
    size: float
    certificate: Certificate

    @property
    def ok(self) -> bool:
        """Whether all finite modes are known and isolated."""
        return self.status.ok

    def nearest(self, R: ArrayLike, T: ArrayLike) -> tuple[int, float, float]:
        """Return the real mode closest to a pose R (3, 3), T (3,): index, distance in the input unit, angle [deg].

        The measure is that of `nearest_other`, but with the distance between the two T. Without real modes the index is
        -1 and the distances are infinite.
        """
        if not len(self.T):
            return -1, np.inf, np.inf
        distance = np.linalg.norm(self.T - np.asarray(T, dtype=float), axis=1)
        angle = angle_between(self.R, np.asarray(R, dtype=float))
        k = int(np.argmin((distance / self.size) ** 2 + angle**2))
        return k, float(distance[k]), float(np.degrees(angle[k]))


def without_modes(status: ModesStatus, message: str, size: float, certificate: Certificate) -> AssemblyModes:
    """Return a result without modes."""
    R, T = np.zeros((0, 3, 3)), np.zeros((0, 3))
    Rc, Tc, none = R.astype(complex), T.astype(complex), np.zeros(0)
    return AssemblyModes(
        status, message, R, T, np.zeros((0, 4)), np.zeros(0, dtype=np.intp), none, none,
        Rc, Tc, np.zeros((0, 4), dtype=complex), Rc, Tc, size, certificate,
    )  # fmt: skip


REAL = 1e-6  # distance from its conjugate below which a mode without certificate counts as real
SAME_MULTIPLE = 1e-3  # distance below which two endpoints belong to one multiple mode
ORDER_DIGITS = 9  # digits of the positions by which the real modes are sorted


def modes_of(search: ModesSearch, scaled: ScaledLegs) -> AssemblyModes:
    """Return the modes found by a search for one pose, with their certificate."""
    status, message = search.verdict()
    real = _is_real(search.z, search.isolation)
    points = real_points(search.C, search.z[real])
    R, T = rotation_and_position(points)
    order = np.lexsort(np.round(T, ORDER_DIGITS).T[::-1])
    points, R, T = points[order], R[order], T[order]
    pairs = _conjugate_pairs(search.z, real)
    others = np.setdiff1d(np.flatnonzero(~real), pairs.ravel())  # without a conjugate: indicates a lost path
    rows = np.concatenate([np.flatnonzero(real)[order], pairs.ravel(), others])
    nearest, distance, angle = _nearest_others(R, T)
    closure = np.linalg.norm(T[:, None] + scaled.legs.B[0] @ np.swapaxes(R, 1, 2) - scaled.legs.A[0], axis=2)
    size = float(scaled.size[0])
    last = search.last
    least = int(np.argmin(distance)) if len(R) > 1 else -1
    certificate = Certificate(
        paths=MODES,
        finite=len(search.z),
        distinct=int(np.sum(~are_same(search.z, search.isolation.rho).any(axis=1))),
        certified=int(search.isolation.certified.sum()),
        real=len(R),
        conjugate_pairs=len(pairs),
        infinite=len(last.infinite) if last else 0,
        multiple=len(last.singular) if last else 0,
        lost=last.lost if last else 0,
        start_systems=search.used,
        retries=search.retries,
        steps_mean=float(np.mean(search.steps)) if search.steps else 0.0,
        steps_most=max(search.steps, default=0),
        worst_residual=float(np.max(residuals(search.C, search.z), initial=0.0)),
        worst_closure=float(np.max(np.abs(closure - scaled.legs.L[0]), initial=0.0)),
        worst_condition=float(np.max(search.isolation.condition, initial=0.0)),
        least_separation=float(np.min(distances(search.z), initial=np.inf)),
        nearest_distance=size * float(distance[least]) if least >= 0 else np.inf,
        nearest_angle_deg=float(np.degrees(angle[least])) if least >= 0 else np.inf,
    )
    R_all, T_all = _in_users_frame(*rotation_and_position(search.z[rows]), scaled)
    R_all[: len(R)], T_all[: len(R)] = R, _in_users_frame(R, T, scaled)[1]
    multiple = _representatives(last.singular) if last else search.z[:0]
    infinite = last.infinite[:, :4] if last else search.z[:0, :4]
    R_multiple, T_multiple = _in_users_frame(*rotation_and_position(multiple), scaled)
    return AssemblyModes(
        status=status,
        message=message,
        R=R,
        T=np.real(T_all[: len(R)]),
        quaternion=_unit_quaternions(points),
        nearest_other=nearest,
        nearest_distance=size * distance,
        nearest_angle_deg=np.degrees(angle),
        R_complex=R_all,
        T_complex=T_all,
        infinite=infinite / np.linalg.norm(infinite, axis=1, keepdims=True),
        R_multiple=R_multiple,
        T_multiple=T_multiple,
        size=size,
        certificate=certificate,
    )


def real_points(C: Array, z: Array) -> Real:
    """Return real representatives (m, 8) of real modes z (m, 8): without phase, refined by Newton in real numbers."""
    points = np.real(z / np.sqrt(np.sum(z[:, :4] ** 2, axis=1, keepdims=True)))
    system = np.broadcast_to(C, (len(z), *C.shape))
    for _ in range(3):
        points = points / np.linalg.norm(points, axis=1, keepdims=True)
        points = points + np.real(newton_step(system, points, points))
    return points / np.linalg.norm(points[:, :4], axis=1, keepdims=True)


def _is_real(z: Array, isolation: Isolation) -> NDArray[np.bool_]:
    """Return whether each mode (m,) is its own conjugate, judged by the radius of uniqueness if certified."""
    return distance_to_conjugate(z) < np.where(isolation.certified, 0.5 * isolation.rho, REAL)


def _conjugate_pairs(z: Array, real: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Return the indices (p, 2) of pairs of conjugate modes."""
    free = np.flatnonzero(~real).tolist()
    pairs = []
    while len(free) > 1:
        i, rest = free[0], free[1:]
        gap = projective_distance(z[rest], np.conj(z[i]))
        j = rest[int(np.argmin(gap))]
        free = rest
        if np.min(gap) < REAL:
            pairs.append((i, j))
            free = [k for k in rest if k != j]
    return np.array(pairs, dtype=np.intp).reshape(-1, 2)


def _nearest_others(R: Real, T: Real) -> tuple[NDArray[np.intp], Real, Real]:
    """Return index, distance (scaled, of the platform centroids) and angle [rad] of the closest mode for each of m."""
    m = len(R)
    if m < 2:
        return np.full(m, -1, dtype=np.intp), np.full(m, np.inf), np.full(m, np.inf)
    distance = np.linalg.norm(T[:, None] - T[None], axis=2)
    angle = angle_between(R[:, None], R[None])
    measure = distance**2 + angle**2
    measure[np.arange(m), np.arange(m)] = np.inf
    nearest = np.argmin(measure, axis=1)
    rows = np.arange(m)
    return nearest, distance[rows, nearest], angle[rows, nearest]


def _in_users_frame(R: Array, T: Array, scaled: ScaledLegs) -> tuple[Array, Array]:
    """Undo the scaling and centring: R and T = size T + base centre - R platform centre."""
    return R, scaled.size[0] * T + scaled.base_centre[0] - R @ scaled.platform_centre[0]


def _unit_quaternions(points: Real) -> Real:
    """Return unit quaternions (m, 4) of real points (m, 8); the first entry that is not nearly zero is positive."""
    x = points[:, :4]
    lead = np.argmax(np.abs(x) > 1e-9, axis=1)
    return x * np.sign(x[np.arange(len(x)), lead])[:, None] if len(x) else x


def _representatives(z: Array) -> Array:
    """Return one of each group of neighbouring singular endpoints."""
    if not len(z):
        return z
    near = np.tril(distances(z) < SAME_MULTIPLE, -1).any(axis=1)
    return z[~near]
