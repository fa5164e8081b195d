"""Covariance functions of a Gaussian process over poses: distances in units of lengths, one per input."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

Shape = Literal["squared_exponential", "matern_5_2"]


@dataclass(frozen=True)
class KernelInputs:
    """How a pose (d,) becomes coordinates (e,): each divided by its scale, or round a circle.

    scale (d,): typical lengths, in the inputs' own units. `periodic` (d,): angles [rad] of period 2 pi; they become
    cosine and sine, which share one length (the scale divides the chord), so that the covariance has the period too.

    >>> inputs = gt.vibration.KernelInputs(scale=(0.5, 1.0), periodic=(False, True))
    >>> inputs.coordinates(np.array([[1.0, np.pi]])).round(3)  # the angle becomes cosine and sine
    array([[ 2., -1., 0.]])
    """

    scale: tuple[float, ...]
    periodic: tuple[bool, ...]

    def __post_init__(self) -> None:
        if len(self.scale) != len(self.periodic) or not self.scale:
            raise ValueError(
                f"{len(self.scale)} scales and {len(self.periodic)} periods; expected one of each per input"
            )
        if not all(np.isfinite(s) and s > 0 for s in self.scale):
            raise ValueError(f"found the scales {self.scale}; expected finite numbers above zero")

    @property
    def owners(self) -> tuple[int, ...]:
        """The input that each coordinate comes from (e,)."""
        return tuple(i for i, round_ in enumerate(self.periodic) for _ in range(1 + round_))

    def coordinates(self, pose: np.ndarray) -> np.ndarray:
        """(n, d) -> (n, e)."""
        return np.stack([c for i in range(len(self.scale)) for c in self._of(pose[:, i], i, np)], axis=1)

    def symbols(self, pose: Any) -> list[Any]:
        """The same of a CasADi vector (d,): a list of e expressions."""
        import casadi as ca

        return [c for i in range(len(self.scale)) for c in self._of(pose[i], i, ca)]

    def _of(self, x: Any, i: int, lib: Any) -> list[Any]:
        return [lib.cos(x) / self.scale[i], lib.sin(x) / self.scale[i]] if self.periodic[i] else [x / self.scale[i]]


def correlation(r2: np.ndarray, shape: Shape) -> np.ndarray:
    """Correlation at squared scaled distances r2: exp(-r2/2), or Matern 5/2."""
    if shape == "squared_exponential":
        return np.exp(-r2 / 2)
    t = np.sqrt(5 * r2)
    return (1 + t + t * t / 3) * np.exp(-t)


def slope(r2: np.ndarray, shape: Shape) -> np.ndarray:
    """Derivative of correlation() by r2."""
    if shape == "squared_exponential":
        return -np.exp(-r2 / 2) / 2
    t = np.sqrt(5 * r2)
    return -(5 / 6) * (1 + t) * np.exp(-t)


def square_distances(a: np.ndarray, b: np.ndarray, owners: tuple[int, ...]) -> np.ndarray:
    """Squared distances (d, n, m) between coordinates (n, e) and (m, e), by the input that owns them."""
    each = (a[:, None, :] - b[None, :, :]) ** 2
    return np.stack(
        [each[:, :, [k for k, o in enumerate(owners) if o == i]].sum(axis=2) for i in range(max(owners) + 1)]
    )
