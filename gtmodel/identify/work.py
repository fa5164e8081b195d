"""The work of an identified model: friction must take energy, and what is left over must take none."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtmodel.inference import correlation_time

from .inertia import Identification
from .rows import Rows

Array = np.ndarray

BALANCE = 1e-3  # of the work to and fro: what may be left of a log's energy
DEVIATIONS = 4.0  # or as many standard deviations of the work that noise and the parameters' errors do
ONE_SIGN = 0.98  # of a column's work to and fro: then it is friction's, up to what the filter rounds off at reversals


@dataclass(frozen=True)
class Work:
    """Work over the rows [J]: friction (m,) by target, of the fit without bounds; left: of what the model leaves.

    friction_noise (m,): standard deviations of `friction`. to_and_fro: integral of the sizes of the measured power;
    noise: standard deviation of `left` by the noise of the rows and the errors of the parameters.
    """

    friction: Array
    friction_noise: Array
    left: float
    to_and_fro: float
    noise: float

    @property
    def drives(self) -> Array:
        """Where friction gives energy beyond its noise (m,)."""
        return np.asarray(self.friction < -DEVIATIONS * self.friction_noise)

    @property
    def balance(self) -> float:
        """What is left over the work to and fro."""
        return abs(self.left) / self.to_and_fro

    @property
    def bound(self) -> float:
        """Of the balance: what the notion of a closed balance allows, or what the noise explains."""
        return max(BALANCE, DEVIATIONS * self.noise / self.to_and_fro)

    @property
    def balanced(self) -> bool:
        return self.balance <= self.bound

    def driving(self, targets: tuple[str, ...]) -> list[str]:
        """Where friction would drive, in words."""
        return [
            f"{t}: friction would drive instead of brake, its work is {w:.3g} J; check the sign of this effort or of "
            "its position, and the order of the columns"
            for t, w, drives in zip(targets, self.friction, self.drives, strict=True)
            if drives
        ]

    def unbalanced(self) -> list[str]:
        """What is left over beyond the noise, in words."""
        if self.balanced:
            return []
        return [
            f"{self.left:.3g} J of {self.to_and_fro:.3g} J to and fro are not accounted for, beyond the noise: the "
            "model lacks an effect, or the efforts are delayed"
        ]


def work_of(found: Identification, rows: Rows | None = None) -> Work | None:
    """Of the fit's own rows, or of others; None where the targets are not the efforts along the known coordinates."""
    rows = found.rows if rows is None else rows
    v = rows.velocity
    if v.shape != rows.effort.shape:
        return None
    free = found.unbounded
    share = rows.interval * rows.Y * v[:, :, None]
    sums, sizes = share.sum(axis=0), np.abs(share).sum(axis=0)
    at = [rows.names.index(n) for n in free.names]
    brakes = (sums >= ONE_SIGN * sizes) & ~np.isin(rows.names, rows.signed)
    each = np.where(brakes, sums, 0.0)[:, at]
    everything = sums[:, at].sum(axis=0)
    left = (rows.effort - found.modelled(rows)) * v
    by_noise = correlation_time(found.residuals) * np.sum((found.noise * v) ** 2) * rows.interval**2
    # the residuals of the fit's own rows hold less than their noise, those of others also the parameters' errors
    by_parameters = 0.0 if rows is found.rows else float(everything @ free.covariance @ everything)
    return Work(
        each @ free.values,
        np.sqrt(np.einsum("mi,ij,mj->m", each, free.covariance, each)),
        float(left.sum() * rows.interval),
        float(np.abs(rows.effort * v).sum() * rows.interval),
        float(np.sqrt(by_noise + by_parameters)),
    )
