"""The mesh, elements and how the control runs within them, and collocation tables, Radau and Gauss points on (0, 1]
of any order."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from math import comb
from typing import Literal

import numpy as np
from numpy.polynomial import legendre

from ..lang.source import ModelError

SCHEMES = ("radau", "gauss")


@dataclass(frozen=True)
class CollocationTable:
    """Collocation on one element scaled to [0, 1] with K points.

    `points` (K,); `derivative` (K + 1, K): derivative at point c of the state polynomial through node 0 and the
    points; `weights` (K,): quadrature; `end` (K + 1,): value at 1 of that polynomial.
    """

    scheme: str
    points: np.ndarray
    derivative: np.ndarray
    weights: np.ndarray
    end: np.ndarray

    @property
    def nodes(self) -> np.ndarray:
        """Nodes of the state polynomial: 0 and the points."""
        return np.concatenate([[0.0], self.points])


def points(scheme: str, count: int) -> np.ndarray:
    """Radau IIA ("radau", ends at 1) or Gauss-Legendre ("gauss") points on [0, 1]."""
    if count < 1:
        raise ValueError(f"a collocation element needs at least one point; found {count}")
    if scheme == "gauss":
        return (legendre.leggauss(count)[0] + 1) / 2
    if scheme == "radau":
        # roots of P_K - P_(K-1) on [-1, 1] hold 1
        c = np.zeros(count + 1)
        c[count], c[count - 1] = 1.0, -1.0
        roots = np.sort(legendre.legroots(c).real)
        roots[-1] = 1.0
        for _ in range(3):  # Newton polish: companion roots lose digits at high order
            f, df = legendre.legval(roots, c), legendre.legval(roots, legendre.legder(c))
            roots[:-1] -= f[:-1] / df[:-1]
        return (roots + 1) / 2
    raise ValueError(f"there is no collocation scheme '{scheme}'; there are {' and '.join(SCHEMES)}")


@cache
def table(scheme: str, count: int) -> CollocationTable:
    """Points, differentiation matrix, weights and end values; read-only."""
    c = points(scheme, count)
    nodes = np.concatenate([[0.0], c])
    x, w = legendre.leggauss(count + 1)  # exact for the basis, without monomials that lose digits
    weights = (w / 2) @ basis(c, (x + 1) / 2)
    made = CollocationTable(scheme, c, basis_slope(nodes, c).T, weights, basis(nodes, np.array([1.0]))[0])
    for array in (made.points, made.derivative, made.weights, made.end):
        array.setflags(write=False)
    return made


def basis(nodes: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Values (len(at), len(nodes)) of the Lagrange polynomials that are 1 at one node and 0 at the others."""
    at = np.asarray(at, float)
    n = len(nodes)
    values = np.ones((len(at), n))
    for j in range(n):
        for k in range(n):
            if k != j:
                values[:, j] *= (at - nodes[k]) / (nodes[j] - nodes[k])
    return values


def basis_slope(nodes: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Derivatives (len(at), len(nodes)) of the Lagrange polynomials, by the product rule."""
    at = np.asarray(at, float)
    n = len(nodes)
    jacobian = np.zeros((len(at), n))
    for j in range(n):
        for m in range(n):
            if m == j:
                continue
            term = np.full(len(at), 1.0 / (nodes[j] - nodes[m]))
            for k in range(n):
                if k not in (j, m):
                    term *= (at - nodes[k]) / (nodes[j] - nodes[k])
            jacobian[:, j] += term
    return jacobian


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
