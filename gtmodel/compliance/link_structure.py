"""Stiffness of a plate on links: from springs of links, joints, drives, carts and frame to compliance at the tool."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from ..geometry.rotations import cross_matrix
from .link_poses import LinkPoses
from .link_springs import GROUPS, LinkSprings

Array = np.ndarray
SINGULAR = 1e-9  # least to greatest singular value of U below which a pose holds nothing


@dataclass(frozen=True, eq=False)
class LinkStructure:
    """n poses of a robot whose plate hangs on as many links as it has degrees of freedom d: 3 for a point mass, else 6.

    With the unit link vectors as rows of U (d, d), link forces n balance a load F on the plate, U'n = F, and links
    lengthen by n/k: C = U^-1 diag(1/k) U^-T. The displacement of a cart on its springs moves the ends of its links,
    which adds U^-1 G diag(1/k) G' U^-T with G (d, s) the lengthening of links per motion of a support. First order,
    about the unloaded pose: the turning of links under their own force, n/L beside k, is left out. Axes hold still.

    Coordinates: of the plate [m, rad], then along, across and across each guideway [m], then rotary axes [rad].
    Poses without a solution, and singular ones, are NaN. Raises ValueError where the numbers of links and of degrees of
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
                f"found {m} links on a plate with {plate.shape[3]} degrees of freedom; expected as many of both"
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
        """d, degrees of freedom of the plate."""
        return self.plate.shape[3]

    @cached_property
    def U(self) -> Array:
        """(n, d, d) lengthening of the links per motion of the plate; NaN where singular."""
        U = np.einsum("nmi,nmid->nmd", self.poses.directions, self.plate)
        finite = np.isfinite(U).all(axis=(1, 2))
        size = np.ones(self.degrees_of_freedom)
        if finite.any() and self.degrees_of_freedom > 3:  # rotations in the size of the plate
            size[3:] = 1 / max(np.linalg.norm(self.poses.arms[finite], axis=2).max(), 1e-12)
        s = np.linalg.svd(np.where(finite[:, None, None], U, 0.0) * size, compute_uv=False)
        return np.where((finite & (s[:, -1] > SINGULAR * s[:, 0]))[:, None, None], U, np.nan)

    @cached_property
    def G(self) -> Array:
        """(n, d, s) shortening of the links per motion of the supports."""
        return np.einsum("nmi,nmis->nms", self.poses.directions, self.support)

    @cached_property
    def by_group(self) -> dict[str, Array]:
        """Compliances of each group of springs; one for each link and support."""
        p = self.poses
        return self.springs.by_group(p.a.shape[1], p.carts, p.q.shape[1] - p.carts)

    @cached_property
    def total(self) -> Array:
        """Compliances (d + s,) of links and supports."""
        return sum(self.by_group.values(), np.zeros(1))

    @cached_property
    def carried(self) -> Array:
        """(n, d, d + s) motion of the plate per stretch of each link and motion of each support."""
        U = self.U
        good = np.isfinite(U).all(axis=(1, 2))
        forces = np.full((*U.shape[:2], len(self.total)), np.nan)
        eye = np.broadcast_to(np.eye(self.degrees_of_freedom), U[good].shape)
        forces[good] = np.linalg.solve(U[good], np.concatenate([eye, self.G[good]], axis=2))
        return forces

    def compliance(self, group: str | None = None) -> Array:
        """C (n, d, d) [m/N, rad/N, rad/(N.m)] about T, of all springs or of one group of GROUPS."""
        c = self.total if group is None else self.by_group[group]
        return (self.carried * c) @ np.swapaxes(self.carried, 1, 2)

    def spring_forces(self, wrench: ArrayLike, on_supports: ArrayLike = 0.0) -> Array:
        """(n, d + s): pull of each link [N] and force on each support [N, N.m] under a load (d,) or (n, d) on the
        plate at T and forces on supports (n, s). Raises ValueError for a load that is not finite."""
        load = np.broadcast_to(np.asarray(wrench, float), self.U.shape[:2])
        # a pose without a solution has no load either: its row is NaN, as all that follows from it
        bad = np.flatnonzero(~np.isfinite(load).all(axis=1) & np.isfinite(self.U).all(axis=(1, 2)))
        if len(bad):
            raise ValueError(f"the load of pose {bad[0]} is {load[bad[0]].tolist()}; expected finite numbers")
        f = np.einsum("nds,nd->ns", self.carried, load)
        f[:, self.degrees_of_freedom :] += on_supports
        return f

    def deflection(self, wrench: ArrayLike, on_supports: ArrayLike = 0.0) -> Array:
        """(n, d) [m, rad] of the plate under that load."""
        return np.einsum("nds,ns->nd", self.carried, self.total * self.spring_forces(wrench, on_supports))

    def shares(self, wrench: ArrayLike) -> dict[str, Array]:
        """Share of the work of a load (n,) that each group of springs takes.

        The shares sum to 1, and are NaN where everything is rigid.
        """
        f = self.spring_forces(wrench) ** 2
        whole = f @ self.total
        return {name: f @ self.by_group[name] / whole for name in GROUPS}

    def stiffness(self) -> Array:
        """K (n, d + s, d + s) of plate and supports; a rigid support has no number: its rows are infinite on the
        diagonal. Raises ValueError for rigid links."""
        d = self.degrees_of_freedom
        if np.any(self.total[:d] == 0):
            raise ValueError("links that are rigid have no stiffness; give each a compliance above 0")
        W = np.concatenate([self.U, -self.G], axis=2)
        K = np.swapaxes(W, 1, 2) @ (W / self.total[:d, None])
        with np.errstate(divide="ignore"):
            K[:, range(d, len(self.total)), range(d, len(self.total))] += 1 / self.total[d:]
        return K


def _frames(along: Array) -> Array:
    """Orthonormal rows (n, k, 3, 3), the first along; the second as level as can be."""
    up = np.where(np.abs(along[..., 2:]) < 0.9, [0.0, 0.0, 1.0], [1.0, 0.0, 0.0])
    second = np.cross(up, along)
    second /= np.linalg.norm(second, axis=-1, keepdims=True)
    return np.stack([along, second, np.cross(along, second)], axis=-2)
