"""The reference of a demonstration of the loop: a motion there, and back more slowly, again and again."""

from __future__ import annotations

import numpy as np
import scipy

from ..compiler.causal import compile_causal
from ..lang import Model
from ..results import ArgumentError, Status, Trajectory
from .exchange import CYCLE_MS
from .table import ReferenceTable

REST_CYCLES = 75  # before, between and after the motions: 0.3 s, in which a slow drive comes to rest
# friction turns its sign on the way back, where the optimum's forces would be exceeded: forces fall with the square
BACK = 1.5
_WRITES_ONE = "gtmodel solve --out writes one"


def there_and_back(robot: Model, motion: Trajectory, cycles: int, slower: float = 1.0) -> ReferenceTable:
    """Rows q, der(q), der(q,2), T, der(T), der(T,2) every 4 ms for `cycles` cycles and a little more.

    motion: T, der(T) and der(T,2) every 4 ms, from rest to rest; it is made `slower` times as long.
    Raises ArgumentError about `reference` where it is none or not reached.
    """
    for name in ("T", "der(T)", "der(T,2)"):
        if name not in motion.names or motion[name].shape[1:] != (3,):
            raise ArgumentError(f"lacks {name} with three components; {_WRITES_ONE}", "reference")
    step = 1e-3 * CYCLE_MS
    if len(motion) < 2 or not np.allclose(np.diff(motion.time), step, rtol=0, atol=1e-9):
        raise ArgumentError(f"has to have a row every {step:g} s; {_WRITES_ONE}", "reference")
    there = np.hstack([motion["T"], motion["der(T)"], motion["der(T,2)"]])
    if slower != 1.0:
        there = _back(motion, slower)[::-1] * np.repeat([1.0, -1.0, 1.0], 3)
    there[-1, 3:] = 0.0
    back = _back(motion, BACK * slower)
    begin, end = _resting(there[0]), _resting(there[-1])
    rest = (REST_CYCLES, 1)
    period = np.vstack([np.tile(begin, rest), there, np.tile(end, rest), back])
    rows = np.vstack([np.tile(period, (-(-cycles // len(period)), 1)), np.tile(begin, rest)])
    q, dq, ddq, status = compile_causal(robot, known="T", targets=["q", "der(q)", "der(q,2)"])(
        rows[:, :3], rows[:, 3:6], rows[:, 6:]
    )
    bad = np.flatnonzero(status != Status.OK)
    if len(bad):
        raise ArgumentError(f"at {step * bad[0]:g} s: {Status(int(status[bad[0]])).message}", "reference")
    return ReferenceTable(np.hstack([q, dq, ddq, rows]), CYCLE_MS)


def _resting(row: np.ndarray) -> np.ndarray:
    return np.concatenate([row[:3], np.zeros(6)])[None]


def _back(motion: Trajectory, slower: float) -> np.ndarray:
    """The motion backwards, `slower` times as long, to where it began."""
    curve = scipy.interpolate.CubicHermiteSpline(motion.time, motion["T"], motion["der(T)"])
    end = float(motion.time[-1])
    times = np.maximum(0.0, end - 1e-3 * CYCLE_MS / slower * np.arange(int(np.ceil(slower * len(motion))) + 1))
    acceleration = [np.interp(times, motion.time, column) for column in motion["der(T,2)"].T]
    rows = np.hstack([curve(times), -curve(times, 1) / slower, np.stack(acceleration, axis=1) / slower**2])
    rows[times <= 0.0] = _resting(motion["T"][0])
    rows[0, 3:] = 0.0
    return rows
