"""Sort endpoints: regular finite modes, modes at infinity, singular finite ones, lost paths."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .kantorovich import Isolation, isolate
from .newton import refined
from .platform import Real
from .projective import SAME, distances, projective_distance
from .self_motion import onto_equations
from .study import Array, basis
from .tracker import Endpoints

AT_INFINITY = 1e-10  # |x.x| / |z|^2 below it; exact Tau geometry has finite modes at 5e-7
STALLED = 1e-4  # a path that comes so near t = 1 and no further runs into a singular endpoint
CONVERGED = 1e-12  # of |F|, |z| = 1, at a finite mode
REFINEMENTS = 12  # Newton steps at t = 1
WEAK = 1e4  # condition above which a stalled path is thought to have met a singular mode
MOVED = 1e-2  # a point may move so far at t = 1
SINGULAR = 1e-11  # reciprocal condition below which an endpoint counts as singular


@dataclass(frozen=True)
class Endings:
    """The endpoints of the paths of one pose from one start system, sorted.

    modes: regular finite modes, all different, (k, 8), |z| = 1; isolation: of each. infinite (j, 8), singular (l, 8):
    endpoints at infinity and in singular finite modes. lost: paths that ended nowhere or doubly. steps: per path.
    """

    modes: Array
    isolation: Isolation
    infinite: Array
    singular: Array
    lost: int
    steps: NDArray[np.intp]


def sort_endpoints(C: Array, ends: Endpoints) -> list[Endings]:
    """Refine and sort the endpoints of n poses with systems C (n, 7, 18); the paths lie pose by pose."""
    n = len(C)
    paths = len(ends.z) // n
    systems = np.repeat(C, paths, axis=0).astype(complex)
    arrived, stalled = ends.arrived, ~ends.arrived & (1 - ends.t < STALLED)
    z = ends.z.copy()
    near = arrived | stalled
    z[near] = refined_or_kept(systems[near], z[near])
    finite = np.abs(np.sum(z[:, :4] ** 2, axis=1)) > AT_INFINITY
    isolation = isolate(systems, z)
    regular = (arrived | (stalled & isolation.certified)) & finite
    regular &= (isolation.condition < 1 / SINGULAR) & (residuals(systems, z) < CONVERGED)
    infinite = (arrived | stalled) & ~finite
    singular = (arrived | stalled) & finite & ~regular & (isolation.condition > WEAK)
    result = []
    for i in range(n):
        rows = slice(i * paths, (i + 1) * paths)
        kept = np.flatnonzero(regular[rows]) + i * paths
        kept = kept[first_of_each(z[kept], isolation.rho[kept])]
        others = z[rows]
        lost = paths - len(kept) - int(infinite[rows].sum()) - int(singular[rows].sum())
        result.append(
            Endings(
                z[kept], pick(isolation, kept), others[infinite[rows]], others[singular[rows]], lost, ends.steps[rows]
            )
        )
    return result


def merge(z: Array, isolation: Isolation, more: Array, theirs: Isolation) -> tuple[Array, Isolation]:
    """The different regular modes of two searches, (k, 8) and (l, 8), the first ones first."""
    joined = Isolation(
        np.concatenate([isolation.certified, theirs.certified]),
        np.concatenate([isolation.rho, theirs.rho]),
        np.concatenate([isolation.condition, theirs.condition]),
    )
    both = np.concatenate([z, more])
    kept = first_of_each(both, joined.rho)
    return both[kept], pick(joined, kept)


def refined_or_kept(C: Array, z: Array) -> Array:
    """Newton at t = 1, but the point itself where that leads away, fails or does not lessen the residual.

    Near a curve of solutions Newton may run along it; such a point is moved straight onto the equations.
    """
    with np.errstate(all="ignore"):
        w = refined(C, z, REFINEMENTS)
        better = projective_distance(w, z) < 0.1 * MOVED
        better &= residuals(C, w) <= np.maximum(residuals(C, z), 1e-15)
    w = np.where(better[:, None], w, z)
    if not np.all(better):
        rest = ~better
        moved = onto_equations(C[rest], z[rest])
        w[rest] = np.where((projective_distance(moved, z[rest]) < MOVED)[:, None], moved, z[rest])
    return w


def residuals(C: Array, z: Array) -> Real:
    """Largest |F| (m,) over the seven equations C (m, 7, 18) at z (m, 8), |z| = 1."""
    return np.max(np.abs((C @ basis(z)[..., None])[..., 0]), axis=-1)


def first_of_each(z: Array, rho: Real) -> NDArray[np.intp]:
    """Indices of the first of each group of equal points z (m, 8); rho: radii of uniqueness, 0 where unknown.

    Two points are one when either lies within the other's radius of uniqueness; without one, within 1e-6.
    """
    return np.flatnonzero(~np.tril(are_same(z, rho), -1).any(axis=1))


def are_same(z: Array, rho: Real) -> NDArray[np.bool_]:
    """(m, m) True where two points z (m, 8) are one, as for `first_of_each`; False on the diagonal."""
    reach = np.where(rho > 0, 0.5 * rho, SAME)
    return distances(z) < np.maximum(reach[:, None], reach[None, :])


def pick(isolation: Isolation, rows: NDArray[np.intp]) -> Isolation:
    """The isolation of some points."""
    return Isolation(isolation.certified[rows], isolation.rho[rows], isolation.condition[rows])
