"""Estimated quantities with their covariance: the result of every fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from numbers import Real

import numpy as np

from .refusal import ArgumentError

# a combination is undetermined if its terms along a null direction sum to more than this share of their absolute sum
INSIDE = 1e-6


@dataclass(frozen=True, eq=False)
class Estimate:
    """Estimated quantities with their covariance, in SI units.

    names: free constants, and initial states as "x at the start"; `values` (n,) in the same order.
    covariance: (n, n), from linearised least squares (Gauss-Newton).
    degrees_of_freedom: number of measured values minus number of estimated quantities.
    noise: standard deviation of the residuals, expected to be 1 if sigma was given (`known_noise`).
    held: names at a bound, with `held_values`; they have no covariance.
    null_space: (n, k), one column per direction that the data do not determine, zero for names without a part in it.
        Along it the values stay where the fit left them, `covariance` covers the other directions, and the intervals of
        names with a part in it are infinite.
    units: per name; empty if unknown.
    notes: sentences about the limits of the numbers.

    `interval(name)` returns a confidence interval, `combination(...)` one of a weighted sum. Example: `gt.estimate`.
    """

    names: tuple[str, ...]
    values: np.ndarray
    covariance: np.ndarray
    degrees_of_freedom: float
    noise: float
    known_noise: bool
    residuals: np.ndarray
    held: tuple[str, ...]
    held_values: tuple[float, ...] = ()
    units: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    null_space: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))

    @property
    def std(self) -> np.ndarray:
        """Standard deviations (n,); infinite for names with a part in the null space."""
        std = np.sqrt(np.diag(self.covariance))
        std[self._moving] = np.inf
        return std

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Names with a part in a direction that the data do not determine."""
        return tuple(n for n, moves in zip(self.names, self._moving, strict=True) if moves)

    @property
    def correlation(self) -> np.ndarray:
        """Correlation coefficients (n, n)."""
        std = np.sqrt(np.diag(self.covariance))
        return self.covariance / np.outer(std, std)

    def value(self, name: str) -> float:
        """Return the estimate, or the bound at which it is held. Raises ArgumentError for an unknown name."""
        if name in self.held and self.held_values:
            return self.held_values[self.held.index(name)]
        return float(self.values[self._index(name)])

    def interval(self, name: str, level: float = 0.95) -> tuple[float, float]:
        """Return a confidence interval: normal if sigma was given, otherwise Student's t with `degrees_of_freedom`.
        Raises ArgumentError."""
        low, high = self.intervals([name], level)
        return float(low[0]), float(high[0])

    def intervals(self, names: Sequence[str] | None = None, level: float = 0.95) -> tuple[np.ndarray, np.ndarray]:
        """Return confidence limits (n,), (n,) of the names, or of all, see `interval`. Raises ArgumentError."""
        k = [self._index(name) for name in (self.names if names is None else names)]
        half = self._quantile(level) * self.std[k]
        return self.values[k] - half, self.values[k] + half

    def combination(self, weights: Mapping[str, float], level: float = 0.95) -> tuple[float, float, float]:
        """Return value and confidence limits of sum weights[name] * name; infinite if the data do not determine it.

        Raises ArgumentError for a name that was not estimated.
        """
        w = np.zeros(len(self.names))
        for name, weight in weights.items():
            w[self._index(name)] = weight
        value = float(w @ self.values)
        if self.null_space.size:
            along = np.abs(w @ self.null_space)
            if np.any(along > INSIDE * (np.abs(w) @ np.abs(self.null_space))):
                return value, -np.inf, np.inf
        half = self._quantile(level) * float(np.sqrt(w @ self.covariance @ w))
        return value, value - half, value + half

    @property
    def _moving(self) -> np.ndarray:
        return np.abs(self.null_space).max(axis=1) > 0 if self.null_space.size else np.zeros(len(self.names), bool)

    def _index(self, name: str) -> int:
        if name not in self.names:
            raise ArgumentError(f"'{name}' was not estimated; these were: {', '.join(self.names)}", "name")
        return self.names.index(name)

    def _quantile(self, level: float) -> float:
        if not isinstance(level, Real) or not 0 < level < 1:
            raise ArgumentError(f"expected a confidence level between 0 and 1; found {level!r}", "level")
        return half_width(float(level), None if self.known_noise else float(self.degrees_of_freedom))

    def __str__(self) -> str:
        width = max(len(n) for n in self.names)
        lines = [f"{'':{width}s}  {'value':>14s}  {'std':>10s}  95 % interval"]
        std = self.std
        for k, name in enumerate(self.names):
            low, high = self.interval(name)
            unit = f" {self.units[k]}" if self.units and self.units[k] else ""
            lines.append(f"{name:{width}s}  {self.values[k]:14.7g}  {std[k]:10.3g}  {low:.7g} .. {high:.7g}{unit}")
        lines += [f"{name} is held at its bound" for name in self.held]
        lines += self.notes
        return "\n".join([*lines, f"{len(self.residuals)} measured values, residual noise {self.noise:.4g}"])


@cache
def half_width(level: float, degrees_of_freedom: float | None = None) -> float:
    """Return half the width of a confidence interval in standard deviations: normal, or Student's t if the standard
    deviation is estimated with `degrees_of_freedom`.

    >>> from gtmodel.results.estimate import half_width
    >>> round(half_width(0.95), 2), round(half_width(0.95, 5), 2)
    (1.96, 2.57)
    """
    import scipy  # here: a schema names the class but does not need scipy

    # scipy.stats has the same two functions, but takes as long to import as all of gtmodel
    if degrees_of_freedom is None:
        return float(scipy.special.ndtri((1 + level) / 2))
    return float(scipy.special.stdtrit(degrees_of_freedom, (1 + level) / 2))
