"""Short pulses of input functions: an integrator that sees an input at rest would step over them."""

from __future__ import annotations

from collections.abc import Iterable

import casadi as ca
import numpy as np

# a run is looked at in so many cells, at so many times each
CELLS, SAMPLES = 500, 100
# of the function's range: what leaves the straight line between the ends of a cell by more is seen by nobody there
SEEN = 1e-3
# a function that does so in more than this part of the cells is no pulse: it never rests, and the integrator follows it
RARE = 0.1


def pulses(functions: Iterable[ca.SX], t: ca.SX, start: float, end: float) -> np.ndarray:
    """Times just before functions of t leave a straight line for less than a cell, and just after they return to it."""
    moving = [e for e in functions if ca.depends_on(e, t)]
    if not moving:
        return np.zeros(0)
    times = np.linspace(start, end, CELLS * SAMPLES + 1)
    values = np.asarray(ca.Function("inputs", [t], [ca.vertcat(*moving)])(times[None, :]).full())
    found = [np.zeros(0)]
    share = np.arange(SAMPLES + 1) / SAMPLES
    for row in values:
        span = np.ptp(row)
        if not (np.isfinite(span) and span > 0):
            continue
        cells = np.lib.stride_tricks.sliding_window_view(row, SAMPLES + 1)[::SAMPLES]
        off = np.abs(cells - cells[:, :1] - share * (cells[:, -1:] - cells[:, :1])) > SEEN * span
        rare = np.flatnonzero(off.any(axis=1))
        if 0 < rare.size <= RARE * CELLS:
            first = np.argmax(off[rare], axis=1) - 1
            last = SAMPLES + 1 - np.argmax(off[rare, ::-1], axis=1)
            found += [times[rare * SAMPLES + first], times[np.minimum(rare * SAMPLES + last, len(times) - 1)]]
    return np.unique(np.concatenate(found))
