"""Stability lobes of regenerative chatter: zeroth-order, in closed form (Altintas and Budak 1995)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from .cutter import Cutter
from .directional import mean_directional_matrix, plane, receptance_in_plane
from .oscillators import Oscillators

LOBES = 40


@dataclass(frozen=True, eq=False)
class Lobes:
    """Limits of stability: spindle speed [1/s], axial depth [m], chatter frequency [Hz], lobe number and branch, one
    point each; neighbours of the same lobe and branch are joined. The least depth of a speed counts, `depth_at`."""

    speed: np.ndarray
    depth: np.ndarray
    frequency: np.ndarray
    lobe: np.ndarray
    branch: np.ndarray

    def depth_at(self, speed: ArrayLike) -> np.ndarray:
        """Greatest stable axial depth (n,) [m] at spindle speeds (n,) [1/s]; infinite where no lobe limits it.

        Where slow speeds need lobes beyond the last one, the least depth that these may reach counts.
        """
        speeds = np.asarray(speed, float).ravel()
        best = np.full(len(speeds), np.inf)
        joined = (np.diff(self.branch) == 0) & (np.diff(self.lobe) == 0) & (np.diff(self.speed) != 0)
        n, a = (np.stack([x[:-1][joined], x[1:][joined]]) for x in (self.speed, self.depth))
        n, a = (x[:, (n.min(axis=0) <= speeds.max()) & (n.max(axis=0) >= speeds.min())] for x in (n, a))
        for i, at in enumerate(speeds):
            here = (n.min(axis=0) <= at) & (at <= n.max(axis=0))
            if here.any():
                (n0, n1), (a0, a1) = n[:, here], a[:, here]
                best[i] = (a0 + (at - n0) / (n1 - n0) * (a1 - a0)).min()
        # a point of the last lobe that is faster than a speed belongs to a further lobe there
        last = np.flatnonzero(self.lobe == self.lobe.max(initial=0))
        last = last[np.argsort(-self.speed[last], kind="stable")]
        least = np.minimum.accumulate(np.append(np.inf, self.depth[last]))
        return np.minimum(best, least[np.searchsorted(-self.speed[last], -speeds)])


def stability_lobes(
    oscillators: Oscillators, cutter: Cutter, mode: str, radial_depth: float, feed: ArrayLike, *,
    up: ArrayLike = (0.0, 0.0, 1.0), lobes: int = LOBES, frequencies: ArrayLike | None = None,
) -> Lobes:  # fmt: skip
    """Lobes 0 to `lobes` of one pose; the helix does not matter in this approximation, the pitch is taken as even.

    a (1 - exp(-j w T)) must be the inverse of an eigenvalue of the receptance times the mean directional matrix.
    frequencies [Hz]: of chatter, tried in turn; near each mode if left out. Good where teeth overlap much; with few
    teeth and narrow cuts period-doubling lobes are missing, see `semi_discretisation`. Raises ValueError for a
    radial depth beyond the diameter.
    """
    D, P = mean_directional_matrix(cutter, mode, radial_depth), plane(feed, up)
    w = 2 * np.pi * (_around(oscillators) if frequencies is None else np.asarray(frequencies, float))
    eigenvalues = np.linalg.eigvals(receptance_in_plane(oscillators, w, P) @ D)
    eigenvalues = eigenvalues[np.arange(len(w))[:, None], np.argsort(eigenvalues.imag, axis=1)]
    rows = []
    with np.errstate(divide="ignore", invalid="ignore"):
        needed = 1 / eigenvalues
    for branch in range(2):
        value = needed[:, branch]
        good = np.isfinite(value) & (value.real > 0)
        kappa = value.imag[good] / value.real[good]
        depth = value.real[good] * (1 + kappa**2) / 2
        phase = 2 * np.arctan2(1, kappa)
        # pieces of the curve that are apart must not be joined
        piece = np.cumsum(np.diff(np.flatnonzero(good), prepend=-1) > 1)
        for lobe in range(lobes + 1):
            period = (phase + 2 * np.pi * lobe) / w[good]
            label = branch + 2 * piece
            rows.append(np.stack([1 / (cutter.teeth * period), depth, w[good] / (2 * np.pi),
                                  np.full_like(depth, lobe), label]))  # fmt: skip
    return Lobes(*np.concatenate(rows, axis=1))


def _around(o: Oscillators) -> np.ndarray:
    """Chatter frequencies [Hz] from a fifth of the lowest mode to five times the highest, denser near each."""
    f, zeta = o.frequency[0], o.damping_ratio[0]
    wide = np.geomspace(f.min() / 5, 5 * f.max(), 800)
    near = f[:, None] * (1 + zeta[:, None] * np.linspace(-12, 24, 361))
    return np.unique(np.concatenate([wide, near[near > 0].ravel()]))
