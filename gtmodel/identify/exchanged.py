"""Efforts in exchanged or reversed columns: another reading of them that the same model explains far better."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from gtmodel.measurements.inspection.readings import Compared, OtherReading, compared, exchanges, in_order, reversals
from gtmodel.results.suspicion import Suspicion

from .inertia import Identification

Array = np.ndarray
Exchanged = Compared

ROUND_OFF = 1e-9  # of the efforts: what is left is nothing


def columns_compared(
    names: Sequence[str], efforts: Array, left: Callable[[Array], float], degrees_of_freedom: float
) -> Compared | None:
    """Columns of efforts (n, m) as given beside all other orders, and beside one of them reversed; None for a single
    column. `left` is the sum of squares that efforts leave, `degrees_of_freedom` that of the residuals."""
    if len(names) < 2 or degrees_of_freedom < 1:
        return None

    def rms(reading: OtherReading) -> float:
        return float(np.sqrt(max(left(reading(efforts)), 0.0) / degrees_of_freedom))

    least = ROUND_OFF * float(np.sqrt(np.mean(efforts**2)))
    given = rms(in_order(names, range(len(names))))
    readings = [*exchanges(names), *reversals(names)]
    return compared(given, readings, rms, degrees_of_freedom, least=least)


def leaves(comparison: Compared, unit: str = "") -> Suspicion:
    """How the columns are to be read, in words."""
    given, left = (f"{rms:.3g}{unit and f' {unit}'}" for rms in (comparison.given, comparison.left))
    return comparison.suspicion(f"as given the model leaves {given} rms of the efforts, and", left)


def exchanged_efforts(identification: Identification) -> Compared | None:
    """Whether another order or sign of the columns of efforts would fit far better; None for a single column.

    The parameters that were free in the identification are free in every reading.

    >>> class Stage(gt.Model):  # two axes with viscous friction
    ...     m, d = gt.parameter([2.0, 6.0], unit="kg"), gt.parameter([5.0, 20.0], unit="kg/s")
    ...     q, tau = gt.variable(2, unit="m"), gt.variable(2, unit="N")
    ...     def equations(self):
    ...         v = gt.der(self.q)
    ...         yield self.tau == self.m * gt.der(v) + self.d * v
    >>> time = 0.004 * np.arange(2000)
    >>> q = gt.identify.multisine(time, np.zeros(2), np.full(2, 0.2), np.array([0.5, 1.1]), seed=1)
    >>> log = gt.identify.LogSimulator(Stage(), q).draw(1, gt.identify.Sensors(effort_noise=0.5))
    >>> exchanged = {"q": log["q"], "tau": log["tau"][:, ::-1]}
    >>> s = gt.identify.study(Stage(), gt.Trajectory(time, exchanged, {"q": "m", "tau": "N"}), ["m", "d"])
    >>> order = gt.identify.exchanged_efforts(s.fit)
    >>> order.passed, order.reading.looks, round(order.given, 1), order.reading.when
    (False, 'the columns tau[0], tau[1] look exchanged', 13.4, 'when read as tau[1], tau[0]')
    """
    rows, e = identification.rows, identification.estimate
    n, m = rows.effort.shape
    free = [rows.names.index(name) for name in e.names]
    known = rows.y0 + rows.Y @ np.array([identification.fixed.get(name, 0.0) for name in rows.names])
    Y = rows.Y[:, :, free].reshape(n * m, -1)
    Q, R = np.linalg.qr(Y / np.maximum(np.linalg.norm(Y, axis=0), np.finfo(float).tiny))
    Q = Q[:, np.abs(np.diag(R)) > ROUND_OFF]

    def left(efforts: Array) -> float:
        b = (efforts - known).reshape(-1)
        return float(np.sum((b - Q @ (Q.T @ b)) ** 2))

    return columns_compared(rows.targets, rows.effort, left, n * m - Q.shape[1])
