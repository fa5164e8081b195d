"""Masses on the springs of a parallel robot: weights, and natural frequencies."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..geometry.rotations import cross_matrix
from .link_structure import LinkStructure

Array = np.ndarray
GRAVITY = (0.0, 0.0, -9.81)


@dataclass(frozen=True, eq=False)
class LinkMasses:
    """Masses of a parallel robot as the models of the catalogue carry them, SI units.

    m_p [kg] of the plate, with its centre of mass c_p (3,) [m] from T and inertia I_p (3, 3) [kg.m2] about that, both
    in plate coordinates; m_c (k,) [kg] of the carts; m_a (m,) [kg] of the links, each at its middle; J [kg.m2] of
    rotary axes.

    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> springs = gt.compliance.LinkSprings(link=5e-8, drive=1e-7)
    >>> s = gt.compliance.LinkStructure(gt.compliance.LinkGeometry(robot)(robot.home), springs)
    >>> gt.compliance.LinkMasses.of(robot).frequencies(s, 2).shape  # Hz
    (1, 2)
    """

    m_p: float
    m_c: Array
    m_a: Array
    c_p: Array = field(default_factory=lambda: np.zeros(3))
    I_p: Array = field(default_factory=lambda: np.zeros((3, 3)))
    J: Array = field(default_factory=lambda: np.zeros(0))

    @classmethod
    def of(cls, model: Any) -> LinkMasses:
        """Those of a model's parameters. Raises ValueError for a model that lacks them."""
        missing = [name for name in ("m_p", "m_c", "m_a") if not hasattr(model, name)]
        if missing:
            raise ValueError(f"the robot has no {', '.join(missing)}; natural frequencies need m_p, m_c and m_a")
        optional = {
            name: np.asarray(getattr(model, name), float) for name in ("c_p", "I_p", "J") if hasattr(model, name)
        }
        return cls(float(model.m_p), np.asarray(model.m_c, float), np.asarray(model.m_a, float), **optional)

    def matrix(self, s: LinkStructure) -> Array:
        """Mass matrix (n, d + s, d + s) in the coordinates of the structure."""
        plate, mid, carts = self._motions(s)
        d = s.degrees_of_freedom
        M = self.m_p * np.swapaxes(plate, 1, 2) @ plate
        M += np.einsum("m,nmis,nmit->nst", self.m_a, mid, mid) + np.einsum("k,nkis,nkit->nst", self.m_c, carts, carts)
        if s.poses.R is not None:
            R = s.poses.R
            M[:, 3:d, 3:d] += R @ self.I_p @ np.swapaxes(R, 1, 2)
        turning = range(M.shape[1] - len(self.J), M.shape[1])
        M[:, turning, turning] += self.J
        return M

    def weight(self, s: LinkStructure, g: Any = GRAVITY) -> Array:
        """Generalised weights (n, d + s) [N, N.m] of gravity g (3,) [m/s2]: on the plate, then on the supports."""
        plate, mid, carts = self._motions(s)
        g = np.asarray(g, float)
        return self.m_p * np.einsum("nis,i->ns", plate, g) + np.einsum("m,nmis,i->ns", self.m_a, mid, g) + np.einsum(
            "k,nkis,i->ns", self.m_c, carts, g)  # fmt: skip

    def sag(self, s: LinkStructure, g: Any = GRAVITY) -> Array:
        """Displacement of the plate (n, d) [m, rad] by all weights."""
        f = self.weight(s, g)
        return s.deflection(f[:, : s.degrees_of_freedom], f[:, s.degrees_of_freedom :])

    def frequencies(self, s: LinkStructure, count: int = 3) -> Array:
        """The `count` lowest natural frequencies (n, count) [Hz] with all axes held by their drives' springs.

        K x = w^2 M x of plate, carts and rotary axes; rigid supports stand still. Raises ValueError for rigid links and
        for a coordinate that is compliant and has no mass.
        """
        K, M = s.stiffness(), self.matrix(s)
        moving = np.concatenate([np.full(s.degrees_of_freedom, True), s.total[s.degrees_of_freedom :] > 0])
        K, M = K[:, moving][:, :, moving], M[:, moving][:, :, moving]
        frequencies = np.full((len(K), min(count, K.shape[1])), np.nan)
        good = np.isfinite(K).all(axis=(1, 2))
        if not good.any():
            return frequencies
        try:
            L = np.linalg.cholesky(M[good])
        except np.linalg.LinAlgError as error:
            raise ValueError("a compliant part has no mass; give plate, carts and rotary axes theirs") from error
        half = np.linalg.solve(L, K[good])
        whole = np.linalg.solve(L, np.swapaxes(half, 1, 2))
        values = np.linalg.eigvalsh((whole + np.swapaxes(whole, 1, 2)) / 2)
        frequencies[good] = np.sqrt(np.maximum(values, 0.0))[:, : frequencies.shape[1]] / (2 * np.pi)
        return frequencies

    def _motions(self, s: LinkStructure) -> tuple[Array, Array, Array]:
        """Motion per coordinate of the plate's centre of mass (n, 3, .), the links' middles (n, m, 3, .) and the carts
        (n, k, 3, .)."""
        p, d = s.poses, s.degrees_of_freedom
        n, m, _, supports = s.support.shape
        if self.m_a.shape != (m,) or self.m_c.shape != (p.carts,):
            raise ValueError(
                f"expected masses of {p.carts} carts and {m} links; found {self.m_c.size}, {self.m_a.size}"
            )
        plate = np.zeros((n, 3, d + supports))
        plate[:, range(3), range(3)] = 1.0
        if p.R is not None:
            plate[:, :, 3:d] = -cross_matrix(p.R @ self.c_p)
        mid = np.concatenate([s.plate, s.support], axis=3) / 2
        carts = np.zeros((n, p.carts, 3, d + supports))
        for i in range(p.carts):
            carts[:, i, :, d + 3 * i : d + 3 * i + 3] = np.swapaxes(s.frames[:, i], 1, 2)
        return plate, mid, carts
