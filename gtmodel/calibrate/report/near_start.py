"""A fit of few poses that slides, along what they hardly determine, to where they do not close: held near its start."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ...inference import Prior
from ...lang import ModelError
from ..calibration import Calibration
from ..measurements import Measurements
from ..problem import CalibrationProblem

WIDTH = 3.0  # expected sizes of each unknown: what a start value may be off without being held back


def near_start(
    c: Calibration, kept: Measurements | None, fit: Callable[[CalibrationProblem], Calibration]
) -> tuple[Calibration, tuple[str, ...]]:
    """The calibration, and the names of unknowns that got a prior at their start; none where all poses close as it is.

    Along a combination that the poses determine no better than it was known, noise moves a fit by many times of what a
    drawing is off, as far as to where two links come to coincide and the pose no longer follows from the actuators. A
    robot that took these poses is not there. Then all unknowns without a prior get one, `WIDTH` times their expected
    size: what the poses determine is hardly moved by it. It stays where fewer poses are lost so. Only whether poses
    close is looked at, held-out ones too, not their errors.
    """
    p, u = c.problem, c.problem.unknowns
    known = all(n in p.measurements.noise for n in p.reading.places)
    if not c.status.ok or not len(c.x) or not known or p.implicit:
        return c, ()
    before = _lost(c, kept)
    if not before:
        return c, ()
    had = {q.name for q in u.priors}
    free = [k for k, n in enumerate(u.names) if n not in had]
    own = tuple(Prior(u.names[k], float(u.start[k]), WIDTH * float(u.sizes[k])) for k in free)
    try:
        held = fit(replace(p, unknowns=replace(u, priors=(*u.priors, *own))))
    except (ModelError, ValueError):
        return c, ()
    if not held.status.ok or _lost(held, kept) >= before:
        return c, ()
    return held, tuple(q.name for q in own)


def _lost(c: Calibration, kept: Measurements | None) -> int:
    """How many poses do not close at the calibrated parameters."""
    lost = 0
    for m in (None, kept) if kept is not None else (None,):
        try:
            errors = c.positioning_errors(m)
        except (ModelError, ValueError, np.linalg.LinAlgError):
            continue
        lost += int(np.count_nonzero(np.any([np.isnan(e).any(axis=1) for e in errors.values()], axis=0)))
    return lost
