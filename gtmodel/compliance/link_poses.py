"""Where the links of a parallel robot are, and how its axes move their cart joints, from its own equations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..compiler.causal import CausalFunction, compile_causal, flat_of
from ..kinematics.mechanism import Poses
from ..lang import Model, ModelError
from ..results import Status
from ..robots.links import rod_names

Array = np.ndarray
STANDS = 1e-6  # of the greatest motion of a cart joint by an axis: less is none


@dataclass(frozen=True, eq=False)
class LinkPoses(Poses):
    """n poses of a plate on m links, with p driven axes q on k carts. World coordinates.

    R (n, 3, 3) of the plate, None where it has no orientation of its own; moved (n, m, 3, p): Jacobian of each cart
    joint in the axes [m per unit of the axis]; stands_on (m,) the cart of each link. The first k axes move the carts,
    all others turn joint plates on them.
    """

    R: Array | None
    moved: Array
    stands_on: tuple[int, ...]

    @property
    def carts(self) -> int:
        """Number k of carts."""
        return max(self.stands_on) + 1

    @property
    def lengths(self) -> Array:
        """Lengths of the links (n, m) [m]."""
        return np.linalg.norm(self.b - self.a, axis=2)

    @property
    def directions(self) -> Array:
        """(n, m, 3) unit vectors from cart to plate."""
        return (self.b - self.a) / self.lengths[..., None]

    @property
    def arms(self) -> Array:
        """(n, m, 3) from T to the plate joints [m]."""
        return self.b - self.T[:, None]

    @property
    def cart_motion(self) -> Array:
        """(n, k, 3) motion of each cart per unit of its axis: the mean over its links."""
        rows = [[j for j, cart in enumerate(self.stands_on) if cart == i] for i in range(self.carts)]
        return np.stack([self.moved[..., i][:, row].mean(axis=1) for i, row in enumerate(rows)], axis=1)


class LinkGeometry:
    """The functions of a robot from which `LinkPoses` are computed, compiled once.

    model: links are parts with L, ends a and b and a `tension`, as mechanics.Rod; axes are `q`, the tool centre point
    is `T`, and where the plate has an orientation of its own, `R`. Raises ModelError for a robot without these, and
    for a link that stands on no cart.

    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> poses = gt.compliance.LinkGeometry(robot)(robot.home)
    >>> poses.directions.shape, poses.stands_on
    ((1, 3, 3), (0, 1, 2))
    """

    def __init__(self, model: Model) -> None:
        flat = flat_of(model)
        self.links = tuple(rod_names(model))
        missing = [name for name in ("q", "T") if name not in flat.groups]
        if not self.links or missing:
            what = f"it has no {' and no '.join(missing)}" if missing else "it has no links"
            raise ModelError(f"expected a robot whose plate T hangs on links with axes q; {what}")
        self.turns = "R" in flat.groups
        names = [f"{n}.{end}.r" for n in self.links for end in "ab"]
        self._inverse = _inverse(model, ["q", *(["R"] if self.turns else []), *names])
        self._joints = compile_causal(model, known="q", targets=names[0::2])
        if len(self._joints.inputs) != 1:
            raise ModelError(
                "the cart joints must follow from q alone; "
                f"{', '.join(s.name for s in self._joints.inputs[1:])} would be needed too"
            )
        self._stands_on = self._carts(flat.groups["q"][0][0])
        self._e = np.asarray(getattr(model, "home_e", [1.0, 0.0, 0.0, 0.0]), float)

    def __call__(self, T: ArrayLike) -> LinkPoses:
        """Poses at T (n, 3) [m]; a plate that turns freely keeps the orientation of its home."""
        T = np.atleast_2d(np.asarray(T, float))
        given = [T] if len(self._inverse.inputs) == 1 else [T, np.tile(self._e, (len(T), 1))]
        q, *rest, status = self._inverse(*given)
        R = rest.pop(0) if self.turns else None
        a, b = np.stack(rest[0::2], axis=1), np.stack(rest[1::2], axis=1)
        n, p = q.shape
        good = status == Status.OK
        moved = np.full((n, len(self.links), 3, p), np.nan)
        if good.any():
            jacobian, code = self._joints.jacobian(q[good])
            moved[good] = jacobian.reshape(len(jacobian), len(self.links), 3, p)
            status = np.array(status)
            status[good] = code
        return LinkPoses(T, q, a, b, status, R, moved, self._stands_on)

    def _carts(self, axes: int) -> tuple[int, ...]:
        jacobian, _ = self._joints.jacobian(np.zeros(axes))
        size = np.abs(jacobian.reshape(len(self.links), 3, axes)).max(axis=1)
        on = size > STANDS * size.max()
        carts = [int(np.argmax(row)) for row in on]
        if not on.any(axis=1).all() or sorted(set(carts)) != list(range(max(carts) + 1)):
            raise ModelError("each link must stand on one cart, and the first axes must move the carts")
        return tuple(carts)


def _inverse(model: Model, targets: list[str]) -> CausalFunction:
    inverse = compile_causal(model, known="T", targets=targets) if _alone(model) else None
    if inverse is None or len(inverse.inputs) > 1:
        inverse = compile_causal(model, known=["T", "e"], targets=targets)
    return inverse


def _alone(model: Model) -> bool:
    """Whether poses follow from T alone: as many axes as coordinates of T."""
    flat = flat_of(model)
    return flat.groups["q"][0] == (3,)
