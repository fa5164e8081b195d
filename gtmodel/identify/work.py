"""The work of an identified model: friction must take energy, and the residuals must take none."""

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
class MechanicalWork:
    """Work over the rows [J], positive where a drive gives it.

    `friction` (m,) is what friction takes, by target, of the fit without bounds, and `friction_noise` (m,) its standard
    deviation. `left` is the work of the residuals, `noise` its standard deviation by the noise of the rows and the
    errors of the parameters. `to_and_fro` is the integral of the size of the measured power.
    """

    friction: Array
    friction_noise: Array
    left: float
    to_and_fro: float
    noise: float

    @property
    def drives(self) -> Array:
        """Where friction would give energy, beyond its noise (m,)."""
        return np.asarray(self.friction < -DEVIATIONS * self.friction_noise)

    @property
    def balance(self) -> float:
        """Size of `left` over the work to and fro."""
        return abs(self.left) / self.to_and_fro

    @property
    def bound(self) -> float:
        """What `balance` may be: a thousandth, or what the noise explains."""
        return max(BALANCE, DEVIATIONS * self.noise / self.to_and_fro)

    @property
    def balanced(self) -> bool:
        """Whether the energy balance closes within its bound."""
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
        """What the residuals take beyond the noise, in words."""
        if self.balanced:
            return []
        return [
            f"{self.left:.3g} J of {self.to_and_fro:.3g} J to and fro are not accounted for, beyond the noise: the "
            "model lacks an effect, or the efforts are delayed"
        ]


def work_of(identification: Identification, rows: Rows | None = None) -> MechanicalWork | None:
    """The work of an identified model over the fit's own rows, or over others.

    None where the targets are not the efforts along the known coordinates, so that their product is no power.

    >>> class Axis(gt.Model):  # a cart with viscous and Coulomb friction
    ...     m, d, c = gt.parameter(2.0, unit="kg"), gt.parameter(5.0, unit="kg/s"), gt.parameter(3.0, unit="N")
    ...     q, tau = gt.variable(unit="m"), gt.variable(unit="N")
    ...     def equations(self):
    ...         v = gt.der(self.q)
    ...         yield self.tau == self.m * gt.der(v) + self.d * v + self.c * gt.sign(v)
    >>> time = 0.004 * np.arange(2000)
    >>> q = gt.identify.multisine(time, np.zeros(1), np.array([0.2]), np.array([0.5, 1.1]), seed=1)[:, 0]
    >>> log = gt.identify.LogSimulator(Axis(), q).draw(1, gt.identify.Sensors(effort_noise=0.5))
    >>> regressor = gt.identify.Regressor(Axis(), ["m", "d", "c"])
    >>> rows = gt.identify.rows_of(gt.measurements.session_of(log), regressor)
    >>> work = gt.identify.work_of(gt.identify.identify(rows))
    >>> work.friction.round(), round(work.to_and_fro), work.balanced  # friction takes 13 J of 15 J to and fro
    (array([13.]), 15, True)
    """
    rows = identification.rows if rows is None else rows
    v = rows.velocity
    if v.shape != rows.effort.shape:
        return None
    free = identification.unbounded
    share = rows.interval * rows.Y * v[:, :, None]
    sums, sizes = share.sum(axis=0), np.abs(share).sum(axis=0)
    at = [rows.names.index(n) for n in free.names]
    brakes = (sums >= ONE_SIGN * sizes) & ~np.isin(rows.names, rows.signed)
    each = np.where(brakes, sums, 0.0)[:, at]
    everything = sums[:, at].sum(axis=0)
    left = (rows.effort - identification.modelled(rows)) * v
    by_noise = correlation_time(identification.residuals) * np.sum((identification.noise * v) ** 2) * rows.interval**2
    # the residuals of the fit's own rows hold less than their noise, those of others also the parameters' errors
    by_parameters = 0.0 if rows is identification.rows else float(everything @ free.covariance @ everything)
    return MechanicalWork(
        each @ free.values,
        np.sqrt(np.einsum("mi,ij,mj->m", each, free.covariance, each)),
        float(left.sum() * rows.interval),
        float(np.abs(rows.effort * v).sum() * rows.interval),
        float(np.sqrt(by_noise + by_parameters)),
    )
