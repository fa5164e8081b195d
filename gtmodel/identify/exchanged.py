"""Efforts in exchanged or reversed columns: another reading of them that the same model explains far better."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from gtmodel.inference import FALSE_ALARM, chance_ratio
from gtmodel.measurements.orders import orders

from .inertia import Identification

Array = np.ndarray

# another order is believed when it leaves so many times less: no error of a model, only one of columns, falls so
NEARER = 1.5
ROUND_OFF = 1e-9  # of the efforts: what is left is nothing


class Exchanged(NamedTuple):
    """How the columns of efforts as given compare with the best other reading of them.

    `given` and `other` are the residuals, rms in the unit of the efforts, of the columns as they are and of column
    `order[k]` with the sign `signs[k]` in place of the k-th; both are at least round-off. The columns as given are not
    believed where they leave more than `bound` times what the other reading leaves.
    """

    order: list[int]
    signs: list[int]
    given: float
    other: float
    bound: float

    @property
    def ratio(self) -> float:
        """Residuals as given over those of the other reading."""
        return self.given / self.other

    @property
    def passed(self) -> bool:
        """Whether the columns are believed as they are given."""
        return self.ratio <= self.bound

    @property
    def decisive(self) -> bool:
        """Whether another reading would have been seen."""
        return self.other > self.bound * self.given

    def message(self, names: Sequence[str], unit: str = "") -> str:
        """How the columns of these names are to be read."""
        given, other = (f"{left:.3g}{unit and f' {unit}'}" for left in (self.given, self.other))
        left = f"as given the model leaves {given} rms of the efforts, and {other}"
        reversed_ = [name for name, sign in zip(names, self.signs, strict=True) if sign < 0]
        if reversed_:
            return f"{reversed_[0]} looks reversed: {left} with the other sign"
        changed = [k for k, m in enumerate(self.order) if m != k]
        read = ", ".join(names[self.order[k]] for k in changed)
        return f"{' and '.join(names[k] for k in changed)} look exchanged: {left} when read as {read}"


def exchanged(
    left: Callable[[list[int], list[int]], float], columns: int, degrees_of_freedom: float, size: float
) -> Exchanged | None:
    """Compare columns as given with all other orders, and with one of them reversed; None for a single column.

    `left` is the sum of squares that is left with an order and signs, `degrees_of_freedom` the residuals' degrees of
    freedom, `size` the rms of the efforts.
    """
    if columns < 2 or degrees_of_freedom < 1:
        return None
    whole, same = list(range(columns)), [1] * columns
    trials = [(order, same) for order in orders(columns, [whole])]
    trials += [(whole, [-1 if k == r else 1 for k in whole]) for r in whole]
    order, signs = min(trials, key=lambda trial: left(*trial))
    least = ROUND_OFF * max(size, np.finfo(float).tiny)
    given, other = (
        max(float(np.sqrt(max(left(*t), 0.0) / degrees_of_freedom)), least) for t in ((whole, same), (order, signs))
    )
    chance = chance_ratio(degrees_of_freedom, degrees_of_freedom, tests=len(trials), false_alarm=FALSE_ALARM)
    return Exchanged(order, signs, given, other, max(NEARER, chance))


def exchanged_efforts(identification: Identification) -> Exchanged | None:
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
    >>> order.passed, order.order, order.message(["tau[0]", "tau[1]"], "N")
    (False, [1, 0], 'tau[0] and tau[1] look exchanged: as given the model leaves 13.4 N rms of the efforts, and ...')
    """
    rows, e = identification.rows, identification.estimate
    n, m = rows.effort.shape
    free = [rows.names.index(name) for name in e.names]
    known = rows.y0 + rows.Y @ np.array([identification.fixed.get(name, 0.0) for name in rows.names])
    Y = rows.Y[:, :, free].reshape(n * m, -1)
    Q, R = np.linalg.qr(Y / np.maximum(np.linalg.norm(Y, axis=0), np.finfo(float).tiny))
    Q = Q[:, np.abs(np.diag(R)) > ROUND_OFF]

    def left(order: list[int], signs: list[int]) -> float:
        b = (rows.effort[:, order] * signs - known).reshape(-1)
        return float(np.sum((b - Q @ (Q.T @ b)) ** 2))

    return exchanged(left, m, n * m - Q.shape[1], float(np.sqrt(np.mean(rows.effort**2))))
