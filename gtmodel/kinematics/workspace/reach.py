"""Which tool centre points a robot reaches, and why not the others."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from ...results import Status
from ..poses import Array, InverseKinematics
from .grid import Grid
from .limits import Limit

REACHABLE = 0
FIRST_LIMIT = 64  # codes below are those of `Status`, from here on they count the limits
# rows at once: some 10 MB of poses and margins, whatever the size of the grid
CHUNK = 16384
# chunks handed to a cluster before any answer is waited for
WINDOW = 64


class Reach:
    """Reachability of tool centre points under limits, in one order: input, inverse kinematics, then each limit.

    Called with T (3,) or (n, 3) [m] it returns codes: 0 reachable, below FIRST_LIMIT a `Status` of the inverse
    kinematics, from there on FIRST_LIMIT + k for limit k, the first one that fails. It never throws on data, and a
    row with NaN harms no other row.
    """

    def __init__(self, inverse: InverseKinematics, limits: Sequence[Limit] = ()) -> None:
        self.inverse = inverse
        self.limits = tuple(limits)

    @property
    def assumptions(self) -> list[str]:
        """What was assumed, one sentence for each limit that has one."""
        return [limit.assumes for limit in self.limits if limit.assumes]

    def __call__(self, T: Array) -> Any:
        """Codes: an int for T (3,), uint8 (n,) for T (n, 3) [m]."""
        T = np.asarray(T, dtype=float)
        if T.shape[-1:] != (3,) or T.ndim not in (1, 2):
            raise TypeError(f"tool centre points take shape (3,) or (n, 3); found {T.shape}")
        if T.ndim == 1:
            return int(self(T[None])[0])
        poses = self.inverse(T)
        codes = np.asarray(poses.status).astype(np.uint8)
        left = np.flatnonzero(codes == REACHABLE)
        if self.limits and len(left) < len(codes):
            poses = poses.rows(left)
        for k, limit in enumerate(self.limits):
            if not len(left):
                break
            with np.errstate(invalid="ignore"):
                kept = np.asarray(np.all(limit.margins(poses) >= 0, axis=1))
            codes[left[~kept]] = FIRST_LIMIT + k
            if k + 1 < len(self.limits) and not kept.all():
                poses = poses.rows(kept)
            left = left[kept]
        return codes

    def inside(self, T: Array) -> Array:
        """True for reachable rows of T (n, 3) [m]."""
        return self(T) == REACHABLE

    def message(self, code: int) -> str:
        """What a code means."""
        if code == REACHABLE:
            return "reachable"
        if code < FIRST_LIMIT:
            return Status(code).message
        return f"outside the {self.limits[code - FIRST_LIMIT].name}"

    def diagnose(self, T: Array) -> str:
        """One sentence on a single point (3,): reachable, or what forbids it and by how much."""
        T = np.asarray(T, dtype=float)
        where = f"({', '.join(f'{x:.4g}' for x in T)}) m"
        code = self(T)
        if code != REACHABLE and code < FIRST_LIMIT:
            return f"{where} cannot be reached: {self.inverse.diagnose(T)}"
        poses = self.inverse(T[None])
        if code == REACHABLE:
            return f"{where} can be reached"
        limit = self.limits[code - FIRST_LIMIT]
        margins = limit.margins(poses)[0]
        worst = int(np.argmin(margins))
        amount, unit = (np.degrees(margins[worst]), "deg") if limit.unit == "rad" else (margins[worst], limit.unit)
        return f"{where} cannot be reached: {limit.parts[worst]} leaves the {limit.name} by {-amount:.4g} {unit}"

    def counts(self, codes: Array) -> dict[str, int]:
        """Number of points by reason, in the order of the tests; reasons without points are left out."""
        counts = np.bincount(np.asarray(codes, dtype=int).ravel())
        return {self.message(code): int(n) for code, n in enumerate(counts) if n}


@dataclass(frozen=True)
class ReachMap:
    """Codes of a grid.

    Attributes:
        codes: uint8 of the grid's shape; NOT_LOOKED_AT where the work was stopped before.
        complete: False after a stop.
    """

    grid: Grid
    codes: Array
    complete: bool = True

    @property
    def reachable(self) -> Array:
        """True where the robot reaches, of the grid's shape."""
        return self.codes == REACHABLE


NOT_LOOKED_AT = 255


def map_grid(
    reach: Reach,
    grid: Grid,
    *,
    chunk: int = CHUNK,
    client: Any = None,
    progress: Callable[[float], bool] | None = None,
) -> ReachMap:
    """Codes of all points of a grid, chunk by chunk: memory beyond the result does not grow with the grid.

    Args:
        chunk: rows at once.
        client: of a cluster, such as `dask.distributed.Client`: anything with `map(function, items)`, which returns
            futures, and `gather(futures)`. At most WINDOW chunks are under way. Left out: here.
        progress: called with the fraction done; returning True stops the work.

    The L1 along a block beside its home, with carts that move 1 m each way:

    >>> from gtmodel.kinematics.workspace import ActuatorLimits, Bodies, Reach, box_grid, limited_mechanism, map_grid
    >>> robot = limited_mechanism(gt.robots.gantry_tau("l1_tape"), None, Bodies())
    >>> reach = Reach(robot.inverse, [ActuatorLimits(np.full(3, -1.0), np.full(3, 1.0))])
    >>> block = box_grid(np.array([1.4, -0.4, 0.9]), np.array([2.6, -0.4, 1.0]), 0.1)
    >>> reach.counts(map_grid(reach, block).codes)
    {'reachable': 46, 'outside the actuator limits': 6}
    """
    codes = np.full(grid.size, NOT_LOOKED_AT, dtype=np.uint8)
    work = partial(_codes, reach, grid)
    batch = 1 if client is None else WINDOW
    for first in range(0, grid.size, batch * chunk):
        begins = range(first, min(first + batch * chunk, grid.size), chunk)
        chosen = [(begin, min(begin + chunk, grid.size)) for begin in begins]
        parts = [work(span) for span in chosen] if client is None else client.gather(client.map(work, chosen))
        for (begin, end), part in zip(chosen, parts, strict=True):
            codes[begin:end] = part
        done = chosen[-1][1]
        if progress is not None and progress(done / grid.size) and done < grid.size:
            return ReachMap(grid, codes.reshape(grid.shape), complete=False)
    return ReachMap(grid, codes.reshape(grid.shape))


def _codes(reach: Reach, grid: Grid, span: tuple[int, int]) -> Array:
    return reach(grid.points(*span))
