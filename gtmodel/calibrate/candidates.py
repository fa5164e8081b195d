"""Candidate poses: a grid in what the robot reaches and the device sees, with a distance from the edge of both."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..kinematics.workspace import REACHABLE, Grid, Reach, map_grid
from ..lang.source import ModelError

# directions in which the neighbourhood of a point is looked at: to the faces, edges and corners of a cube
_AROUND = np.array([d for d in np.ndindex(3, 3, 3) if d != (1, 1, 1)], float) - 1
AROUND = _AROUND / np.linalg.norm(_AROUND, axis=1, keepdims=True)
# neighbours of one call: a call costs as much as some hundred of them
AT_ONCE = 4096


@dataclass(frozen=True, eq=False)
class Candidates:
    """Points of a grid (N, 3) [m], and which of them passed each of the `stages`: name -> (N,), each within the former.

    `complete`: False after a stop.
    """

    T: np.ndarray
    stages: dict[str, np.ndarray]
    complete: bool = True

    @property
    def chosen(self) -> np.ndarray:
        """(n, 3) points that passed all stages [m]."""
        return self.T[next(reversed(self.stages.values()))]

    @property
    def counts(self) -> dict[str, int]:
        """Number of points by stage."""
        return {name: int(np.count_nonzero(m)) for name, m in self.stages.items()}


def candidates(
    grid: Grid,
    stages: dict[str, Reach],
    safety: float = 0.0,
    *,
    stop: Callable[[str, float], bool] | None = None,
) -> Candidates:
    """The points of a grid that pass all stages in their order, such as workspace, obstacles, device.

    `safety` [m]: in the end those points remain of which all neighbours, at that distance in 26 directions, are within
    the last stage too, so that the edge of the working range is that far away (Dressler 2012, section 5.6).
    `stop(stage, fraction)`: True ends with what was found. Raises ModelError for a negative distance.

    >>> from gtmodel.kinematics.mechanism import mechanism_of
    >>> from gtmodel.kinematics.workspace import CartesianBox, Reach
    >>> inverse = mechanism_of(gt.robots.gantry_tau("l1_tape")).inverse
    >>> reach = Reach(inverse, [CartesianBox(np.array([0.0, -1.0, 0.2]), np.array([1.0, 0.0, 0.8]))])
    >>> grid = gt.calibrate.regular_grid(np.array([0.0, -1.0, 0.2]), np.array([1.0, 0.0, 0.8]), volume=0.6, number=200)
    >>> found = gt.calibrate.candidates(grid, {"workspace": reach}, safety=0.1)
    >>> found.counts["workspace"] > found.counts["safety distance"] == len(found.chosen)
    True
    """
    if not safety >= 0:
        raise ModelError(f"the safety distance is {safety:g} m; it must not be negative")
    T = grid.points()
    left = np.ones(len(T), bool)
    masks: dict[str, np.ndarray] = {}

    def asked(stage: str) -> Callable[[float], bool]:
        return lambda fraction: stop is not None and stop(stage, fraction)

    for name, reach in stages.items():
        m = map_grid(reach, grid, progress=asked(name))
        left = left & (m.codes.reshape(-1) == REACHABLE)
        masks[name] = left
        if not m.complete or (stop is not None and stop(name, 1.0)):
            return Candidates(T, masks, complete=False)
    if safety > 0 and stages:
        masks["safety distance"] = _all_around(next(reversed(stages.values())), T, left, safety)
    return Candidates(T, masks)


def _all_around(reach: Reach, T: np.ndarray, left: np.ndarray, distance: float) -> np.ndarray:
    """Which of the points that are `left` have all their neighbours at a distance [m] within reach.

    Few points are asked in several directions by one call; many in one after the other, so that what is lost in one
    direction costs nothing in the next.
    """
    within = left.copy()
    begin = 0
    while begin < len(AROUND) and within.any():
        at = np.flatnonzero(within)
        directions = AROUND[begin : begin + max(1, AT_ONCE // len(at))]
        begin += len(directions)
        neighbours = T[at] + distance * directions[:, None]
        within[at] = np.all(reach.inside(neighbours.reshape(-1, 3)).reshape(len(directions), -1), axis=0)
    return within


def regular_grid(low: np.ndarray, high: np.ndarray, volume: float, number: int) -> Grid:
    """A grid in the middle of the box low..high (3,) [m] with about `number` of its points in a `volume` [m3] inside
    it.

    The grid constant is (volume / number)^(1/3), as Dressler 2012, section 5.6, takes it. Raises ModelError for a
    volume or a number that is not positive.

    >>> grid = gt.calibrate.regular_grid(np.zeros(3), np.array([1.0, 1.0, 0.5]), volume=0.5, number=32)
    >>> grid.points().shape, round(float(grid.coordinates[0][1] - grid.coordinates[0][0]), 3)  # m
    ((75, 3), 0.25)
    """
    if not volume > 0 or number < 1:
        raise ModelError(f"{number} poses of a volume of {volume:g} m3 make no grid; both must be positive")
    step = (volume / number) ** (1 / 3)
    coordinates = []
    for a, b in zip(low, high, strict=True):
        count = int((b - a) / step) + 1
        coordinates.append((a + b) / 2 + step * (np.arange(count) - (count - 1) / 2))
    return Grid(np.zeros(3), np.eye(3), tuple(coordinates))
