"""Three revolute axes in general position that bring a point to its place, and a spherical wrist: Pieper's quartic.

Such arms may be cuspidal: they change posture without a singular position, so that the roots have no names.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .chain import Chain
from .closed import closed_form
from .numerical import SOLVED, polished
from .structure import EXACT, common_point

SAMPLES = np.arange(5) * 2 * np.pi / 5  # angles that determine a trigonometric polynomial of degree two
PROBES = 16  # random postures that an arm must find
ON_CIRCLE = 1e-3  # distance from the unit circle of roots that may be real angles; two that nearly meet lose digits


@dataclass(frozen=True, eq=False)
class QuarticArm:
    """`chain` in the order in which it is solved, from the end if `reverse`; `point` is the wrist or the end."""

    chain: Chain
    reverse: bool
    point: np.ndarray

    @staticmethod
    def of(chain: Chain, oriented: bool) -> QuarticArm | None:
        """Return the arm if it has six revolute joints and a spherical wrist, or three joints and T alone."""
        if not all(chain.revolute) or len(chain) != (6 if oriented else 3):
            return None
        if not oriented:
            return QuarticArm(chain, False, chain.T)._checked(chain, oriented)
        for ordered, reverse in ((chain, False), (chain.reversed(), True)):
            sines = np.linalg.norm(np.cross(ordered.axes[3:5], ordered.axes[4:]), axis=1)
            if sines.min() > 1e-3:
                point = common_point(ordered.axes[3:], ordered.points[3:])
                off = np.cross(ordered.axes[3:], point - ordered.points[3:])
                if np.linalg.norm(off, axis=1).max() < EXACT * chain.size:
                    return QuarticArm(ordered, reverse, point)._checked(chain, oriented)
        return None

    def _checked(self, home: Chain, oriented: bool) -> QuarticArm | None:
        """Return the arm if it finds random postures again; None if the quartic is degenerate."""
        q = np.random.default_rng(2).uniform(-np.pi, np.pi, (PROBES, len(home)))
        T, R = home.pose(q)
        apart = np.abs(np.exp(1j * self.postures(home, T, R if oriented else None)) - np.exp(1j * q[:, None])).max(
            axis=2
        )
        share = (np.where(np.isnan(apart), np.inf, apart).min(axis=1) < 1e-6).mean()
        return self if share > 0.8 else None

    def postures(self, home: Chain, T: np.ndarray, R: np.ndarray | None) -> np.ndarray:
        """Return q (m, 4 or 8, n) of poses of the chain `home`, NaN where there is none."""
        if R is None:
            return self._arm(T)
        X = R @ home.R.T
        p = T - X @ home.T
        if self.reverse:
            X = X.transpose(0, 2, 1)
            p = -(X @ p[:, :, None])[:, :, 0]
        arm = self._arm(X @ self.point + p)
        m = len(T)
        flat = np.nan_to_num(arm.reshape(-1, 3))
        turned = Chain(self.chain.axes[:3], self.chain.points[:3]).exponentials(flat)[0][-1]
        hand = closed_form(Chain(self.chain.axes[3:], np.zeros((3, 3))))
        assert hand is not None
        last = hand.values(np.zeros((4 * m, 3)), turned.transpose(0, 2, 1) @ np.repeat(X, 4, axis=0))[0]
        q = np.concatenate([np.repeat(arm.reshape(-1, 1, 3), 2, axis=1), last], axis=2).reshape(m, 8, 6)
        return -q[:, :, ::-1] if self.reverse else q

    def _arm(self, place: np.ndarray) -> np.ndarray:
        """Return q (m, 4, 3) that bring the point to places (m, 3)."""
        (h1, h2, h3), (o1, o2, o3) = self.chain.axes[:3], self.chain.points[:3]
        d, w = o2 - o1, place - o1
        third = Chain([h3], [o3], None, self.point)
        side = np.cross(h2, np.eye(3)[np.argmin(np.abs(h2))])
        side /= np.linalg.norm(side)
        plane = np.array([side, np.cross(h2, side)])
        G = np.linalg.pinv(np.array([plane @ h1, plane @ d]))

        def across(v: np.ndarray) -> np.ndarray:
            """Return R2 v across axis 2 (m, k, 2): it has the height of w over axis 1, and with d its distance."""
            along = v @ h2
            height = (w @ h1 - d @ h1)[:, None] - (h1 @ h2) * along
            distance = ((w * w).sum(axis=1)[:, None] - (v * v).sum(axis=-1) - d @ d) / 2 - (d @ h2) * along
            return np.stack([height, distance], axis=-1) @ G.T

        v = (third.pose(SAMPLES[:, None])[0] - o2)[None]
        excess = (across(v) ** 2).sum(axis=2) - (v * v).sum(axis=2) + (v @ h2) ** 2
        terms = np.fft.fft(excess, axis=1)[:, [2, 1, 0, 4, 3]]  # of e^(2 i q) ... e^(-2 i q)
        companion = np.zeros((len(place), 4, 4), complex)
        companion[:, 1:, :3] = np.eye(3)
        companion[:, 0] = -terms[:, 1:] / np.where(np.abs(terms[:, :1]) > 0, terms[:, :1], 1e-300)
        roots = np.linalg.eigvals(np.where(np.isfinite(companion), companion, 0.0))
        q3 = np.angle(roots)
        v = third.pose(q3.reshape(-1, 1))[0].reshape(len(place), 4, 3) - o2
        z, start = across(v), v @ plane.T
        q2 = np.arctan2(start[..., 0] * z[..., 1] - start[..., 1] * z[..., 0], (start * z).sum(axis=2))
        pair = Chain([h2, h3], [o2, o3], None, self.point)
        x = pair.pose(np.stack([q2, q3], axis=2).reshape(-1, 2))[0].reshape(len(place), 4, 3) - o1
        w = np.broadcast_to(w[:, None], x.shape)
        flat = (x * w).sum(axis=2) - (x @ h1) * (w @ h1)
        q1 = np.arctan2(np.cross(x, w) @ h1, flat)
        q = np.stack([q1, q2, q3], axis=2)
        three = Chain(self.chain.axes[:3], self.chain.points[:3], None, self.point)
        near, off = polished(three, np.repeat(place, 4, axis=0), None, q.reshape(-1, 3))
        good = (off < SOLVED).reshape(-1, 4) & (np.abs(np.abs(roots) - 1) < ON_CIRCLE)
        return np.where(good[..., None], near.reshape(-1, 4, 3), np.nan)
