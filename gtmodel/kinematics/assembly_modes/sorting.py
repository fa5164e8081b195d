"""Classification of path endpoints into regular finite modes, modes at infinity, singular modes and lost paths, and
the state of the search after each start system."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ...results.status import ModesStatus
from .platform import EQUATIONS, MODES, VARIABLES, Array, Real, basis, gradients
from .tracker import SAME, Endpoints, distances, projective_distance, refined

STRICT = 0.1  # largest trusted h: at an exact double solution h tends to 1/2 for any precision
BASIS_MATRICES = np.moveaxis(gradients(np.eye(VARIABLES)), 0, -1)  # (18, 8, 8): D(z) = BASIS_MATRICES z


@dataclass(frozen=True)
class Isolation:
    """For each point (m,): certified (h small), rho (radius of uniqueness, 0 if not certified), condition number."""

    certified: NDArray[np.bool_]
    rho: Real
    condition: Real


def isolate(C: Array, z: Array) -> Isolation:
    """Apply the Newton-Kantorovich test to points z (m, 8), |z| = 1, as solutions of the system C (7, 18), or of the
    systems C (n, 7, 18), each for m / n points in order."""
    C = C.reshape(-1, *C.shape[-2:])
    each = len(z) // len(C)
    matrix = np.empty((len(z), VARIABLES, VARIABLES), dtype=complex)
    matrix[:, :EQUATIONS] = np.repeat(C, each, axis=0) @ gradients(z)
    matrix[:, EQUATIONS] = np.conj(z)
    U, values, _ = np.linalg.svd(matrix)
    residual = np.zeros((len(z), VARIABLES), dtype=complex)
    residual[:, :EQUATIONS] = 0.5 * (matrix[:, :EQUATIONS] @ z[:, :, None])[..., 0]
    with np.errstate(all="ignore"):
        projected = np.conj(np.swapaxes(U, 1, 2)) @ residual[:, :, None]
        beta = np.linalg.norm(projected[..., 0] / values, axis=1)
        K = np.repeat(_second_derivative(C), each) / values[:, -1]
        h = beta * K
        certified = h <= STRICT
        rho = np.where(certified, (1 + np.sqrt(np.where(certified, 1 - 2 * h, 0))) / K, 0.0)
        return Isolation(certified, rho, values[:, 0] / values[:, -1])


def _second_derivative(C: Array) -> Real:
    """Return a bound of |D2F| for systems C (n, 7, 18): the root sum of squares of the Hessians' spectral norms."""
    hessians = np.tensordot(C, BASIS_MATRICES, axes=(2, 0))
    return np.sqrt(np.sum(np.linalg.norm(hessians, ord=2, axis=(-2, -1)) ** 2, axis=-1))


ON_A_CURVE = 1e-10  # smallest over largest singular value on a curve
NEAR_A_CURVE = 1e-5  # smallest over largest singular value at an endpoint near a curve, accurate to about 1e-6
FINITE = 1e-6  # |x.x| / |z|^2; a curve below it is at infinity and is not a motion of the platform
STEP = 0.03  # along the tangent, |z| = 1; at an isolated mode of multiplicity m the residual is about STEP^m
ITERATIONS = 60  # the error is only halved per iteration if the solutions on a curve are multiple
ON_THE_EQUATIONS = 1e-12  # largest |F| with |z| = 1
PROJECTIONS = 4  # iterations that project a singular endpoint onto the equations


def on_a_curve(C: Array, z: Array) -> bool:
    """Whether the singular point z (8,), |z| = 1, is on a curve of finite solutions of the system C (7, 18)."""
    z = _settled(C, z, np.conj(z)[None])
    values, directions = _tangent(C, z)
    finite = abs(np.sum(z[:4] ** 2)) > FINITE
    if not finite or values[-1] > ON_A_CURVE * values[0] or _residual(C, z) > ON_THE_EQUATIONS:
        return False
    tangent = np.conj(directions[-1])
    across = np.stack([np.conj(z), np.conj(tangent)])
    ends = [_settled(C, z + sign * STEP * tangent, across) for sign in (1, -1, 1j, -1j)]
    return all(_residual(C, w) <= ON_THE_EQUATIONS for w in ends)


def _settled(C: Array, z: Array, plane: Array) -> Array:
    """Move the point z (8,) onto the system C by Levenberg-Marquardt steps, orthogonal to the rows `plane` (k, 8).

    The damping decreases with the residual, after Fan and Yuan, Computing 74 (2005): fast convergence even to a curve.
    """
    for _ in range(ITERATIONS):
        J = C @ gradients(z)
        F = 0.5 * J @ z
        damping = np.linalg.norm(F) * np.eye(VARIABLES)
        rows = np.vstack([J, plane, damping])
        z = z + np.linalg.lstsq(rows, np.concatenate([-F, np.zeros(len(plane) + VARIABLES)]))[0]
    return z / np.linalg.norm(z)


def onto_equations(C: Array, z: Array) -> Array:
    """Move points z (m, 8) onto the systems C (m, 7, 18) by minimum-norm Gauss-Newton steps; |z| = 1.

    Directions that the equations hardly determine are ignored, so that a point does not move along a curve.
    """
    for _ in range(PROJECTIONS):
        J = C @ gradients(z)
        F = 0.5 * (J @ z[:, :, None])
        z = z - (np.linalg.pinv(J, rcond=NEAR_A_CURVE) @ F)[..., 0]
        z = z / np.linalg.norm(z, axis=1, keepdims=True)
    return z


def _tangent(C: Array, z: Array) -> tuple[Array, Array]:
    """Return singular values and right singular vectors (conjugated rows) of [J; z*]."""
    matrix = np.empty((VARIABLES, VARIABLES), dtype=complex)
    matrix[:EQUATIONS] = C @ gradients(z)
    matrix[EQUATIONS] = np.conj(z)
    _, values, directions = np.linalg.svd(matrix)
    return values, directions


def _residual(C: Array, z: Array) -> float:
    return float(np.max(np.abs(0.5 * C @ (gradients(z) @ z))))


AT_INFINITY = 1e-10  # |x.x| / |z|^2 below it; exact Tau geometry has finite modes at 5e-7
STALLED = 1e-4  # distance from t = 1; a path that stops closer to 1 has a singular endpoint
CONVERGED = 1e-12  # largest |F|, |z| = 1, at a finite mode
REFINEMENTS = 12  # Newton steps at t = 1
WEAK = 1e4  # condition number above which a path counts as ending in a singular mode
MOVED = 1e-2  # largest correction of a point at t = 1
SINGULAR = 1e-11  # reciprocal condition below which an endpoint counts as singular


@dataclass(frozen=True)
class Endings:
    """The classified endpoints of the paths of one pose from one start system.

    modes: regular finite modes, all different, (k, 8), |z| = 1; isolation: of each. infinite (j, 8), singular (l, 8):
    endpoints at infinity and in singular finite modes. lost: number of paths without an endpoint, or with the same
    endpoint as another path. steps: per path.
    """

    modes: Array
    isolation: Isolation
    infinite: Array
    singular: Array
    lost: int
    steps: NDArray[np.intp]


def sort_endpoints(C: Array, ends: Endpoints) -> list[Endings]:
    """Refine and classify the endpoints of n poses with systems C (n, 7, 18); paths are ordered by pose."""
    n = len(C)
    paths = len(ends.z) // n
    systems = np.repeat(C, paths, axis=0).astype(complex)
    arrived, stalled = ends.arrived, ~ends.arrived & (1 - ends.t < STALLED)
    z = ends.z.copy()
    near = arrived | stalled
    z[near] = refined_or_kept(systems[near], z[near])
    finite = np.abs(np.sum(z[:, :4] ** 2, axis=1)) > AT_INFINITY
    isolation = isolate(C, z)
    regular = (arrived | (stalled & isolation.certified)) & finite
    regular &= (isolation.condition < 1 / SINGULAR) & (residuals(systems, z) < CONVERGED)
    infinite = (arrived | stalled) & ~finite
    singular = (arrived | stalled) & finite & ~regular & (isolation.condition > WEAK)
    result = []
    for i in range(n):
        rows = slice(i * paths, (i + 1) * paths)
        modes = np.flatnonzero(regular[rows]) + i * paths
        modes = modes[first_of_each(z[modes], isolation.rho[modes])]
        points = z[rows]
        lost = paths - len(modes) - int(infinite[rows].sum()) - int(singular[rows].sum())
        result.append(
            Endings(
                z[modes], pick(isolation, modes), points[infinite[rows]], points[singular[rows]], lost, ends.steps[rows]
            )
        )
    return result


def merge(z: Array, isolation: Isolation, more: Array, theirs: Isolation) -> tuple[Array, Isolation]:
    """Return the different regular modes of two searches, (k, 8) and (l, 8), those of the first search first."""
    joined = Isolation(
        np.concatenate([isolation.certified, theirs.certified]),
        np.concatenate([isolation.rho, theirs.rho]),
        np.concatenate([isolation.condition, theirs.condition]),
    )
    both = np.concatenate([z, more])
    rows = first_of_each(both, joined.rho)
    return both[rows], pick(joined, rows)


def refined_or_kept(C: Array, z: Array) -> Array:
    """Refine points by Newton's method at t = 1; keep a point if Newton moves far, fails or increases the residual.

    Near a curve of solutions Newton may move along the curve; such a point is projected onto the equations instead.
    """
    with np.errstate(all="ignore"):
        w = refined(C, z, REFINEMENTS)
        better = projective_distance(w, z) < 0.1 * MOVED
        better &= residuals(C, w) <= np.maximum(residuals(C, z), 1e-15)
    w = np.where(better[:, None], w, z)
    if not np.all(better):
        rest = ~better
        projected = onto_equations(C[rest], z[rest])
        w[rest] = np.where((projective_distance(projected, z[rest]) < MOVED)[:, None], projected, z[rest])
    return w


def residuals(C: Array, z: Array) -> Real:
    """Return the largest |F| (m,) over the seven equations C (m, 7, 18) at z (m, 8), |z| = 1."""
    return np.max(np.abs((C @ basis(z)[..., None])[..., 0]), axis=-1)


def first_of_each(z: Array, rho: Real) -> NDArray[np.intp]:
    """Return the index of the first in each group of equal points z (m, 8); rho: radii of uniqueness, 0 if unknown.

    Two points are equal if their distance is less than half of either radius of uniqueness, or 1e-6 without one.
    """
    return np.flatnonzero(~np.tril(are_same(z, rho), -1).any(axis=1))


def are_same(z: Array, rho: Real) -> NDArray[np.bool_]:
    """Return (m, m) whether two points z (m, 8) are equal as in `first_of_each`; False on the diagonal."""
    reach = np.where(rho > 0, 0.5 * rho, SAME)
    return distances(z) < np.maximum(reach[:, None], reach[None, :])


def pick(isolation: Isolation, rows: NDArray[np.intp]) -> Isolation:
    """Return the isolation of some points."""
    return Isolation(isolation.certified[rows], isolation.rho[rows], isolation.condition[rows])


CURVES_TRIED = 3  # singular endpoints per search that are tested for a self-motion


@dataclass
class ModesSearch:
    """The search for the modes of one scaled pose with the system C (7, 18).

    z (k, 8), isolation: all different regular modes so far. last: the endings from the last start system.
    """

    C: Array
    z: Array = field(default_factory=lambda: np.zeros((0, VARIABLES), dtype=complex))
    isolation: Isolation = field(default_factory=lambda: Isolation(np.zeros(0, dtype=bool), np.zeros(0), np.zeros(0)))
    used: int = 0
    retries: int = 0
    self_motion: bool = False
    last: Endings | None = None
    steps: list[int] = field(default_factory=list)
    _agreed: bool = False

    def add(self, endings: Endings) -> None:
        """Add the endings from another start system."""
        if self.last is None:
            self.z, self.isolation = endings.modes, endings.isolation
        else:
            count = len(self.z)
            self.z, self.isolation = merge(self.z, self.isolation, endings.modes, endings.isolation)
            # fewer than 40 modes are accepted if two searches lose no path and find the same modes
            same = len(self.z) == count == len(endings.modes)
            self._agreed = same and not endings.lost and not self.last.lost
            self.retries += len(endings.steps)
        self.last = endings
        self.used += 1
        self.steps += endings.steps.tolist()
        self.self_motion = any(on_a_curve(self.C, z) for z in endings.singular[:CURVES_TRIED])

    def settled(self) -> bool:
        """Return True if no further start system is needed."""
        return len(self.z) == MODES or self.self_motion or self._agreed

    def verdict(self) -> tuple[ModesStatus, str]:
        """Return status and message, after all needed or available start systems have been used."""
        count, last = len(self.z), self.last
        if last is None:
            return ModesStatus.INCOMPLETE, "no start system was used"
        infinite, multiple, lost = len(last.infinite), len(last.singular), last.lost
        tail = f"found {count} finite modes; {infinite} paths ended at infinity"
        if self.self_motion:
            return ModesStatus.SELF_MOTION, (
                f"the modes are not finite in number: {multiple} of {MODES} paths ended on a curve of solutions "
                "(real or complex), along which the platform moves although all lengths are fixed"
            )
        if count == MODES:
            return ModesStatus.COMPLETE, f"all {MODES} modes were found"
        if count > MODES:
            return (
                ModesStatus.INCOMPLETE,
                f"found {count} modes, but at most {MODES} exist: some are counted twice",
            )
        if not self._agreed:
            return ModesStatus.INCOMPLETE, (
                f"{tail}, {multiple} in singular modes, and {lost} were lost with {self.used} start systems: "
                "modes may be missing"
            )
        if multiple:
            return ModesStatus.MULTIPLE, (
                f"{tail} and {multiple} in modes that (nearly) coincide: the platform is singular there"
            )
        return ModesStatus.FEWER_FINITE, (
            f"{tail} from each of {self.used} start systems: this platform has fewer than {MODES} finite modes"
        )
