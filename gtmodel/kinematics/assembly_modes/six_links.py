"""Six legs as arrays: of a robot at known carts or in a known pose, of platforms, and of synthetic platforms."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import numpy as np

from ...compiler.causal import CausalFunction, compile_causal, flat_of
from ...geometry.rotations import matrices
from ...lang import Model, ModelError
from ...results import ArgumentError, Status
from ...robots.links import rod_names

Array = np.ndarray
LINKS = 6


@dataclass(frozen=True)
class Hands:
    """Six legs in n poses, and the commanded poses.

    Attributes:
        A: (n, 6, 3) joints at the carts [m]; B: (n, 6, 3) plate joints in plate coordinates [m]; L: (n, 6) lengths [m].
        T, R: (n, 3), (n, 3, 3) commanded poses; NaN if there is none, or none was found.
        q: (n, k) carts [m], then rotary axes [rad]; k = 0 for a platform without a robot.
        faults: index of a pose without legs -> reason.
        carts: indices of the legs on each cart, default: one each. directions: (6, 3) motion of each A per q, or None.
        synthetic: description of the random draw; "" for other legs.
    """

    A: Array
    B: Array
    L: Array
    T: Array
    R: Array
    q: Array
    faults: dict[int, str]
    carts: tuple[tuple[int, ...], ...] = tuple((k,) for k in range(LINKS))
    directions: Array | None = None
    synthetic: str = ""

    def __len__(self) -> int:
        return len(self.A)


@dataclass(frozen=True)
class SixLinks:
    """A robot with six links of fixed length between carts and a plate whose joints are B; rods: their names."""

    model: Model
    rods: list[str]

    @cached_property
    def carts_and_axes(self) -> tuple[int, int]:
        """Numbers of carts [m] and of rotary axes [rad] among the coordinates q."""
        return 3, _coordinates(self.model) - 3

    @property
    def turns(self) -> bool:
        """Whether the orientation of the plate is free, not determined by T."""
        return self.carts_and_axes[1] == 3

    @property
    def home(self) -> tuple[Array, Array]:
        """Home pose of the model: T (3,) [m] and the quaternion e (4,)."""
        return np.asarray(self.model.home, dtype=float), np.asarray(self.model.home_e, dtype=float)  # type: ignore[attr-defined]

    def at_carts(self, q: Array) -> Hands:
        """Return the legs at coordinates q (n, k); Newton's method from home gives the commanded poses."""
        T, R, status = self.forward(q)
        T[status != Status.OK], R[status != Status.OK] = np.nan, np.nan
        return self._hands(q, T, R, {})

    def at_poses(self, T: Array, e: Array) -> Hands:
        """Return the legs at tool poses T (n, 3) and quaternions e (n, 4), which count only if the orientation is
        free."""
        known = (T, e) if self.turns else (T,)
        q, R, status = self.inverse(*known)
        faults = {
            int(i): f"the inverse kinematics does not reach the pose: {self.inverse.diagnose(*(x[i] for x in known))}"
            for i in np.flatnonzero(status != Status.OK)
        }
        q[status != Status.OK], R[status != Status.OK] = np.nan, np.nan
        return self._hands(q, T, R, faults)

    @cached_property
    def forward(self) -> CausalFunction:
        """Forward kinematics q -> T, R with Newton's method."""
        return compile_causal(self.model, known="q", targets=["T", "R"])

    @cached_property
    def inverse(self) -> CausalFunction:
        """Inverse kinematics T -> q, R, or T, e -> q, R if the orientation is free."""
        return compile_causal(self.model, known=["T", "e"] if self.turns else ["T"], targets=["q", "R"])

    @cached_property
    def _joints(self) -> CausalFunction:
        return compile_causal(self.model, known="q", targets=[f"{rod}.a.r" for rod in self.rods])

    def _hands(self, q: Array, T: Array, R: Array, faults: dict[int, str]) -> Hands:
        flat = flat_of(self.model)
        lengths = [flat.bindings[f"{rod}.L"] for rod in self.rods]
        # plate joints row by row
        values = ca.Function("p", [flat.p], [ca.vertcat(*lengths), ca.vec(flat.bindings["B"])])(flat.p0)
        L, B = (np.array(v).ravel() for v in values)
        n = len(q)
        A = np.stack(self._joints(q)[:-1], axis=1)
        finite = np.flatnonzero(np.isfinite(q).all(axis=1))
        carts, directions = self._carriers(q[finite[0]]) if finite.size else (Hands.carts, None)
        return Hands(A, np.tile(B.reshape(LINKS, 3), (n, 1, 1)), np.tile(L, (n, 1)), T, R, q, faults, carts, directions)

    def _carriers(self, q: Array) -> tuple[tuple[tuple[int, ...], ...], Array]:
        """Return the legs on each cart, and the motion of their joints, from the derivative of the joints."""
        by_q = self._joints.jacobian(q)[0].reshape(LINKS, 3, -1)[:, :, : self.carts_and_axes[0]]
        cart = np.argmax(np.linalg.norm(by_q, axis=1), axis=1)
        groups = tuple(tuple(int(k) for k in np.flatnonzero(cart == i)) for i in range(self.carts_and_axes[0]))
        return groups, by_q[np.arange(LINKS), :, cart]


def six_links_of(model: Model) -> SixLinks:
    """Return the six links of a robot. Raises ArgumentError for other robots."""
    try:
        rods = rod_names(model)
    except ModelError as error:
        raise ArgumentError(str(error), "robot") from error
    if len(rods) != LINKS or "B" not in flat_of(model).bindings:
        raise ArgumentError(
            "assembly modes need six links of fixed length on a plate with the joints B; found a "
            f"{type(model).__name__} with {len(rods)} links",
            "robot",
        )
    count = _coordinates(model)
    if count not in (3, 6):
        raise ArgumentError(
            f"assembly modes need three carts, or three carts and three rotary axes; {type(model).__name__} has "
            f"{count} coordinates q",
            "robot",
        )
    return SixLinks(model, rods)


def _coordinates(model: Model) -> int:
    (count,), _ = flat_of(model).groups["q"]
    return count


def bare(A: Array, B: Array, L: Array, T: Array | None = None, e: Array | None = None) -> Hands:
    """Build legs from arrays: A, B (n, 6, 3) or (6, 3), L (n, 6) or (6,); commanded poses T (n, 3), e (n, 4).

    A hexapod at rest 1 m above its base:

    >>> from gtmodel.kinematics.assembly_modes import bare
    >>> angle = np.radians([0, 60, 120, 180, 240, 300])
    >>> A = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    >>> B = 0.5 * np.roll(A, 1, axis=0)
    >>> hands = bare(A, B, np.linalg.norm(A - B - [0, 0, 1.0], axis=1), T=np.array([0, 0, 1.0]))
    >>> hands.A.shape, hands.L.round(3)
    ((1, 6, 3), array([[1.323, 1.323, 1.323, 1.323, 1.323, 1.323]]))
    """
    A, B, L = A.reshape(-1, LINKS, 3), B.reshape(-1, LINKS, 3), L.reshape(-1, LINKS)
    n = len(L)
    positions = np.full((n, 3), np.nan) if T is None else T.reshape(n, 3)
    rotations = np.full((n, 3, 3), np.nan) if e is None else matrices(e.reshape(n, 4))
    return Hands(A, B, L, positions, rotations, np.zeros((n, 0)), {})


def draw(count: int, seed: int) -> Hands:
    """Draw random platforms with leg lengths from random poses, which are the commanded ones.

    Base joints are uniform in a cube of side 2 m, plate joints in a cube of side 1 m. T is normal with standard
    deviation 1 m, orientations are uniform. A larger count begins with the platforms of a smaller count.

    >>> from gtmodel.kinematics.assembly_modes import draw
    >>> hands = draw(3, seed=1)
    >>> len(hands), hands.L.shape, hands.synthetic
    (3, (3, 6), 'synthetic platforms, seed 1')
    """
    random = np.random.default_rng(seed)
    A, B, T, e = (np.zeros((count, *shape)) for shape in ((LINKS, 3), (LINKS, 3), (3,), (4,)))
    for i in range(count):
        A[i], B[i] = random.uniform(-1.0, 1.0, (LINKS, 3)), random.uniform(-0.5, 0.5, (LINKS, 3))
        T[i], e[i] = random.normal(size=3), random.normal(size=4)
    hands = bare(A, B, np.ones((count, LINKS)), T, e)
    return replace(
        hands,
        synthetic=f"synthetic platforms, seed {seed}",
        L=np.linalg.norm(T[:, None] + B @ np.swapaxes(hands.R, 1, 2) - A, axis=2),
    )
