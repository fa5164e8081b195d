"""Delays, scales and offsets of the measured signals, estimated together with the parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gtmodel.lang import ModelError
from gtmodel.measurements import ESTIMATE, Corrections, Session, cutoff_for

from .parameter_names import among
from .regressor import Regressor
from .rows import Processing, rows_of, with_offsets


def corrected(
    corrections: Corrections,
    regressor: Regressor,
    processing: Processing,
    free: Sequence[str],
    known: str = "q",
    targets: str = "tau",
    offsets: bool = False,
) -> tuple[tuple[Session, ...], dict[str, float]]:
    """The sessions in quantities, and the free corrections by name [SI].

    What is free makes the residual of the least-squares fit smallest, whose parameters are eliminated at each step
    (variable projection). Offsets of the efforts belong into that fit, see `with_offsets`; `offsets` tells that they
    are free there, session by session. Raises ModelError where the scale of the efforts is free: it cannot be told
    from the masses.
    """
    if corrections.signals[targets].scale == ESTIMATE:
        raise ModelError("the scale of the efforts cannot be told from the masses and friction; give it a number")
    if not corrections.free:
        return corrections.apply(), {}
    first = corrections.apply(corrections.start)
    cutoff = processing.cutoff or max(cutoff_for(s.trajectory[known], s.sample_time) for s in first)
    # nothing is left out on the way: the number of residuals must not depend on what is tried
    steady = replace(processing, cutoff=cutoff, position_step=0.0, mask_steps=0.0)
    at = among(regressor.names, free)
    rest = [k for k in range(regressor.size) if k not in at]

    def residual(sessions: tuple[Session, ...]) -> np.ndarray:
        rows = rows_of(sessions, regressor, steady, known, targets)
        A = rows.Y[:, :, at].reshape(-1, len(at))
        if offsets:
            A = np.hstack([A, with_offsets(rows, targets).Y[:, :, regressor.size :].reshape(len(A), -1)])
        b = (rows.effort - rows.y0 - rows.Y[:, :, rest] @ rows.nominal[rest]).reshape(-1)
        return b - A @ np.linalg.lstsq(A, b, rcond=None)[0]

    values = corrections.estimate(residual)
    return corrections.apply(values), corrections.named(values)
