"""Robust losses rho(z) of z = (r / width)^2, as scipy.optimize.least_squares names and defines them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..results.refusal import ArgumentError


@dataclass(frozen=True)
class Loss:
    """`rho` and its derivatives `slope` = rho' and `bend` = rho'' for z >= 0.

    rho'(0) = 1, so that small residuals count as squares. `squares`: all do, whatever their size.
    """

    rho: Callable[[np.ndarray], np.ndarray]
    slope: Callable[[np.ndarray], np.ndarray]
    bend: Callable[[np.ndarray], np.ndarray]
    squares: bool = False

    def cost(self, r: np.ndarray, width: float) -> float:
        """Half the sum of width^2 rho((r / width)^2)."""
        return 0.5 * width**2 * float(np.sum(self.rho((r / width) ** 2)))

    def weight(self, r: np.ndarray, width: float) -> np.ndarray:
        """What r is multiplied by so that its square has the loss's gradient."""
        return np.sqrt(self.slope((r / width) ** 2))

    def variance_factor(self, r: np.ndarray, width: float, degrees_of_freedom: float) -> float:
        """Huber's variance for a Jacobian of one: sum psi^2 / degrees of freedom / (mean psi')^2, psi = r rho'.

        Infinite where psi' is not positive in the mean: of residuals that all lie beyond the width none holds the fit.
        """
        z = (r / width) ** 2
        psi = r * self.slope(z)
        sharp = float(np.mean(self.slope(z) + 2 * z * self.bend(z)))
        return float(psi @ psi) / degrees_of_freedom / sharp**2 if sharp > 0 else np.inf


LOSSES = {
    "linear": Loss(lambda z: z, np.ones_like, np.zeros_like, squares=True),
    "huber": Loss(
        lambda z: np.where(z <= 1, z, 2 * np.sqrt(np.maximum(z, 1)) - 1),
        lambda z: 1 / np.sqrt(np.maximum(z, 1)),
        lambda z: np.where(z <= 1, 0.0, -0.5 * np.maximum(z, 1) ** -1.5),
    ),
    "soft_l1": Loss(
        lambda z: 2 * (np.sqrt(1 + z) - 1),
        lambda z: 1 / np.sqrt(1 + z),
        lambda z: -0.5 * (1 + z) ** -1.5,
    ),
    "cauchy": Loss(lambda z: np.log1p(z), lambda z: 1 / (1 + z), lambda z: -1 / (1 + z) ** 2),
}


def loss_named(name: str) -> Loss:
    """Raises ArgumentError for a name that is none of scipy's."""
    if name not in LOSSES:
        raise ArgumentError(f"there is no loss '{name}'; these are: {', '.join(LOSSES)}")
    return LOSSES[name]
