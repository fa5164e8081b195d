"""Tables of numbers at a constant step, as the C loop maps them from a file."""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np

from ..results.status import Status

_WORD = b"GTTABLE1"


@dataclass(frozen=True)
class ReferenceTable:
    """A sampled reference: rows (n, columns) at multiples of `step_ms` [ms], linear in between.

    >>> table = gt.loop.ReferenceTable(np.array([[0.0], [0.1]]), step_ms=4)
    >>> table.at(2)
    (<Status.OK: 0>, [0.05])
    """

    rows: np.ndarray
    step_ms: int = 4

    def to_bytes(self) -> bytes:
        """The file that the C loop reads."""
        n, columns = self.rows.shape
        head = _WORD + struct.pack("<3Q", n, columns, self.step_ms)
        return head + np.ascontiguousarray(self.rows, dtype="<f8").tobytes()

    def at(self, time_ms: int) -> tuple[Status, list[float]]:
        """The row at a time, linear between two rows, the last one behind the end. gt_traj_at in Python."""
        if not len(self.rows):
            return Status.OUT_OF_RANGE, []
        n, rest = divmod(time_ms, self.step_ms)
        last = len(self.rows) - 1
        n, weight = (last, 0.0) if n >= last else (n, rest / self.step_ms)
        below = self.rows[n]
        above = self.rows[n + 1] if weight > 0.0 else below
        if not (np.all(np.isfinite(below)) and np.all(np.isfinite(above))):
            return Status.NOT_FINITE, []
        with np.errstate(over="ignore"):
            between = above - below
        if not np.all(np.isfinite(between)):
            return Status.NOT_FINITE, []
        row = below + weight * between if weight > 0.0 else below
        return Status.OK, row.tolist()
