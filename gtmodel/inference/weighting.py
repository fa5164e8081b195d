"""What is known of the noise, rows divided by it, and robust losses rho(z) of z = (r / width)^2."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..results.refusal import ArgumentError


@dataclass(frozen=True)
class Prior:
    """Knowledge of one parameter before the data: a value and its standard deviation, in the parameter's unit.

    Raises ArgumentError for a value that is not finite or a standard deviation that is not positive.

    >>> gt.inference.Prior("m_p", 9.0, std=0.5)
    Prior(name='m_p', value=9.0, std=0.5)
    """

    name: str
    value: float
    std: float

    def __post_init__(self) -> None:
        if not (np.isfinite(self.value) and np.isfinite(self.std) and self.std > 0):
            raise ArgumentError(
                f"the prior of '{self.name}' needs a finite value and a positive standard deviation; found "
                f"{self.value:g} and {self.std:g}"
            )


@dataclass(frozen=True, eq=False)
class Weighting:
    """Whitens rows when called: (rows, ...) -> (rows, ...) of unit variance (`known`), or of equal unknown variance.

    `factor` is None, one number, one per row, or inverse Cholesky factors (blocks, k, k) of blocks of k rows.
    """

    factor: np.ndarray | None
    known: bool

    def __call__(self, rows: np.ndarray) -> np.ndarray:
        f = self.factor
        if f is None:
            return rows
        if f.ndim < 2:
            return rows * f.reshape(-1, *[1] * (rows.ndim - 1))
        blocks, k, _ = f.shape
        return np.matmul(f, rows.reshape(blocks, k, -1)).reshape(rows.shape)


def weighting(
    rows: int,
    *,
    sigma: ArrayLike | None = None,
    weights: ArrayLike | None = None,
    covariance: ArrayLike | None = None,
) -> Weighting:
    """What is known of the noise of so many rows, as a Weighting that divides rows by it.

    At most one is given: `sigma`, standard deviations, one or one per row; `weights`, inverse variances up to a common
    factor that the residuals determine; `covariance` (rows, rows), or (blocks, k, k) for independent blocks of k rows.
    With none all rows weigh alike, and the residuals determine the noise.

    Raises ArgumentError for more than one, a wrong shape, or what is not positive.

    >>> whitened = gt.inference.weighting(3, sigma=[1.0, 2.0, 4.0])
    >>> whitened(np.ones(3)), whitened.known
    (array([1.  , 0.5 , 0.25]), True)
    """
    given = [n for n, v in (("sigma", sigma), ("weights", weights), ("covariance", covariance)) if v is not None]
    if len(given) > 1:
        raise ArgumentError(f"give one of sigma, weights and covariance; found {' and '.join(given)}")
    if covariance is not None:
        return Weighting(_inverse_factors(np.asarray(covariance, float), rows), True)
    if not given:
        return Weighting(None, False)
    values = np.asarray(sigma if sigma is not None else weights, float)
    if values.shape not in ((), (1,), (rows,)):
        raise ArgumentError(f"{given[0]} has the shape {values.shape}; expected one number or {rows}, one per row")
    if not np.all(np.isfinite(values)) or np.any(values <= 0):
        raise ArgumentError(f"{given[0]} must be finite and positive; found {values.min():g}")
    return Weighting(1 / values if sigma is not None else np.sqrt(values), sigma is not None)


def _inverse_factors(covariance: np.ndarray, rows: int) -> np.ndarray:
    blocks = covariance[None] if covariance.ndim == 2 else covariance
    if blocks.ndim != 3 or blocks.shape[1] != blocks.shape[2] or blocks.shape[0] * blocks.shape[1] != rows:
        raise ArgumentError(
            f"covariance has the shape {covariance.shape}; expected ({rows}, {rows}), or (blocks, k, k) with "
            f"blocks * k = {rows}"
        )
    try:
        return np.linalg.inv(np.linalg.cholesky(blocks))
    except np.linalg.LinAlgError:
        raise ArgumentError("covariance is not positive definite; give a variance above zero to every row") from None


def prior_rows(priors: tuple[Prior, ...], names: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Priors as whitened rows (k, n) and right sides (k,). Raises ArgumentError for a name that is not free."""
    place: Mapping[str, int] = {n: i for i, n in enumerate(names)}
    P, p = np.zeros((len(priors), len(names))), np.zeros(len(priors))
    for row, prior in enumerate(priors):
        if prior.name not in place:
            raise ArgumentError(f"a prior names '{prior.name}', which is not free; these are: {', '.join(names)}")
        P[row, place[prior.name]], p[row] = 1 / prior.std, prior.value / prior.std
    return P, p


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
