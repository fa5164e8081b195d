"""Parts of an Estimate from whitened residuals and the Jacobian at the optimum: covariance, rank, null space."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..results.refusal import ArgumentError

# of the largest singular value of the scaled Jacobian: directions below are in the null space
RANK = 1e-9
NO_SIZE = 1e-6  # of the largest nominal value of a unit: files of vendors have six digits, and rounding for their zeros


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Singular values and right vectors of a whitened, scaled Jacobian (priors included), split at the rank."""

    singular: np.ndarray
    V: np.ndarray
    rank: int

    @property
    def inverse(self) -> np.ndarray:
        """Pseudo-inverse of the information of the scaled parameters (n, n)."""
        within = self.V[:, : self.rank] / self.singular[: self.rank]
        return within @ within.T

    @property
    def null(self) -> np.ndarray:
        return self.V[:, self.rank :]


def spectrum(scaled: np.ndarray, tolerance: float = RANK) -> Spectrum:
    """Of a Jacobian (rows, n) with columns in units of the scales; the work is linear in the rows (QR first)."""
    n = scaled.shape[1]
    R = np.linalg.qr(scaled, mode="r") if scaled.shape[0] > n else scaled
    _, s, Vt = np.linalg.svd(R, full_matrices=True)
    s = np.concatenate([s, np.zeros(n - len(s))])
    rank = int(np.count_nonzero(s > tolerance * s[0])) if n and s[0] > 0 else 0
    return Spectrum(s, Vt.T, rank)


def scales(values: np.ndarray | None, n: int, J: np.ndarray) -> np.ndarray:
    """Column scales (n,): those given, or the inverse norm of each column where there is none or zero."""
    given = np.zeros(n) if values is None else np.abs(np.asarray(values, float)).reshape(-1)
    if given.shape != (n,) or not np.all(np.isfinite(given)):
        raise ArgumentError(f"scale has the shape {given.shape}; expected {n} finite numbers, one per parameter")
    norms = np.linalg.norm(J, axis=0) / np.sqrt(max(len(J), 1))
    # what no row sees stays a column of zeros, whatever its scale
    return np.where(given > 0, given, 1 / np.where(norms > 0, norms, 1.0))


def negligible(nominal: np.ndarray, units: Sequence[str]) -> np.ndarray:
    """Which nominal values (p,) are zero, or rounding beside the largest of their unit, as a file or a sum leaves it.

    >>> gt.inference.negligible(np.array([1.9, -2.9e-16, 0.05, 0.0]), ["kg m2"] * 4)
    array([False,  True, False,  True])
    """
    sizes = np.abs(np.asarray(nominal, float))
    largest = [max(x for x, of in zip(sizes, units, strict=True) if of == unit) for unit in units]
    return sizes <= NO_SIZE * np.array(largest)


def nominal_sizes(nominal: np.ndarray, units: Sequence[str]) -> np.ndarray:
    """Sizes (p,) of parameters by nominal values, for ranks and conditions. Where one is negligible, the smallest other
    of its unit stands in; zero where there is none: the column's own length counts then.

    >>> from gtmodel.inference.make_estimate import nominal_sizes
    >>> nominal_sizes(np.array([1.9, -2.9e-16, 0.05, 0.0]), ["kg m2"] * 4)
    array([1.9 , 0.05, 0.05, 0.05])
    """
    sizes, without = np.abs(np.asarray(nominal, float)), negligible(nominal, units)
    for k in np.flatnonzero(without).tolist():
        alike = [x for x, of, no in zip(sizes, units, without, strict=True) if of == units[k] and not no]
        sizes[k] = min(alike, default=0.0)
    return sizes


def carried(T: np.ndarray, C: np.ndarray) -> np.ndarray:
    """Covariance (k, k) of T x, for x of covariance C (n, n).

    From a square root of C: variances are sums of squares then. T @ C @ T.T may leave a small negative number of one
    that is zero, as that of a parameter on which the data say nothing.
    """
    size = np.sqrt(np.maximum(np.diag(C), 0.0))
    size = np.where(size > 0, size, 1.0)
    values, vectors = np.linalg.eigh((C + C.T) / (2 * np.outer(size, size)))
    root = T @ (size[:, None] * vectors * np.sqrt(np.maximum(values, 0.0)))
    return root @ root.T


def freedom_left(rows: int, scaled_data: np.ndarray, inverse: np.ndarray) -> float:
    """Degrees of freedom of the residuals of so many rows: less the trace of the hat matrix, as many parameters as the
    data, not the priors, have fixed."""
    left = rows - float(np.sum((scaled_data @ inverse) * scaled_data))
    return float(round(left)) if abs(left - round(left)) < 1e-6 else left  # a whole number but for rounding


def moved_together(null: np.ndarray, names: tuple[str, ...], least: float = 0.05) -> list[str]:
    """One sentence per null direction of scaled parameters, naming what moves along it."""
    sentences = []
    for column in null.T:
        size = np.abs(column)
        shown = [n for n, w in zip(names, size, strict=True) if w > least * size.max()]
        if len(shown) == 1:
            sentences.append(f"the data do not determine {shown[0]}: nothing measured moves with it")
        else:
            sentences.append(
                f"the data do not determine {listed(shown)} apart from each other: fix one, "
                "or measure what moves only one of them"
            )
    return sentences


def listed(names: Sequence[str]) -> str:
    """ "a", "a and b", "a, b and c"; empty for none."""
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)
