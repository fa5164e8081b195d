"""Workspaces from sections: boundary and area of the region in a section by marching squares, and the volume from a
series of sections."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from ...linear.roots import bisected
from ...workers.mapped import mapped
from ..section import SectionPlane, section_grid
from .options import MOST_SECTIONS
from .reach import CHUNK, Reach, ReachMap, map_grid

Array = np.ndarray
Inside = Callable[[Array], Array]

BISECTIONS = 30  # of a grid step, to about 1e-9 of it
# corners of a cell, counterclockwise
_CORNERS = ((0, 0), (1, 0), (1, 1), (0, 1))


@dataclass(frozen=True)
class Region:
    """A region of the plane.

    Attributes:
        area: [m2].
        loops: closed polygons (k, 2) [m] with the region on their left: outer boundaries are counterclockwise, holes
            clockwise; the polygon with the most points is first.
        on_edge: whether the region extends to the edge of the grid; area and boundary are then those of the part
            within the grid.
    """

    area: float
    loops: tuple[Array, ...]
    on_edge: bool

    @property
    def area_within_loops(self) -> float:
        """Area [m2] within the boundary polygons, minus holes: a cross-check of `area`."""
        return sum(_shoelace(p) for p in self.loops)

    @property
    def low(self) -> Array:
        """Smallest coordinates (2,) [m]; NaN for an empty region."""
        return np.min([p.min(axis=0) for p in self.loops], axis=0) if self.loops else np.full(2, np.nan)

    @property
    def high(self) -> Array:
        """Largest coordinates (2,) [m]; NaN for an empty region."""
        return np.max([p.max(axis=0) for p in self.loops], axis=0) if self.loops else np.full(2, np.nan)

    @property
    def extent(self) -> Array:
        """Width and height (2,) [m]; zero for an empty region."""
        return self.high - self.low if self.loops else np.zeros(2)


def region(inside: Inside, u: Array, v: Array, mask: Array) -> Region:
    """Return the region in which `inside` is true, within the grid of u and v.

    Args:
        inside: called with (n, 2) coordinates [m], returns (n,) booleans.
        u, v: ascending coordinates of the grid [m].
        mask: (len(u), len(v)) booleans, `inside` at the points of the grid.

    A disc of radius 1 m on a grid of 0.1 m; the area is close to pi:

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
    # a border of empty cells of zero width closes the boundary at the edge of the grid
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
    split = np.zeros(len(i), dtype=bool)
    split[saddle] = ~inside(centre[saddle]) if saddle.any() else False
    area = full + _polygon_area(ring[~split], present[~split]) + _corner_area(ring[split], present[split])
    return Region(float(area), _loops(ring, present, edges, split), on_edge)


def _crossings(inside: Inside, u: Array, v: Array, mask: Array, axis: int) -> Array:
    """Return the coordinate along `axis` where the boundary crosses each edge in that direction; NaN if it does not."""
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
    """Return, for each cell, its corners and edge crossings counterclockwise (n, 8, 2), whether they belong to the
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
    """Return the total area of the polygons through the present points."""
    if not len(ring):
        return 0.0
    first = np.argmax(present, axis=1)
    start = ring[np.arange(len(ring)), first]
    last, total = start.copy(), np.zeros(len(ring))
    for k in range(8):
        point, use = ring[:, k], present[:, k]
        total += np.where(use, _cross(last - start, point - start), 0.0)
        last = np.where(use[:, None], point, last)
    return float(total.sum() / 2)


def _corner_area(ring: Array, present: Array) -> float:
    """Return the total area of the corner triangles in cells whose centre is outside."""
    total = 0.0
    for k in range(4):
        use = present[:, 2 * k]
        before, corner, after = ring[use, 2 * k - 1], ring[use, 2 * k], ring[use, 2 * k + 1]
        total += float(np.abs(_cross(before - corner, after - corner)).sum() / 2)
    return total


def _loops(ring: Array, present: Array, edges: Array, split: Array) -> tuple[Array, ...]:
    """Join the boundary segments of all cells into polygons. On the way around a cell, a segment begins at the edge
    where the way leaves the region and ends where it comes back."""
    following: dict[int, int] = {}
    crossings: dict[int, Array] = {}
    for points, exists, numbers, is_split in zip(ring, present, edges, split, strict=True):
        crossed = [k for k in range(4) if exists[2 * k + 1]]
        for n, k in enumerate(crossed):
            crossings[int(numbers[k])] = points[2 * k + 1]
            if exists[2 * k]:  # inside before this crossing: the path leaves the region here
                entry = crossed[n - 1] if is_split else crossed[(n + 1) % len(crossed)]
                following[int(numbers[k])] = int(numbers[entry])
    loops = []
    while following:
        edge, path = next(iter(following)), []
        while edge in following:
            path.append(crossings[edge])
            edge = following.pop(edge)
        loops.append(np.array(path))
    return tuple(sorted(loops, key=len, reverse=True))


def _shoelace(p: Array) -> float:
    q = np.roll(p, -1, axis=0)
    return float(np.sum(p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0])) / 2


def _cross(a: Array, b: Array) -> Array:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


# widest gaps with a tolerance, as fractions of the length reached so far: next to a reached section, and elsewhere; a
# separate part of the workspace that is shorter may be missed
BESIDE, APART = 1 / 16, 1 / 2
Progress = Callable[[float], bool]


@dataclass(frozen=True)
class SectionMap:
    """The workspace in one section: codes of a grid with coordinates u and v [m], and the reachable region."""

    section: SectionPlane
    u: Array
    v: Array
    codes: Array
    region: Region
    complete: bool


@dataclass(frozen=True)
class Volume:
    """A workspace from sections.

    Attributes:
        along: positions of the sections along the guideways [m]. areas: of the sections [m2].
        volume: [m3], by the trapezoidal rule.
        error: estimated error of the volume [m3], from the change if every second section is left out; infinite with
            fewer than three sections, without reached sections, or if wide gaps remain at `most` sections.
        coarse: volume of the same sections on a grid with the double step [m3]; NaN if not requested.
        on_edge: whether the workspace extends to the first or last section or to the edge of a section; the volume is
            then that of a part.
        counts: number of points by reason.
    """

    along: Array
    areas: Array
    volume: float
    error: float
    coarse: float
    on_edge: bool
    counts: dict[str, int]
    complete: bool

    @property
    def widest(self) -> float:
        """Largest distance between neighbouring sections [m]; a workspace shorter than that may lie between them."""
        return float(np.max(np.diff(self.along), initial=0.0))


def map_section(
    reach: Reach,
    section: SectionPlane,
    low: Array,
    high: Array,
    step: float,
    *,
    chunk: int = CHUNK,
    progress: Progress | None = None,
) -> SectionMap:
    """Return the workspace within low <= (u, v) <= high [m] of a section, on a grid with `step` [m]; see `map_grid`.

    Reachable area of the L1 in the section through its home [m2]:

    >>> from gtmodel.kinematics.workspace import Bodies, Reach, limited_mechanism, map_section
    >>> robot = limited_mechanism(gt.robots.gantry_tau("l1_tape"), None, Bodies())
    >>> low, high = np.array([-2.1, -0.7]), np.array([0.7, 2.0])
    >>> mapped = map_section(Reach(robot.inverse), robot.section(None), low, high, step=0.05)
    >>> round(float(mapped.region.area), 2)
    3.34
    """
    grid = section_grid(section, low, high, step)
    reach_map: ReachMap = map_grid(reach, grid, chunk=chunk, progress=progress)
    u, v = grid.coordinates
    area = region(lambda uv: reach.inside(section.points(uv)), u, v, reach_map.reachable)
    return SectionMap(section, u, v, reach_map.codes, area, reach_map.complete)


def map_volume(
    reach: Reach,
    section: SectionPlane,
    low: Array,
    high: Array,
    along: Array,
    step: float,
    *,
    tolerance: float | None = None,
    most: int = MOST_SECTIONS,
    coarse: bool = False,
    chunk: int = CHUNK,
    progress: Progress | None = None,
) -> Volume:
    """Return the workspace between the first and the last of the sections at `along` (n,) [m] on the section's normal.

    low, high (2,): corners of the grid in the section's coordinates [m]; step: of the grid [m].

    Without `tolerance` the sections at `along` are mapped. With a `tolerance`, relative to the volume, sections are
    added: first in the middle of the widest gaps, until the gaps are at most 1/16 of the reached length next to reached
    sections and 1/2 elsewhere; then where the area changes most, until the estimated error is below the tolerance or
    the number of sections is `most`. The section at 0 is included if it is within the range. With `coarse`, each
    section is also mapped with the double step.

    The L1 between two sections 1 m apart, without limits of the carts: areas [m2] and volume [m3]:

    >>> from gtmodel.kinematics.workspace import Bodies, Reach, limited_mechanism, map_volume
    >>> robot = limited_mechanism(gt.robots.gantry_tau("l1_tape"), None, Bodies())
    >>> low, high = np.array([-2.1, -0.7]), np.array([0.7, 2.0])
    >>> solid = map_volume(Reach(robot.inverse), robot.section(None), low, high, np.array([-0.5, 0.5]), step=0.05)
    >>> solid.areas.round(2), round(float(solid.volume), 2)
    (array([3.34, 3.34]), 3.34)
    """
    areas: dict[float, tuple[float, float]] = {}
    counts: dict[str, int] = {}
    edges: list[bool] = []
    initial = sorted({float(x) for x in along})
    if tolerance is not None and initial[0] < 0 < initial[-1]:
        initial = sorted({*initial, 0.0})
    stopped = False

    sized = partial(_sized, reach, section, low, high, step, chunk, coarse)

    def add(position: float, size: _Size) -> None:
        nonlocal stopped
        areas[position] = size.area, size.rough
        edges.append(size.on_edge)
        for reason, n in size.counts.items():
            counts[reason] = counts.get(reason, 0) + n
        stopped = progress is not None and progress(min(len(areas) / max(len(initial), 1), 1.0))

    for k, (position, size) in enumerate(zip(initial, mapped(sized, initial), strict=True)):
        add(position, size)
        if stopped and k + 1 < len(initial):
            break
    else:
        stopped = False
    complete = not stopped
    while tolerance is not None and complete and len(areas) < most:
        positions = np.array(sorted(areas))
        sizes = np.array([areas[x][0] for x in positions])
        total = float(np.trapezoid(sizes, positions))
        gaps = np.diff(positions)
        wide = _wide(positions, sizes)
        if wide.any():
            local = np.where(wide, gaps, 0.0)
        elif total > 0:
            if _error(positions, sizes) <= tolerance * total:
                break
            # proportional to the error that the sections next to a gap indicate
            bends = np.abs(_bends(positions, sizes))
            local = np.maximum(np.append(0.0, bends), np.append(bends, 0.0)) * gaps
        else:
            local = gaps
        k = int(np.argmax(local))
        position = float((positions[k] + positions[k + 1]) / 2)
        add(position, sized(position))
        complete = not stopped
    positions = np.array(sorted(areas))
    sizes, rough = (np.array([areas[x][n] for x in positions]) for n in (0, 1))
    error = _error(positions, sizes)
    if tolerance is not None and _wide(positions, sizes).any():
        error = np.inf
    edge = any(edges) or bool(sizes[0] > 0 or sizes[-1] > 0)
    several = len(positions) > 1
    return Volume(
        positions,
        sizes,
        float(np.trapezoid(sizes, positions)) if several else 0.0,
        error,
        float(np.trapezoid(rough, positions)) if several else np.nan,
        edge,
        counts,
        complete,
    )


class _Size(NamedTuple):
    """Area of a section, the same from a grid with the double step, and what else a volume needs of it."""

    area: float
    rough: float
    on_edge: bool
    counts: dict[str, int]


def _sized(
    reach: Reach, section: SectionPlane, low: Array, high: Array, step: float, chunk: int, coarse: bool, position: float
) -> _Size:  # fmt: skip
    plane = section.moved(position)
    fine = map_section(reach, plane, low, high, step, chunk=chunk)
    rough = map_section(reach, plane, low, high, 2 * step, chunk=chunk).region.area if coarse else np.nan
    return _Size(fine.region.area, rough, fine.region.on_edge, reach.counts(fine.codes))


def _error(along: Array, areas: Array) -> float:
    """Estimate the error of the trapezoidal rule: half the sum of the absolute areas of the triangles that inner
    sections add to the trapezoids of their neighbours."""
    if len(along) < 3 or not np.any(areas > 0):
        return np.inf
    return float(np.sum(np.abs(_bends(along, areas)) * (along[2:] - along[:-2]) / 2) / 2)


def _wide(along: Array, areas: Array) -> Array:
    """Return whether each gap is too wide relative to the reached length; False without reached sections."""
    gaps, reached = np.diff(along), areas > 0
    # each section represents half of the adjacent gaps
    length = float(np.sum(reached[1:] * gaps + reached[:-1] * gaps) / 2)
    beside = reached[1:] | reached[:-1]
    return (gaps > np.where(beside, BESIDE, APART) * length * (1 + 1e-9)) & (length > 0)


def _bends(along: Array, areas: Array) -> Array:
    """Return the difference of each inner area from the linear interpolation between its neighbours [m2]."""
    weight = (along[1:-1] - along[:-2]) / (along[2:] - along[:-2])
    return areas[1:-1] - (1 - weight) * areas[:-2] - weight * areas[2:]
