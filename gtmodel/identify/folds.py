"""Rows left out in turn: each stretch of a recording is predicted by a fit without it."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..lang import ModelError
from .inertia import Confidence, Identification, identify

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class LeftOutInTurn:
    """Errors (n, m) of all rows, measured minus modelled, each by the fit without its stretch; `count` of stretches."""

    errors: Array
    count: int

    @property
    def rms(self) -> Array:
        """By target (m,), in the unit of the efforts."""
        return np.sqrt(np.mean(self.errors**2, axis=0))


def leave_out_in_turn(
    identification: Identification,
    folds: int,
    *,
    nonnegative: bool | Sequence[str] = True,
    confidence: Confidence = "auto",
) -> LeftOutInTurn:
    """The rows of a fit in `folds` stretches of equal length, one after the other in time; as many as rows leave one
    row out each. Neighbouring rows of a coloured residual know of each other, so long stretches are the honest ones.

    Raises ModelError where there are fewer rows than stretches, and where the rest does not determine the parameters.

    >>> class Axis(gt.Model):  # a cart with viscous and Coulomb friction
    ...     m, d, c = gt.parameter(2.0, unit="kg"), gt.parameter(5.0, unit="kg/s"), gt.parameter(3.0, unit="N")
    ...     q, tau = gt.variable(unit="m"), gt.variable(unit="N")
    ...     def equations(self):
    ...         v = gt.der(self.q)
    ...         yield self.tau == self.m * gt.der(v) + self.d * v + self.c * gt.sign(v)
    >>> time = 0.004 * np.arange(2000)
    >>> q = gt.identify.multisine(time, np.zeros(1), np.array([0.2]), np.array([0.5, 1.1]), seed=1)[:, 0]
    >>> log = gt.identify.LogSimulator(Axis(), q).draw(1, gt.identify.Sensors(effort_noise=0.5))
    >>> s = gt.identify.study(Axis(), log, ["m", "d", "c"])
    >>> left = gt.identify.leave_out_in_turn(s.fit, 5)
    >>> bool(s.noise[0] < left.rms[0] < 1.5 * s.noise[0])
    True
    """
    rows, n = identification.rows, len(identification.rows)
    if not 2 <= folds <= n:
        raise ModelError(f"{folds} stretches of {n} rows; expected two or more, and no more than rows")
    free = (*identification.estimate.names, *identification.estimate.held)
    ends = np.round(np.linspace(0, n, folds + 1)).astype(int)
    errors = np.empty_like(rows.effort)
    for begin, end in itertools.pairwise(ends):
        kept = np.r_[0:begin, end:n]
        rest = rows.chosen(kept)
        # an offset of a recording that is left out as a whole has no rows
        names = [p for p in free if np.any(rest.Y[:, :, rest.names.index(p)])]
        limited = nonnegative if isinstance(nonnegative, bool) else [p for p in nonnegative if p in names]
        fit = identify(rest, names, nonnegative=limited, confidence=confidence, test=[])
        part = slice(begin, end)
        errors[part] = rows.effort[part] - rows.Y[part] @ fit.parameters - rows.y0[part]
    return LeftOutInTurn(errors, folds)
