"""Weighting: noise of the rows and whitening, priors, and robust losses rho(z) of z = (r / width)^2."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..results.refusal import ArgumentError


@dataclass(frozen=True)
class Prior:
    """Prior value of one parameter and its standard deviation, in the parameter's unit.

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
    """Whitens rows when called: (rows, ...) -> (rows, ...) with unit variance (`known`), or equal unknown variance.

    factor: None, one number, one per row, or inverse Cholesky factors (blocks, k, k) of blocks of k rows.
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
    """Make the Weighting that whitens so many rows.

    Give at most one: `sigma`, standard deviations, one or one per row; `weights`, inverse variances up to a common
    factor that the residuals determine; `covariance` (rows, rows), or (blocks, k, k) for independent blocks of k rows.
    Without any, all rows have equal weight, and the residuals determine the noise.

    Raises ArgumentError for more than one, a wrong shape, or values that are not positive.

    >>> whitened = gt.inference.weighting(3, sigma=[1.0, 2.0, 4.0])
    >>> whitened(np.ones(3)), whitened.known
    (array([1.  , 0.5 , 0.25]), True)
    """
    stated = [n for n, v in (("sigma", sigma), ("weights", weights), ("covariance", covariance)) if v is not None]
    if len(stated) > 1:
        raise ArgumentError(f"give one of sigma, weights and covariance; found {' and '.join(stated)}")
    if covariance is not None:
        return Weighting(_inverse_factors(np.asarray(covariance, float), rows), True)
    if not stated:
        return Weighting(None, False)
    values = np.asarray(sigma if sigma is not None else weights, float)
    if values.shape not in ((), (1,), (rows,)):
        raise ArgumentError(f"{stated[0]} has the shape {values.shape}; expected one number or {rows}, one per row")
    if not np.all(np.isfinite(values)) or np.any(values <= 0):
        raise ArgumentError(f"{stated[0]} must be finite and positive; found {values.min():g}")
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
        raise ArgumentError("covariance is not positive definite; give every row a variance above zero") from None


def prior_rows(priors: tuple[Prior, ...], names: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Priors as whitened rows (k, n) and right sides (k,). Raises ArgumentError for a name that is not free."""
    place: Mapping[str, int] = {n: i for i, n in enumerate(names)}
    P, p = np.zeros((len(priors), len(names))), np.zeros(len(priors))
    for row, prior in enumerate(priors):
        if prior.name not in place:
            raise ArgumentError(f"a prior names '{prior.name}', which is not free; expected one of {', '.join(names)}")
        P[row, place[prior.name]], p[row] = 1 / prior.std, prior.value / prior.std
    return P, p


@dataclass(frozen=True)
class Loss:
    """`rho` and its derivatives `slope` = rho' and `bend` = rho'' for z >= 0.

    rho'(0) = 1, so that small residuals count as squares. squares: whether residuals of any size do.
    """

    rho: Callable[[np.ndarray], np.ndarray]
    slope: Callable[[np.ndarray], np.ndarray]
    bend: Callable[[np.ndarray], np.ndarray]
    squares: bool = False

    def cost(self, r: np.ndarray, width: float) -> float:
        """Return half the sum of width^2 rho((r / width)^2)."""
        return 0.5 * width**2 * float(np.sum(self.rho((r / width) ** 2)))

    def weight(self, r: np.ndarray, width: float) -> np.ndarray:
        """Return the factor on r for which its square has the gradient of the loss."""
        return np.sqrt(self.slope((r / width) ** 2))

    def variance_factor(self, r: np.ndarray, width: float, degrees_of_freedom: float) -> float:
        """Return Huber's variance for a Jacobian of one: sum psi^2 / degrees of freedom / (mean psi')^2, psi = r rho'.

        Infinite if the mean of psi' is not positive: residuals beyond the width do not determine the fit.
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
    """The loss of a name. Raises ArgumentError for a name that scipy does not have."""
    if name not in LOSSES:
        raise ArgumentError(f"there is no loss '{name}'; expected one of {', '.join(LOSSES)}")
    return LOSSES[name]
