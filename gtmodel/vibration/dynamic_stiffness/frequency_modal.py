"""Fitted modes of an arm: mass, damping, stiffness and what follows from them, with intervals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...inference import Verdict
from ...results.estimate import Estimate
from ...results.refusal import ArgumentError
from .frequency_modes import ADDED, SHARES, receptance
from .frequency_response import FrequencyResponse


@dataclass(frozen=True, eq=False)
class ModalFit:
    """Modes in parallel, the most compliant at its resonance first.

    m, c, k (modes,) in kg, N.s/m, N/m; `estimate` of their logarithms ("log m[0]", ...), whose covariance is that of
    the noise alone, not of repeated experiments. `response`: the lines that were fitted. `bic`: smaller is better.
    `whiteness` of the residuals along the frequency; `adequacy`: chi-squared of them against a known noise.
    """

    m: np.ndarray
    c: np.ndarray
    k: np.ndarray
    estimate: Estimate
    response: FrequencyResponse
    bic: float
    whiteness: Verdict
    adequacy: Verdict | None
    notes: tuple[str, ...] = ()

    @property
    def fn(self) -> np.ndarray:
        """Undamped natural frequencies sqrt(k/m) / 2 pi (modes,) [Hz]."""
        return np.sqrt(self.k / self.m) / (2 * np.pi)

    @property
    def zeta(self) -> np.ndarray:
        """Damping ratios c / (2 sqrt(k m)) (modes,)."""
        return self.c / (2 * np.sqrt(self.k * self.m))

    @property
    def next_mode(self) -> float | None:
        """Distance from the first mode to the nearest other one [Hz]; None where there is one mode only."""
        return float(np.abs(self.fn[1:] - self.fn[0]).min()) if len(self.m) > 1 else None

    def interval(self, name: str, level: float = 0.95) -> tuple[float, float]:
        """Confidence interval of "m[0]", "c[0]", "k[0]", "fn[0]" [Hz] or "zeta[0]" of the mode with this index, always
        positive. Raises ArgumentError."""
        stem, _, place = str(name).partition("[")
        if not (place.endswith("]") and place[:-1].isdecimal()):
            raise ArgumentError(
                f"there is no '{name}'; expected {', '.join(SHARES)} with an index, as in fn[0]", "name"
            )
        _, low, high = self.estimate.combination(self._weights(stem, int(place[:-1])), level)
        shift = ADDED.get(stem, 0.0)
        return float(np.exp(low + shift)), float(np.exp(high + shift))

    def log_std(self, name: str, mode: int = 0) -> float:
        """Standard deviation of the logarithm of "m", "c", "k", "fn" or "zeta": the relative one."""
        weights = self._weights(name, mode)
        w = np.array([weights.get(n, 0.0) for n in self.estimate.names])
        return float(np.sqrt(w @ self.estimate.covariance @ w))

    def at(self, s: np.ndarray) -> np.ndarray:
        """Receptance (n,) of all modes [m/N] at s (n,) [1/s]."""
        return receptance(s, self.m, self.c, self.k)

    def _weights(self, name: str, mode: int) -> dict[str, float]:
        if name not in SHARES or not 0 <= mode < len(self.m):
            raise ArgumentError(
                f"there is no '{name}' of mode {mode}; expected {', '.join(SHARES)} of 0 to {len(self.m) - 1}", "name"
            )
        return dict(zip((f"log {p}[{mode}]" for p in "mck"), SHARES[name], strict=True))
