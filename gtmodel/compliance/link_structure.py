"""Stiffness of a plate on links, from springs of links, joints, drives, carts and frame, and the geometry of links."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from ..compiler.causal import CausalFunction, compile_causal, flat_of
from ..geometry.rotations import cross_matrix
from ..kinematics.mechanism import Poses
from ..lang import Model, ModelError
from ..results import Status
from ..robots.links import rod_names

Array = np.ndarray
GROUPS = ("links", "joints", "drives", "carts", "frame")


@dataclass(frozen=True, eq=False)
class LinkSprings:
    """Compliances of a parallel robot, zero for a rigid part. Springs at the same place are in series.

    Each is one number, or one per link, cart or axis. link: rods, L/(E A) [m/N]; joint: one ball joint along its link
    [m/N], two per link; `parallel`: number of parallel rods with their own joints in each link of the model, three for
    arm 3 of the three-link model (Dressler 2012, section 4.3). drive: along the guideway, drive train and servo loop
    [m/N]. axis: rotary axes on the carts [rad/(N.m)]. cart: bearings across the guideway [m/N]. frame_along,
    frame_across: machine frame at each cart [m/N]. Raises ValueError for negative numbers.

    >>> gt.compliance.LinkSprings(link=-5e-8)
    Traceback (most recent call last):
    ValueError: link must be a compliance of zero or more; found -5e-08
    """

    link: ArrayLike
    joint: ArrayLike = 0.0
    parallel: ArrayLike = 1
    drive: ArrayLike = 0.0
    axis: ArrayLike = 0.0
    cart: ArrayLike = 0.0
    frame_along: ArrayLike = 0.0
    frame_across: ArrayLike = 0.0

    def __post_init__(self) -> None:
        for name in ("link", "joint", "drive", "axis", "cart", "frame_along", "frame_across"):
            value = np.asarray(getattr(self, name), float)
            if not np.all(np.isfinite(value)) or np.any(value < 0):
                raise ValueError(f"{name} must be a compliance of zero or more; found {getattr(self, name)}")
        if not np.all(np.asarray(self.parallel, float) >= 1) or not np.all(np.isfinite(self.parallel)):
            raise ValueError(f"parallel is the number of parallel rods, 1 or more; found {self.parallel}")

    def by_group(self, links: int, carts: int, axes: int) -> dict[str, Array]:
        """Return compliances (links + 3 carts + axes,) of each group of springs.

        Order: links; then along, across and across each cart's guideway; then rotary axes. The sum over the groups is
        the compliance of each coordinate.
        """
        sizes = (links, 3 * carts, axes)
        groups = {name: [np.zeros(size) for size in sizes] for name in GROUPS}
        parallel = _each(self.parallel, links, "parallel")
        groups["links"][0] = _each(self.link, links, "link") / parallel
        groups["joints"][0] = 2 * _each(self.joint, links, "joint") / parallel
        groups["drives"][1][0::3] = _each(self.drive, carts, "drive")
        groups["drives"][2] = _each(self.axis, axes, "axis")
        for start, frame in enumerate((self.frame_along, self.frame_across, self.frame_across)):
            groups["frame"][1][start::3] = _each(frame, carts, "frame")
            groups["carts"][1][start::3] = _each(self.cart, carts, "cart") if start else 0.0
        return {name: np.concatenate(parts) for name, parts in groups.items()}


def tube(modulus: float, outer: float, inner: float, length: ArrayLike) -> Array:
    """Return the axial compliance L/(E A) [m/N] of a tube: modulus [Pa], diameters [m], lengths [m].

    Raises ValueError for a tube without wall.

    >>> gt.compliance.tube(70e9, outer=0.040, inner=0.036, length=[1.0, 2.0]).round(10)
    array([5.980e-08, 1.197e-07])
    """
    if not (modulus > 0 and 0 <= inner < outer):
        raise ValueError(
            f"a tube needs a modulus above 0 and outer > inner diameter; found {modulus}, {outer} and {inner}"
        )
    return np.asarray(length, float) / (modulus * np.pi / 4 * (outer**2 - inner**2))


def _each(value: ArrayLike, count: int, name: str) -> Array:
    array = np.asarray(value, float)
    if array.ndim and array.size != count:
        raise ValueError(f"{name} has {array.size} numbers; expected one, or {count}")
    return np.broadcast_to(array, (count,)).astype(float)


STANDS = 1e-6  # relative motion of a cart joint per axis, below which the axis does not move it


@dataclass(frozen=True, eq=False)
class LinkPoses(Poses):
    """n poses of a plate on m links, with p driven axes q on k carts, in world coordinates.

    R (n, 3, 3) of the plate, None if it cannot rotate; moved (n, m, 3, p): Jacobian of each cart joint in the axes [m
    per unit of the axis]; stands_on (m,): the cart of each link. The first k axes move the carts, the others rotate
    joint plates on them.
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
        """Unit vectors (n, m, 3) from cart to plate."""
        return (self.b - self.a) / self.lengths[..., None]

    @property
    def arms(self) -> Array:
        """Vectors (n, m, 3) from T to the plate joints [m]."""
        return self.b - self.T[:, None]

    @property
    def cart_motion(self) -> Array:
        """Motion (n, k, 3) of each cart per unit of its axis: the mean over its links."""
        rows = [[j for j, cart in enumerate(self.stands_on) if cart == i] for i in range(self.carts)]
        return np.stack([self.moved[..., i][:, row].mean(axis=1) for i, row in enumerate(rows)], axis=1)


class LinkGeometry:
    """Compiled functions of a robot that compute `LinkPoses`.

    model: links are parts with L, ends a and b and a `tension`, as mechanics.Rod; axes are `q`, the tool centre point
    is `T`, and the orientation `R` if the plate can rotate. Raises ModelError for a robot without these, and for a link
    that is not on a cart.

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
            raise ModelError(f"expected a robot with a plate T on links and axes q; {what}")
        self.turns = "R" in flat.groups
        names = [f"{n}.{end}.r" for n in self.links for end in "ab"]
        self._inverse = _inverse(model, ["q", *(["R"] if self.turns else []), *names])
        self._joints = compile_causal(model, known="q", targets=names[0::2])
        if len(self._joints.inputs) != 1:
            raise ModelError(
                "the cart joints must be functions of q only; "
                f"they also depend on {', '.join(s.name for s in self._joints.inputs[1:])}"
            )
        self._stands_on = self._carts(flat.groups["q"][0][0])
        self._e = np.asarray(getattr(model, "home_e", [1.0, 0.0, 0.0, 0.0]), float)

    def __call__(self, T: ArrayLike) -> LinkPoses:
        """Poses at T (n, 3) [m]; a plate that can rotate keeps the orientation of its home."""
        T = np.atleast_2d(np.asarray(T, float))
        inputs = [T] if len(self._inverse.inputs) == 1 else [T, np.tile(self._e, (len(T), 1))]
        q, *rest, status = self._inverse(*inputs)
        R = rest.pop(0) if self.turns else None
        a, b = np.stack(rest[0::2], axis=1), np.stack(rest[1::2], axis=1)
        n, p = q.shape
        good = status == Status.OK
        jacobians = np.full((n, len(self.links), 3, p), np.nan)
        if good.any():
            jacobian, code = self._joints.jacobian(q[good])
            jacobians[good] = jacobian.reshape(len(jacobian), len(self.links), 3, p)
            status = np.array(status)
            status[good] = code
        return LinkPoses(T, q, a, b, status, R, jacobians, self._stands_on)

    def _carts(self, axes: int) -> tuple[int, ...]:
        jacobian, _ = self._joints.jacobian(np.zeros(axes))
        size = np.abs(jacobian.reshape(len(self.links), 3, axes)).max(axis=1)
        moves = size > STANDS * size.max()
        carts = [int(np.argmax(row)) for row in moves]
        if not moves.any(axis=1).all() or sorted(set(carts)) != list(range(max(carts) + 1)):
            raise ModelError("each link must be on one cart, and the first axes must move the carts")
        return tuple(carts)


def _inverse(model: Model, targets: list[str]) -> CausalFunction:
    inverse = compile_causal(model, known="T", targets=targets) if _alone(model) else None
    if inverse is None or len(inverse.inputs) > 1:
        inverse = compile_causal(model, known=["T", "e"], targets=targets)
    return inverse


def _alone(model: Model) -> bool:
    """Whether T determines the pose: as many axes as coordinates of T."""
    flat = flat_of(model)
    return flat.groups["q"][0] == (3,)


SINGULAR = 1e-9  # ratio of smallest to largest singular value of U below which a pose is singular


@dataclass(frozen=True, eq=False)
class LinkStructure:
    """n poses of a robot whose plate has as many links as degrees of freedom d: 3 for a point mass, else 6.

    With the unit link vectors as rows of U (d, d), link forces n balance a load F on the plate, U'n = F, and links
    lengthen by n/k: C = U^-1 diag(1/k) U^-T. The displacement of a cart on its springs moves the ends of its links,
    which adds U^-1 G diag(1/k) G' U^-T, with G (d, s) the lengthening of links per motion of a support. First order,
    about the unloaded pose: the rotation of links under their own force (stiffness n/L beside k) is neglected. Axes
    keep their positions.

    Coordinates: of the plate [m, rad], then along, across and across each guideway [m], then rotary axes [rad].
    Poses without a solution, and singular ones, are NaN. Raises ValueError if the numbers of links and of degrees of
    freedom differ.

    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> poses = gt.compliance.LinkGeometry(robot)(robot.home)
    >>> s = gt.compliance.LinkStructure(poses, gt.compliance.LinkSprings(link=5e-8, drive=1e-7))
    >>> C = s.compliance()[0]  # m/N
    >>> np.allclose(s.deflection([0, 0, -100.0])[0], C @ [0, 0, -100.0])
    True
    """

    poses: LinkPoses
    springs: LinkSprings
    plate: Array = field(init=False, repr=False)  # (n, m, 3, d) motion of plate joints per motion of the plate
    support: Array = field(init=False, repr=False)  # (n, m, 3, s) motion of cart joints per motion of supports
    frames: Array = field(init=False, repr=False)  # (n, k, 3, 3) rows along, across, across each guideway

    def __post_init__(self) -> None:
        p = self.poses
        n, m, _ = p.a.shape
        plate = np.tile(np.eye(3), (n, m, 1, 1))
        if p.R is not None:
            plate = np.concatenate([plate, -cross_matrix(p.arms)], axis=3)
        if m != plate.shape[3]:
            raise ValueError(
                f"found {m} links on a plate with {plate.shape[3]} degrees of freedom; expected equal numbers"
            )
        w = p.cart_motion
        size = np.linalg.norm(w, axis=2)
        frames = _frames(w / size[..., None])
        k = p.carts
        support = np.zeros((n, m, 3, 3 * k + p.q.shape[1] - k))
        for j, i in enumerate(p.stands_on):
            support[:, j, :, 3 * i] = p.moved[:, j, :, i] / size[:, i, None]
            support[:, j, :, 3 * i + 1 : 3 * i + 3] = np.swapaxes(frames[:, i, 1:], 1, 2)
        support[..., 3 * k :] = p.moved[..., k:]
        for name, value in (("plate", plate), ("support", support), ("frames", frames)):
            object.__setattr__(self, name, value)

    @property
    def degrees_of_freedom(self) -> int:
        """Number d of degrees of freedom of the plate."""
        return self.plate.shape[3]

    @cached_property
    def U(self) -> Array:
        """Lengthening (n, d, d) of the links per motion of the plate; NaN if singular."""
        U = np.einsum("nmi,nmid->nmd", self.poses.directions, self.plate)
        finite = np.isfinite(U).all(axis=(1, 2))
        size = np.ones(self.degrees_of_freedom)
        if finite.any() and self.degrees_of_freedom > 3:  # scale rotations by the size of the plate
            size[3:] = 1 / max(np.linalg.norm(self.poses.arms[finite], axis=2).max(), 1e-12)
        s = np.linalg.svd(np.where(finite[:, None, None], U, 0.0) * size, compute_uv=False)
        return np.where((finite & (s[:, -1] > SINGULAR * s[:, 0]))[:, None, None], U, np.nan)

    @cached_property
    def G(self) -> Array:
        """Shortening (n, d, s) of the links per motion of the supports."""
        return np.einsum("nmi,nmis->nms", self.poses.directions, self.support)

    @cached_property
    def by_group(self) -> dict[str, Array]:
        """Compliances of each group of springs, one per link and support."""
        p = self.poses
        return self.springs.by_group(p.a.shape[1], p.carts, p.q.shape[1] - p.carts)

    @cached_property
    def total(self) -> Array:
        """Compliances (d + s,) of links and supports."""
        return sum(self.by_group.values(), np.zeros(1))

    @cached_property
    def carried(self) -> Array:
        """Motion (n, d, d + s) of the plate per stretch of each link and motion of each support."""
        U = self.U
        good = np.isfinite(U).all(axis=(1, 2))
        forces = np.full((*U.shape[:2], len(self.total)), np.nan)
        eye = np.broadcast_to(np.eye(self.degrees_of_freedom), U[good].shape)
        forces[good] = np.linalg.solve(U[good], np.concatenate([eye, self.G[good]], axis=2))
        return forces

    def compliance(self, group: str | None = None) -> Array:
        """Return C (n, d, d) [m/N, rad/N, rad/(N.m)] about T, of all springs or of one group of GROUPS."""
        c = self.total if group is None else self.by_group[group]
        return (self.carried * c) @ np.swapaxes(self.carried, 1, 2)

    def spring_forces(self, wrench: ArrayLike, on_supports: ArrayLike = 0.0) -> Array:
        """Return (n, d + s): tension of each link [N] and force on each support [N, N.m].

        The load (d,) or (n, d) acts on the plate at T, `on_supports` (n, s) on the supports. Raises ValueError for a
        load that is not finite."""
        load = np.broadcast_to(np.asarray(wrench, float), self.U.shape[:2])
        # a pose without a solution may have a load of NaN; its results are NaN too
        bad = np.flatnonzero(~np.isfinite(load).all(axis=1) & np.isfinite(self.U).all(axis=(1, 2)))
        if len(bad):
            raise ValueError(f"the load of pose {bad[0]} is {load[bad[0]].tolist()}; expected finite numbers")
        f = np.einsum("nds,nd->ns", self.carried, load)
        f[:, self.degrees_of_freedom :] += on_supports
        return f

    def deflection(self, wrench: ArrayLike, on_supports: ArrayLike = 0.0) -> Array:
        """Return the displacement (n, d) [m, rad] of the plate under that load."""
        return np.einsum("nds,ns->nd", self.carried, self.total * self.spring_forces(wrench, on_supports))

    def shares(self, wrench: ArrayLike) -> dict[str, Array]:
        """Return the share of the work of a load (n,) for each group of springs.

        The shares sum to 1; they are NaN if everything is rigid.
        """
        f = self.spring_forces(wrench) ** 2
        whole = f @ self.total
        return {name: f @ self.by_group[name] / whole for name in GROUPS}

    def stiffness(self) -> Array:
        """Return K (n, d + s, d + s) of plate and supports; rigid supports have infinite diagonal elements.

        Raises ValueError for rigid links."""
        d = self.degrees_of_freedom
        if np.any(self.total[:d] == 0):
            raise ValueError("rigid links have no finite stiffness; give each a compliance above 0")
        W = np.concatenate([self.U, -self.G], axis=2)
        K = np.swapaxes(W, 1, 2) @ (W / self.total[:d, None])
        with np.errstate(divide="ignore"):
            K[:, range(d, len(self.total)), range(d, len(self.total))] += 1 / self.total[d:]
        return K


def _frames(along: Array) -> Array:
    """Orthonormal rows (n, k, 3, 3), the first along the guideway, the second as horizontal as possible."""
    up = np.where(np.abs(along[..., 2:]) < 0.9, [0.0, 0.0, 1.0], [1.0, 0.0, 0.0])
    second = np.cross(up, along)
    second /= np.linalg.norm(second, axis=-1, keepdims=True)
    return np.stack([along, second, np.cross(along, second)], axis=-2)
