"""From the solutions of the scaled equations to poses of the platform in the user's frame and unit."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...geometry.rotations import angle_between
from .certificate import Certificate
from .kantorovich import Isolation
from .newton import newton_step
from .platform import Real, ScaledLegs
from .projective import distance_to_conjugate, distances, projective_distance
from .result import AssemblyModes
from .search import ModesSearch
from .sorting import are_same, residuals
from .study import MODES, Array, rotation_and_position

REAL = 1e-6  # distance from its own conjugate below which a mode that is not certified counts as real
SAME_MULTIPLE = 1e-3  # distance of two endpoints of one multiple mode
ORDER_DIGITS = 9  # of positions, by which the real modes are sorted


def modes_of(search: ModesSearch, scaled: ScaledLegs) -> AssemblyModes:
    """The modes that a search has found for one pose, with their certificate."""
    status, message = search.verdict()
    real = _is_real(search.z, search.isolation)
    points = real_points(search.C, search.z[real])
    R, T = rotation_and_position(points)
    order = np.lexsort(np.round(T, ORDER_DIGITS).T[::-1])
    points, R, T = points[order], R[order], T[order]
    pairs = _conjugate_pairs(search.z, real)
    others = np.setdiff1d(np.flatnonzero(~real), pairs.ravel())  # without a partner: a sign of a lost path
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
    """Real representatives (m, 8) of real modes z (m, 8): the phase taken out, refined by Newton in real numbers."""
    points = np.real(z / np.sqrt(np.sum(z[:, :4] ** 2, axis=1, keepdims=True)))
    system = np.broadcast_to(C, (len(z), *C.shape))
    for _ in range(3):
        points = points / np.linalg.norm(points, axis=1, keepdims=True)
        points = points + np.real(newton_step(system, points, points))
    return points / np.linalg.norm(points[:, :4], axis=1, keepdims=True)


def _is_real(z: Array, isolation: Isolation) -> NDArray[np.bool_]:
    """(m,) True where a mode is its own conjugate: by its radius of uniqueness, where certified."""
    return distance_to_conjugate(z) < np.where(isolation.certified, 0.5 * isolation.rho, REAL)


def _conjugate_pairs(z: Array, real: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Indices (p, 2) of modes that are each other's conjugate and nobody else's; the first of a pair leads."""
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
    """Index, distance (scaled, of the platform's centroid) and angle [rad] of the real mode nearest each of m."""
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
    """Unit quaternions (m, 4) of real points (m, 8), the first entry that is not nearly zero positive."""
    x = points[:, :4]
    lead = np.argmax(np.abs(x) > 1e-9, axis=1)
    return x * np.sign(x[np.arange(len(x)), lead])[:, None] if len(x) else x


def _representatives(z: Array) -> Array:
    """One of each group of neighbouring singular endpoints."""
    if not len(z):
        return z
    near = np.tril(distances(z) < SAME_MULTIPLE, -1).any(axis=1)
    return z[~near]
