"""Delay between the efforts and the positions of a log: estimated from the residuals, and tested."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gtmodel.inference import FALSE_ALARM, newey_west
from gtmodel.inference.chance import f_chance
from gtmodel.inference.covariance import larger, white
from gtmodel.results.estimate import half_width

from .._lazy import hint

if TYPE_CHECKING:
    from .inertia import Identification
else:
    Identification = hint("gtmodel.identify.inertia", "Identification")

# standard deviations of a parameter: the intervals allow for a delay that moves every parameter less
MATTERS = 1.0


@dataclass(frozen=True)
class Delay:
    """Delay of the efforts relative to the positions, and its effect on the parameters.

    `seconds` is the estimate [s], negative if the positions are late, and `std` its standard deviation [s]; `p` is the
    p-value of zero delay. `moved` is the free parameter that the delay moves most, by `moves` of its standard
    deviations; `bound` is the largest allowed `moves`: one, or what chance explains.
    """

    seconds: float
    std: float
    p: float
    moved: str
    moves: float
    bound: float

    @property
    def passed(self) -> bool:
        """True if chance explains the delay, or if it moves every parameter by less than its standard deviation."""
        return self.moves <= self.bound

    @property
    def message(self) -> str:
        late, early = ("efforts", "positions") if self.seconds > 0 else ("positions", "efforts")
        size = f"{1e3 * abs(self.seconds):.3g} ms +- {1e3 * self.std:.2g} ms"
        if self.passed:
            return f"the log shows no delay between efforts and positions ({size}, p = {self.p:.2g})"
        return (
            f"the {late} look {size} later than the {early} (p = {self.p:.2g}); with that delay {self.moved} would "
            f'move by {self.moves:.3g} standard deviations: set delay_s = "estimate" of the {late} (in Python, delay = '
            '"estimate"), or find it in the logger'
        )


def delay_of(identification: Identification) -> Delay | None:
    """Estimate the delay of the efforts in the rows of a fit, to first order: effort(t) = model(t) - delay rate(t).

    The negative rate of the measured efforts joins the columns of the free parameters. The covariance assumes white or
    coloured residuals, as in the fit. None if the rows hold no rates, if the free parameters explain the rates
    entirely, as with a single frequency, or if the efforts have no noise.

    >>> class Axis(gt.Model):  # a cart with viscous and Coulomb friction
    ...     m, d, c = gt.parameter(2.0, unit="kg"), gt.parameter(5.0, unit="kg/s"), gt.parameter(3.0, unit="N")
    ...     q, tau = gt.variable(unit="m"), gt.variable(unit="N")
    ...     def equations(self):
    ...         v = gt.der(self.q)
    ...         yield self.tau == self.m * gt.der(v) + self.d * v + self.c * gt.sign(v)
    >>> options = gt.identify.SyntheticLog(
    ...     duration=16.0, reference="q", centre=[0.0], half_range=0.2, tracking="exact", effort_noise=0.5
    ... )
    >>> s = gt.identify.synthetic_study(Axis(), options, ["m", "d", "c"])
    >>> gt.identify.delay_of(s.fit).message
    'the log shows no delay between efforts and positions (... ms +- ... ms, p = ...)'
    """
    rows, e = identification.rows, identification.unbounded
    if rows.effort_rate is None:
        return None
    free = [rows.names.index(n) for n in e.names]
    size = identification.noise
    J = np.concatenate([rows.columns(free, size), (-rows.effort_rate / size)[:, :, None]], axis=2)
    n, m, k = J.shape
    if n * m <= k:
        return None
    # of the fit without bounds: a parameter held at zero must not look like a delay
    values = identification.parameters.copy()
    values[free] = e.values
    b = (rows.effort - rows.y0 - rows.Y @ values) / size
    scale = np.linalg.norm(J.reshape(-1, k), axis=0)
    x, _, rank, _ = np.linalg.lstsq(J.reshape(-1, k) / scale, b.reshape(-1), rcond=1e-10)
    if rank < k:
        return None
    change = x / scale
    residuals = b - J @ change
    degrees_of_freedom = n * m - k
    if identification.confidence == "newey_west":
        covariance = newey_west(J, residuals, starts=rows.starts)
    else:
        covariance = white(J.reshape(-1, k), float(np.sum(residuals**2)) / degrees_of_freedom, scale=1 / scale)
    # noise that grows with the speed is not white although its autocorrelation is
    std = np.sqrt(np.diag(larger(covariance, newey_west(J, residuals, starts=rows.starts, lags=0))))
    if not std[-1] > 0:  # efforts without noise
        return None
    # relative to the intervals of the result
    std_of = {name: s for name, s in zip(identification.estimate.names, identification.estimate.std, strict=True)}
    moves = [abs(c) / std_of[n] if std_of.get(n, 0) > 0 else 0.0 for n, c in zip(e.names, change[:-1], strict=True)]
    worst = int(np.argmax(moves))
    statistic = abs(float(change[-1])) / float(std[-1])
    by_chance = half_width(1 - FALSE_ALARM, degrees_of_freedom) / max(statistic, np.finfo(float).tiny)
    return Delay(
        float(change[-1]),
        float(std[-1]),
        float(f_chance(statistic**2, 1, degrees_of_freedom)),
        e.names[worst],
        float(moves[worst]),
        max(MATTERS, float(moves[worst]) * by_chance),
    )
