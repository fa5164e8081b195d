"""Delays, scales and offsets of the measured signals, estimated together with the parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gtmodel.lang import ModelError
from gtmodel.measurements import ESTIMATE, Corrections, Session, cutoff_for

from ..results.suspicion import EVERY
from .options import Processing
from .parameter_names import among
from .regressor import Regressor
from .rows import rows_of, with_offsets


def corrected(
    corrections: Corrections,
    regressor: Regressor,
    processing: Processing,
    free: Sequence[str],
    known: str = "q",
    targets: str = "tau",
    offsets: bool = False,
) -> tuple[tuple[Session, ...], dict[str, float]]:
    """The sessions with quantities in place of columns, and the free corrections by name [SI].

    Args:
        corrections: the signals of raw sessions, with the delays, scales and offsets that are to be estimated.
        regressor, processing, known, targets: as of `rows_of`.
        free: parameters of the regressor that are fitted at the same time.
        offsets: whether offsets of the efforts are free too, session by session; they belong into that fit, see
            `with_offsets`.

    The corrections are those for which the residual of the least-squares fit is smallest; its parameters are eliminated
    at each step (variable projection). A delay is positive where the column comes late [s]. Raises ModelError where the
    scale of the efforts is free: it cannot be distinguished from the masses.

    >>> class Axis(gt.Model):  # a cart with viscous and Coulomb friction
    ...     m, d, c = gt.parameter(2.0, unit="kg"), gt.parameter(5.0, unit="kg/s"), gt.parameter(3.0, unit="N")
    ...     q, tau = gt.variable(unit="m"), gt.variable(unit="N")
    ...     def equations(self):
    ...         v = gt.der(self.q)
    ...         yield self.tau == self.m * gt.der(v) + self.d * v + self.c * gt.sign(v)
    >>> time = 0.004 * np.arange(2000)
    >>> q = gt.identify.multisine(time, np.zeros(1), np.array([0.2]), np.array([0.5, 1.1]), seed=1)[:, 0]
    >>> truth = gt.identify.LogSimulator(Axis(), q).truth
    >>> late = np.interp(time - 0.006, time, truth["tau"])  # the efforts come 6 ms late
    >>> log = gt.Trajectory(time, {"q": q, "tau": late}, {"q": "m", "tau": "N"})
    >>> Signal = gt.measurements.Signal
    >>> signals = {"q": Signal("q", "m"), "tau": Signal("tau", "N", delay="estimate")}
    >>> raw = gt.measurements.Corrections(signals, [gt.measurements.session_of(log)])
    >>> regressor = gt.identify.Regressor(Axis(), ["m", "d", "c"])
    >>> how = gt.identify.Processing(cutoff=8.0)
    >>> _, values = gt.identify.corrected(raw, regressor, how, ["m", "d", "c"])
    >>> {name: round(value, 3) for name, value in values.items()}
    {'tau.delay': 0.006}
    """
    if corrections.signals[targets].scale == ESTIMATE:
        raise ModelError(
            "the scale of the efforts cannot be distinguished from the masses and friction; give it a number"
        )
    if not corrections.free:
        return corrections.apply(), {}
    first = corrections.apply(corrections.start)
    cutoff = processing.cutoff or max(cutoff_for(s.trajectory[known], s.sample_time) for s in first)
    # nothing is left out on the way: the number of residuals must not depend on what is tried
    steady = replace(processing, cutoff=cutoff, position_step=0.0, mask_steps=0.0)
    at = among(regressor.names, free)
    rest = [k for k in range(regressor.size) if k not in at]

    def residual(sessions: tuple[Session, ...]) -> np.ndarray:
        rows = rows_of(sessions, regressor, steady, known, targets, accept=EVERY)  # looked at by the fit itself
        A = rows.Y[:, :, at].reshape(-1, len(at))
        if offsets:
            A = np.hstack([A, with_offsets(rows, targets).Y[:, :, regressor.size :].reshape(len(A), -1)])
        b = (rows.effort - rows.y0 - rows.Y[:, :, rest] @ rows.nominal[rest]).reshape(-1)
        return b - A @ np.linalg.lstsq(A, b, rcond=None)[0]

    values = corrections.estimate(residual)
    return corrections.apply(values), corrections.named(values)
