"""Boundary and area of a region in a plane, from a test of points: marching squares whose corners are bisected.

A square of the grid is a cell. The boundary crosses those edges of a cell whose ends lie on different sides; the
crossing is found by bisection, so that area and boundary are of second order in the step. What is narrower than a cell
may be missed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...linear.roots import bisected

Array = np.ndarray
Inside = Callable[[Array], Array]

BISECTIONS = 30  # of one step: some 1e-9 of it is left
# corners of a cell in the order in which the boundary is followed, and the two ends of each edge between them
_CORNERS = ((0, 0), (1, 0), (1, 1), (0, 1))


@dataclass(frozen=True)
class Region:
    """A region of the plane.

    Attributes:
        area: [m2].
        loops: closed polygons (k, 2) [m], the region on the left: outer boundaries run counterclockwise, holes
            clockwise; the longest first.
        on_edge: the region reaches the edge of the grid, so that area and boundary are those of the part within.
    """

    area: float
    loops: tuple[Array, ...]
    on_edge: bool

    @property
    def area_within_loops(self) -> float:
        """Area [m2] by the polygons of the boundary, holes taken off: a cross-check of `area`."""
        return sum(_shoelace(p) for p in self.loops)

    @property
    def low(self) -> Array:
        """(2,) least coordinates [m]; NaN for an empty region."""
        return np.min([p.min(axis=0) for p in self.loops], axis=0) if self.loops else np.full(2, np.nan)

    @property
    def high(self) -> Array:
        """(2,) greatest coordinates [m]; NaN for an empty region."""
        return np.max([p.max(axis=0) for p in self.loops], axis=0) if self.loops else np.full(2, np.nan)

    @property
    def extent(self) -> Array:
        """(2,) width and height [m]; zero for an empty region."""
        return self.high - self.low if self.loops else np.zeros(2)


def region(inside: Inside, u: Array, v: Array, mask: Array) -> Region:
    """The region where `inside` holds, within the grid of u and v.

    Args:
        inside: called with (n, 2) coordinates [m], returns (n,) booleans.
        u, v: ascending coordinates of the grid [m].
        mask: (len(u), len(v)) booleans, `inside` at the points of the grid.

    A disc of radius 1 m on a grid of 0.1 m; its area and circumference come close to pi and 2 pi:

    >>> def inside(p):
    ...     return np.linalg.norm(p, axis=1) < 1.0
    ...
    >>> u = v = np.linspace(-1.5, 1.5, 31)
    >>> grid = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1)
    >>> disc = gt.kinematics.workspace.region(inside, u, v, inside(grid.reshape(-1, 2)).reshape(31, 31))
    >>> round(disc.area, 2)
    3.14
    """
    mask = np.asarray(mask, dtype=bool)
    on_edge = bool(mask[[0, -1]].any() or mask[:, [0, -1]].any())
    # a rim of empty cells without width closes the boundary at the edge of the grid
    u, v = np.pad(np.asarray(u, float), 1, "edge"), np.pad(np.asarray(v, float), 1, "edge")
    mask = np.pad(mask, 1)
    across = _crossings(inside, u, v, mask, 0)
    up = _crossings(inside, u, v, mask, 1)
    cells = mask[:-1, :-1].astype(np.int8) + mask[1:, :-1] + mask[1:, 1:] + mask[:-1, 1:]
    full = np.einsum("i,ij,j->", np.diff(u), cells == 4, np.diff(v))
    i, j = np.nonzero((cells > 0) & (cells < 4))
    ring, present, edges = _rings(i, j, u, v, mask, across, up)
    centre = np.stack([(u[i] + u[i + 1]) / 2, (v[j] + v[j + 1]) / 2], axis=1)
    corners = present[:, 0::2]
    saddle = (corners[:, 0] == corners[:, 2]) & (corners[:, 1] == corners[:, 3]) & (corners[:, 0] != corners[:, 1])
    apart = np.zeros(len(i), dtype=bool)
    apart[saddle] = ~inside(centre[saddle]) if saddle.any() else False
    area = full + _polygon_area(ring[~apart], present[~apart]) + _corner_area(ring[apart], present[apart])
    return Region(float(area), _loops(ring, present, edges, apart), on_edge)


def _crossings(inside: Inside, u: Array, v: Array, mask: Array, axis: int) -> Array:
    """Coordinate along `axis` where the boundary crosses each edge in that direction; NaN where it does not."""
    first = mask[:-1] if axis == 0 else mask[:, :-1]
    last = mask[1:] if axis == 0 else mask[:, 1:]
    i, j = np.nonzero(first != last)
    low = np.stack([u[i], v[j]], axis=1)
    high = low.copy()
    high[:, axis] = u[i + 1] if axis == 0 else v[j + 1]
    at_low = first[i, j]
    low, high = bisected(lambda x: (inside(x) == at_low)[:, None], low, high, BISECTIONS if len(i) else 0)
    crossings = np.full(first.shape, np.nan)
    crossings[i, j] = (low[:, axis] + high[:, axis]) / 2
    return crossings


def _rings(i: Array, j: Array, u: Array, v: Array, mask: Array, across: Array, up: Array) -> tuple[Array, Array, Array]:
    """For each cell the corners and crossings around it, in turn: points (n, 8, 2), which of them belong to the
    region's polygon (n, 8), and the numbers of the four edges (n, 4)."""
    ring = np.empty((len(i), 8, 2))
    present = np.zeros((len(i), 8), dtype=bool)
    for k, (a, b) in enumerate(_CORNERS):
        ring[:, 2 * k, 0], ring[:, 2 * k, 1] = u[i + a], v[j + b]
        present[:, 2 * k] = mask[i + a, j + b]
    sides = [across[i, j], up[i + 1, j], across[i, j + 1], up[i, j]]
    for k, side in enumerate(sides):
        fixed = ring[:, (2 * k) % 8, 1 - k % 2]
        ring[:, 2 * k + 1, k % 2], ring[:, 2 * k + 1, 1 - k % 2] = side, fixed
        present[:, 2 * k + 1] = np.isfinite(side)
    ring = np.where(present[..., None], ring, 0.0)
    width = len(v)
    number = i * width + j
    edges = np.stack([2 * number, 2 * (number + width) + 1, 2 * (number + 1), 2 * number + 1], axis=1)
    return ring, present, edges


def _polygon_area(ring: Array, present: Array) -> float:
    """Sum of the areas of the polygons of the points present."""
    if not len(ring):
        return 0.0
    first = np.argmax(present, axis=1)
    start = ring[np.arange(len(ring)), first]
    last, total = start.copy(), np.zeros(len(ring))
    for k in range(8):
        here = ring[:, k]
        use = present[:, k]
        total += np.where(use, _cross(last - start, here - start), 0.0)
        last = np.where(use[:, None], here, last)
    return float(total.sum() / 2)


def _corner_area(ring: Array, present: Array) -> float:
    """Sum of the two corner triangles of cells whose middle is outside."""
    total = 0.0
    for k in range(4):
        use = present[:, 2 * k]
        before, corner, after = ring[use, 2 * k - 1], ring[use, 2 * k], ring[use, 2 * k + 1]
        total += float(np.abs(_cross(before - corner, after - corner)).sum() / 2)
    return total


def _loops(ring: Array, present: Array, edges: Array, apart: Array) -> tuple[Array, ...]:
    """Boundary polygons, from the piece of boundary in every cell: from the edge where the region is left to the one
    where it is entered again."""
    following: dict[int, int] = {}
    place: dict[int, Array] = {}
    for points, there, numbers, split in zip(ring, present, edges, apart, strict=True):
        crossed = [k for k in range(4) if there[2 * k + 1]]
        for n, k in enumerate(crossed):
            place[int(numbers[k])] = points[2 * k + 1]
            if there[2 * k]:  # inside before this crossing: the region is left here
                other = crossed[n - 1] if split else crossed[(n + 1) % len(crossed)]
                following[int(numbers[k])] = int(numbers[other])
    loops = []
    while following:
        edge, path = next(iter(following)), []
        while edge in following:
            path.append(place[edge])
            edge = following.pop(edge)
        loops.append(np.array(path))
    return tuple(sorted(loops, key=len, reverse=True))


def _shoelace(p: Array) -> float:
    q = np.roll(p, -1, axis=0)
    return float(np.sum(p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0])) / 2


def _cross(a: Array, b: Array) -> Array:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
