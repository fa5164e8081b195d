"""Workspaces by sections: the region in a section, and the volume of a row of sections."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..section import SectionPlane
from .cross_section import Region, region
from .grid import section_grid
from .options import MOST_SECTIONS
from .reach import CHUNK, Reach, ReachMap, map_grid

Array = np.ndarray
# widest gaps with a tolerance, as shares of the length reached so far: beside a section that is reached, and where none
# is; a part narrower than that and apart from the others may stay unseen
BESIDE, APART = 1 / 16, 1 / 2
Progress = Callable[[float], bool]


@dataclass(frozen=True)
class SectionMap:
    """The workspace in one section: codes of a grid with coordinates u and v [m], and the region reached."""

    section: SectionPlane
    u: Array
    v: Array
    codes: Array
    region: Region
    complete: bool


@dataclass(frozen=True)
class Volume:
    """A workspace by sections.

    Attributes:
        along: positions of the sections along the guideways [m]. areas: of the sections [m2].
        volume: [m3], by the trapezoidal rule.
        error: of the volume [m3], estimated by how much it changed when the sections between were added;
            infinite with fewer than three sections, where none of them is reached, and where `most` leave wide gaps.
        coarse: the volume of the same sections on a grid of the double step [m3]; NaN where it was not asked for.
        on_edge: the workspace reaches the first or last section, or the edge of one: the volume is that of a part.
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
        """Greatest distance of two neighbouring sections [m]: a workspace narrower than that may lie between them."""
        return float(np.max(np.diff(self.along), initial=0.0))


def map_section(
    reach: Reach,
    section: SectionPlane,
    low: Array,
    high: Array,
    step: float,
    *,
    chunk: int = CHUNK,
    client: Any = None,
    progress: Progress | None = None,
) -> SectionMap:
    """The workspace within low <= (u, v) <= high [m] of a section, on a grid of `step` [m]; see `map_grid`.

    The area that the L1 reaches in a section through its home [m2]:

    >>> from gtmodel.kinematics.workspace import Bodies, Reach, limited_mechanism, map_section
    >>> robot = limited_mechanism(gt.robots.gantry_tau("l1_tape"), None, Bodies())
    >>> low, high = np.array([-2.1, -0.7]), np.array([0.7, 2.0])
    >>> mapped = map_section(Reach(robot.inverse), robot.section(None), low, high, step=0.05)
    >>> round(float(mapped.region.area), 2)
    3.34
    """
    grid = section_grid(section, low, high, step)
    reach_map: ReachMap = map_grid(reach, grid, chunk=chunk, client=client, progress=progress)
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
    client: Any = None,
    progress: Progress | None = None,
) -> Volume:
    """The workspace between the first and the last of the sections at `along` (n,) [m], moved along the normal.

    low, high (2,): corners of the grid in the section's coordinates [m]; step: of the grid [m].

    With a `tolerance` [share of the volume] sections are added in the middle of the widest gaps until these are a 16th
    of the length reached, half of it where nothing is reached, then where the area changes most, until the estimated
    error is below it or there are `most`; the section itself, at 0, is one of them if it lies between. Else there are
    those at `along` alone. `coarse`: each is mapped on the double step too.

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
    wanted = sorted({float(x) for x in along})
    if tolerance is not None and wanted[0] < 0 < wanted[-1]:
        wanted = sorted({*wanted, 0.0})
    stopped = False

    def add(position: float) -> None:
        nonlocal stopped
        here = section.moved(position)
        section_map = map_section(reach, here, low, high, step, chunk=chunk, client=client)
        rough = np.nan
        if coarse:
            rough = map_section(reach, here, low, high, 2 * step, chunk=chunk, client=client).region.area
        areas[position] = section_map.region.area, rough
        edges.append(section_map.region.on_edge)
        for reason, n in reach.counts(section_map.codes).items():
            counts[reason] = counts.get(reason, 0) + n
        stopped = progress is not None and progress(min(len(areas) / max(len(wanted), 1), 1.0))

    for k, position in enumerate(wanted):
        add(position)
        if stopped and k + 1 < len(wanted):
            break
    else:
        stopped = False
    complete = not stopped
    while tolerance is not None and complete and len(areas) < most:
        places = np.array(sorted(areas))
        sizes = np.array([areas[x][0] for x in places])
        total = float(np.trapezoid(sizes, places))
        gaps = np.diff(places)
        wide = _wide(places, sizes)
        if wide.any():
            local = np.where(wide, gaps, 0.0)
        elif total > 0:
            if _error(places, sizes) <= tolerance * total:
                break
            # half of a gap's share of what the sections beside it change
            beside = np.abs(_bends(places, sizes))
            local = np.maximum(np.append(0.0, beside), np.append(beside, 0.0)) * gaps
        else:
            local = gaps
        k = int(np.argmax(local))
        add(float((places[k] + places[k + 1]) / 2))
        complete = not stopped
    places = np.array(sorted(areas))
    sizes, rough = (np.array([areas[x][n] for x in places]) for n in (0, 1))
    error = _error(places, sizes)
    if tolerance is not None and _wide(places, sizes).any():
        error = np.inf
    edge = any(edges) or bool(sizes[0] > 0 or sizes[-1] > 0)
    several = len(places) > 1
    return Volume(
        places,
        sizes,
        float(np.trapezoid(sizes, places)) if several else 0.0,
        error,
        float(np.trapezoid(rough, places)) if several else np.nan,
        edge,
        counts,
        complete,
    )


def _error(along: Array, areas: Array) -> float:
    """Estimated error of the trapezoidal rule: the sum of the triangles that each section adds to its neighbours, which
    would be counted twice if every second one were left out, without regard to sign."""
    if len(along) < 3 or not np.any(areas > 0):
        return np.inf
    return float(np.sum(np.abs(_bends(along, areas)) * (along[2:] - along[:-2]) / 2) / 2)


def _wide(along: Array, areas: Array) -> Array:
    """Gaps in which a part as long as a share of what is reached could lie unseen; none while nothing is reached."""
    gaps, reached = np.diff(along), areas > 0
    # each section stands for half of the gaps beside it
    length = float(np.sum(reached[1:] * gaps + reached[:-1] * gaps) / 2)
    beside = reached[1:] | reached[:-1]
    return (gaps > np.where(beside, BESIDE, APART) * length * (1 + 1e-9)) & (length > 0)


def _bends(along: Array, areas: Array) -> Array:
    """How far each inner section's area is from the straight line between its neighbours' [m2]."""
    share = (along[1:-1] - along[:-2]) / (along[2:] - along[:-2])
    return areas[1:-1] - (1 - share) * areas[:-2] - share * areas[2:]
