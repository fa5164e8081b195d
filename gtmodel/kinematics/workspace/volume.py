"""Workspaces by sections: the region in a section, and the volume of a row of sections."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..section import Section
from .cross_section import Region, region
from .grid import section_grid
from .reach import CHUNK, Reach, ReachMap, map_grid

Array = np.ndarray
Progress = Callable[[float], bool]


@dataclass(frozen=True)
class SectionMap:
    """The workspace in one section: codes of a grid with coordinates u and v [m], and the region reached."""

    section: Section
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
        on_edge: the workspace reaches the first or last section, or the edge of one: the volume is that of a part.
        counts: number of points by reason.
    """

    along: Array
    areas: Array
    volume: float
    on_edge: bool
    counts: dict[str, int]
    complete: bool


def map_section(
    reach: Reach,
    section: Section,
    low: Array,
    high: Array,
    step: float,
    *,
    chunk: int = CHUNK,
    client: Any = None,
    progress: Progress | None = None,
) -> SectionMap:
    """The workspace within low <= (u, v) <= high [m] of a section, on a grid of `step` [m]; see `map_grid`."""
    grid = section_grid(section, low, high, step)
    found: ReachMap = map_grid(reach, grid, chunk=chunk, client=client, progress=progress)
    u, v = grid.coordinates
    area = region(lambda uv: reach.inside(section.points(uv)), u, v, found.reachable)
    return SectionMap(section, u, v, found.codes, area, found.complete)


def map_volume(
    reach: Reach,
    section: Section,
    low: Array,
    high: Array,
    along: Array,
    step: float,
    *,
    chunk: int = CHUNK,
    client: Any = None,
    progress: Progress | None = None,
) -> Volume:
    """The workspace between the first and the last of the sections at `along` [m], moved along the normal."""
    areas, counts, edge, complete = [], {}, False, True
    for k, position in enumerate(along):
        here = Section(section.origin + position * section.normal, section.across, section.up, section.normal)
        found = map_section(reach, here, low, high, step, chunk=chunk, client=client)
        areas.append(found.region.area)
        edge = edge or found.region.on_edge
        for reason, n in reach.counts(found.codes).items():
            counts[reason] = counts.get(reason, 0) + n
        if progress is not None and progress((k + 1) / len(along)) and k + 1 < len(along):
            along, complete = along[: k + 1], False
            break
    areas = np.array(areas)
    edge = edge or bool(areas[0] > 0 or areas[-1] > 0)
    total = float(np.trapezoid(areas, along)) if len(areas) > 1 else 0.0
    return Volume(np.asarray(along), areas, total, edge, counts, complete)
