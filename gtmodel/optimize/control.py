"""How a control runs within an element: coefficients times functions of the fraction s of the element."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import comb

import numpy as np

from .tables import CollocationTable, basis

# "polynomial": free at each point and bounded there only; "bernstein": the same polynomials, bounded everywhere;
# "linear": continuous over the whole horizon; "constant" on each element
CONTROLS = ("polynomial", "bernstein", "linear", "constant")


@dataclass(frozen=True, kw_only=True)
class Blocks:
    """Move blocking: the control is constant over given numbers of elements.

    Args:
        sizes: elements of each block; they sum to the mesh's.
        step_max: largest step between neighbouring blocks, by the control's name, in its SI unit.
        step_penalty: weight of the squared step in the objective, by the control's name.

    Raises ValueError for a size that is no whole number of at least one, a bound that is not positive or a negative
    weight.

    >>> blocks = gt.Blocks(sizes=(2, 3), step_max={"force": 200.0})
    >>> gt.Mesh(5, control="constant", blocks=blocks).elements
    5
    """

    sizes: tuple[int, ...]
    step_max: Mapping[str, float] = field(default_factory=dict)
    step_penalty: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "sizes", tuple(self.sizes))
        if not self.sizes or not all(isinstance(n, (int, np.integer)) and n >= 1 for n in self.sizes):
            raise ValueError(f"each block holds a whole number of elements, at least one; found sizes {self.sizes}")
        for name, value in self.step_max.items():
            if not value > 0:
                raise ValueError(f"the largest step of '{name}' between blocks is positive; found {value:g}")
        for name, value in self.step_penalty.items():
            if not value >= 0:
                raise ValueError(f"the penalty on steps of '{name}' is not negative; found {value:g}")

    @property
    def borders(self) -> list[int]:
        """Numbers of the elements that begin a new block, the first left out."""
        return np.cumsum(self.sizes)[:-1].tolist()


def coefficients(control: str, table: CollocationTable) -> int:
    """How many numbers describe one control on one element."""
    return {"constant": 1, "linear": 2}.get(control, len(table.points))


def control_basis(control: str, table: CollocationTable, s: np.ndarray) -> np.ndarray:
    """Values (len(s), coefficients) of the functions that the coefficients multiply; each row sums to 1."""
    s = np.asarray(s, float)
    if control == "constant":
        return np.ones((len(s), 1))
    if control == "linear":
        return np.column_stack([1 - s, s])
    if control == "bernstein":
        n = len(table.points) - 1
        return np.column_stack([comb(n, j) * s**j * (1 - s) ** (n - j) for j in range(n + 1)])
    return basis(table.points, s)
