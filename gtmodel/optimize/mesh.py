"""The mesh: elements, collocation points and how the control is parametrised."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from ..lang.source import ModelError
from .control import CONTROLS, Blocks
from .tables import SCHEMES, CollocationTable, table

ROUND_OFF = 1e-9  # of fractions of the horizon: sums of lengths and times over durations miss an edge by as much


@dataclass(frozen=True)
class Mesh:
    """Mesh of a direct collocation: `elements` elements with `points` points each.

    Args:
        elements: number of elements.
        points: collocation points per element.
        scheme: "radau" (ends at the element's end) or "gauss".
        control: "polynomial" (free at each point, bounded there only), "bernstein" (the same polynomials, bounded
            at every instant through their Bernstein coefficients), "linear" (continuous) or "constant" on each element.
        lengths: relative element lengths; equal if None.
        length_ratio: (low, high) makes the lengths free: each lies between low and high times its given length, and
            they still fill the horizon. A control "polynomial" would use its overshoots then: take another one.
        blocks: the control is constant over several elements; with control "constant".

    Raises ValueError for numbers and words that make no mesh.

    >>> mesh = gt.Mesh(20, control="linear", length_ratio=(0.2, 3.0))
    >>> mesh.elements, mesh.points, mesh.scheme
    (20, 3, 'radau')
    """

    elements: int = 50
    points: int = 3
    scheme: Literal["radau", "gauss"] = "radau"
    control: Literal["polynomial", "bernstein", "linear", "constant"] = "polynomial"
    lengths: tuple[float, ...] | None = None
    length_ratio: tuple[float, float] | None = field(default=None, kw_only=True)
    blocks: Blocks | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        for name in ("elements", "points"):
            value = getattr(self, name)
            if not isinstance(value, (int, np.integer)) or isinstance(value, bool):
                raise ModelError(f"{name} of a mesh is a whole number; found {value!r}")
        if self.elements < 1 or self.points < 1:
            raise ValueError(f"a mesh needs at least one element and one point; found {self.elements} x {self.points}")
        if self.scheme not in SCHEMES:
            raise ValueError(f"scheme is 'radau' or 'gauss'; found '{self.scheme}'")
        if self.control not in CONTROLS:
            raise ValueError(f"control is one of {', '.join(CONTROLS)}; found '{self.control}'")
        if self.lengths is not None and (
            np.shape(self.lengths) != (self.elements,) or not all(0 < h < np.inf for h in self.lengths)
        ):
            raise ModelError(
                f"a mesh of {self.elements} elements takes as many positive lengths, all of them finite; "
                f"found {self.lengths}"
            )
        if self.length_ratio is not None and not 0 < self.length_ratio[0] <= 1 <= self.length_ratio[1]:
            raise ValueError(
                f"length_ratio is (low, high) with 0 < low <= 1 <= high: shortest and longest length of an element "
                f"over its given one; found {self.length_ratio}"
            )
        if self.blocks is not None and self.control != "constant":
            raise ValueError(f"blocks take control 'constant'; found '{self.control}'")
        if self.blocks is not None and sum(self.blocks.sizes) != self.elements:
            raise ValueError(f"blocks hold {sum(self.blocks.sizes)} elements, but the mesh has {self.elements}")

    @property
    def table(self) -> CollocationTable:
        return table(self.scheme, self.points)

    @property
    def h(self) -> np.ndarray:
        """Element lengths, sum 1; where they are free, those they start from."""
        h = np.ones(self.elements) if self.lengths is None else np.array(self.lengths, float)
        return h / h.sum()

    def element_at(self, s: float) -> int:
        """Number of the element that holds the fraction s of the horizon; at an edge the one on its right."""
        edge = int(np.searchsorted(self.edges, s + ROUND_OFF, side="right"))
        return min(self.elements - 1, max(0, edge - 1))

    def is_point(self, local: float) -> bool:
        """Is a fraction of an element one of its collocation points?"""
        return bool(np.any(np.abs(self.table.points - local) <= ROUND_OFF))

    @property
    def edges(self) -> np.ndarray:
        """Element boundaries on [0, 1], (elements + 1,)."""
        return np.concatenate([[0.0], np.cumsum(self.h)[:-1], [1.0]])


def given_mesh(mesh: Mesh | None) -> Mesh:
    """The mesh that was given, or the default one. Raises ModelError for what is no mesh."""
    if mesh is None:
        return Mesh()
    if not isinstance(mesh, Mesh):
        raise ModelError(f"a mesh is a gt.Mesh(elements, points); found {mesh!r}")
    return mesh
