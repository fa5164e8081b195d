"""What the loop logs each cycle: the numbers of a record, and a log as a Trajectory."""

from __future__ import annotations

import numpy as np

from ..results import Trajectory
from .exchange import AXES

STATES = ("waiting", "running", "holding", "ramping", "stopped", "braking")
COUNTERS = ("late", "lost", "repeated", "reordered", "stale", "garbage")
WATCHES = ("clock_faults", "following_faults")  # datagrams, cycles
COLUMNS = (
    "cycle",
    "sequence",
    "time_ms",
    "state",
    "status",
    "datagrams",
    *COUNTERS,
    "delay",
    "answer_bytes",
    "answer_hash",
    *(f"measured[{n}]" for n in range(AXES)),
    *(f"command[{n}]" for n in range(AXES)),
    *(f"speed[{n}]" for n in range(AXES)),
    *(f"path[{n}]" for n in range(3)),
    "dry",
    *WATCHES,
)


def rows_of(log: bytes) -> np.ndarray:
    """The records (n, columns) of a log. Raises ValueError for one that is cut."""
    size = 8 * len(COLUMNS)
    if len(log) % size:
        raise ValueError(f"the log has {len(log)} bytes; expected whole records of {size}")
    return np.frombuffer(log, dtype="<f8").reshape(-1, len(COLUMNS))


def trajectory_of(log: bytes, axes: int, cycle_s: float, title: str = "") -> Trajectory:
    """A log over the loop's own cycles: carts measured and commanded, state and counters."""
    rows = rows_of(log)
    column = {name: rows[:, n] for n, name in enumerate(COLUMNS)}
    units = {"measured": "m", "command": "m", "speed": "m/s"}
    values = {name: np.stack([column[f"{name}[{n}]"] for n in range(axes)], axis=1) for name in units}
    counted = ("state", *COUNTERS, *WATCHES)
    values |= {name: column[name] for name in counted}
    return Trajectory(cycle_s * (column["cycle"] - 1), values, units | dict.fromkeys(counted, "1"), title=title)
