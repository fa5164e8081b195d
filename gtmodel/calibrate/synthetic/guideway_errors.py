"""Synthetic deviations of a cart from its straight guideway: smooth bends, a cyclic error of the transmission."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...geometry.rotations import right_handed

WAVES = 5  # of the smooth part: the longest is twice the range, the shortest two fifths of it
FINE = 2001  # points over the range at which sizes are set


@dataclass(frozen=True, eq=False)
class GuidewayError:
    """Deviation e(q) (n, 3) [m] of a point from A + q v, in world coordinates: a synthetic guideway error.

    Smooth random waves across and along `direction`, of which no straight line is left over `low`..`high`, with the
    means `along` and `across` [m] of |e_par| and |e_perp| there (as Dressler 2012, Table 4.2, gives them); and a sine
    of the amplitude `cyclic` [m] and the `period` [m] along it (section 4.2).
    """

    direction: np.ndarray
    low: float
    high: float
    along: float
    across: float
    cyclic: float
    period: float
    seed: np.random.SeedSequence

    def __call__(self, q: np.ndarray) -> np.ndarray:
        rng = np.random.default_rng(self.seed)
        amplitude = rng.standard_normal((3, WAVES)) / np.arange(1, WAVES + 1)
        phase = rng.uniform(0, 2 * np.pi, (3, WAVES + 1))
        fine = np.linspace(self.low, self.high, FINE)
        smooth, base = self._waves(q, amplitude, phase), self._waves(fine, amplitude, phase)
        for k in range(3):
            line = np.polynomial.Polynomial.fit(fine, base[k], 1)
            smooth[k], base[k] = smooth[k] - line(q), base[k] - line(fine)
        axes = right_handed(self.direction)
        sizes = np.mean(np.abs(base[0])), np.mean(np.hypot(base[1], base[2]))
        scale = np.array([self.along / sizes[0], *[self.across / sizes[1]] * 2])
        turn = 2 * np.pi * np.asarray(q, float) / self.period + phase[0, WAVES]
        return (scale[:, None] * smooth).T @ axes + self.cyclic * np.sin(turn)[:, None] * axes[0]

    def _waves(self, q: np.ndarray, amplitude: np.ndarray, phase: np.ndarray) -> np.ndarray:
        s = np.pi * (np.asarray(q, float) - self.low) / (self.high - self.low)
        k = np.arange(1, WAVES + 1)
        return np.sum(amplitude[:, :, None] * np.sin(k[:, None] * s + phase[:, :WAVES, None]), axis=1)
