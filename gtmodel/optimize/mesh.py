"""The mesh: elements, collocation points and how the control is parametrised."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from .tables import SCHEMES, Table, table


@dataclass(frozen=True)
class Mesh:
    """Direct collocation on `elements` elements with `points` points each.

    Args:
        elements: number of elements.
        points: collocation points per element.
        scheme: "radau" (ends at the element's end) or "gauss".
        control: "polynomial" (free at each point, bounded there only) or "constant" on each element.
        lengths: relative element lengths; equal if None.
    """

    elements: int = 50
    points: int = 3
    scheme: Literal["radau", "gauss"] = "radau"
    control: Literal["polynomial", "constant"] = "polynomial"
    lengths: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        if self.elements < 1 or self.points < 1:
            raise ValueError(f"a mesh needs at least one element and one point; found {self.elements} x {self.points}")
        if self.scheme not in SCHEMES:
            raise ValueError(f"scheme is 'radau' or 'gauss'; found '{self.scheme}'")
        if self.control not in ("polynomial", "constant"):
            raise ValueError(f"control is 'polynomial' or 'constant'; found '{self.control}'")
        if self.lengths is not None and (len(self.lengths) != self.elements or min(self.lengths) <= 0):
            raise ValueError(f"a mesh of {self.elements} elements takes as many positive lengths")

    @property
    def table(self) -> Table:
        return table(self.scheme, self.points)

    @property
    def h(self) -> np.ndarray:
        """Element lengths, sum 1."""
        h = np.ones(self.elements) if self.lengths is None else np.array(self.lengths, float)
        return h / h.sum()

    def element_at(self, s: float) -> int:
        """Number of the element that holds the fraction s of the horizon; at an edge the one on its right."""
        return min(self.elements - 1, max(0, int(np.searchsorted(self.edges, s, side="right")) - 1))

    @property
    def edges(self) -> np.ndarray:
        """Element boundaries on [0, 1], (elements + 1,)."""
        return np.concatenate([[0.0], np.cumsum(self.h)[:-1], [1.0]])
