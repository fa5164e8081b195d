"""The mesh: elements, control parametrisation, and Radau and Gauss collocation tables of any order on (0, 1]."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from math import comb
from typing import Any, Literal

import numpy as np
from numpy.polynomial import legendre

from ..lang.source import ModelError

SCHEMES = ("radau", "gauss")


@dataclass(frozen=True)
class CollocationTable:
    """Collocation with K points on one element scaled to [0, 1].

    The state polynomial interpolates node 0 and the points. `points` (K,); `derivative` (K + 1, K): its derivative at
    the points; `weights` (K,): quadrature weights; `end` (K + 1,): its value at 1.
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
    """Return Radau IIA ("radau", last point at 1) or Gauss-Legendre ("gauss") points on [0, 1]."""
    if count < 1:
        raise ValueError(f"a collocation element needs at least one point; found {count}")
    if scheme == "gauss":
        return (legendre.leggauss(count)[0] + 1) / 2
    if scheme == "radau":
        # roots of P_K - P_(K-1) on [-1, 1] include 1
        c = np.zeros(count + 1)
        c[count], c[count - 1] = 1.0, -1.0
        roots = np.sort(legendre.legroots(c).real)
        roots[-1] = 1.0
        for _ in range(3):  # Newton steps: roots of the companion matrix lose digits at high order
            f, df = legendre.legval(roots, c), legendre.legval(roots, legendre.legder(c))
            roots[:-1] -= f[:-1] / df[:-1]
        return (roots + 1) / 2
    raise ValueError(f"unknown collocation scheme '{scheme}'; expected {' or '.join(SCHEMES)}")


@cache
def table(scheme: str, count: int) -> CollocationTable:
    """Return the read-only collocation table."""
    c = points(scheme, count)
    nodes = np.concatenate([[0.0], c])
    x, w = legendre.leggauss(count + 1)  # exact for the basis; monomials would lose digits
    weights = (w / 2) @ basis(c, (x + 1) / 2)
    result = CollocationTable(scheme, c, basis_slope(nodes, c).T, weights, basis(nodes, np.array([1.0]))[0])
    for array in (result.points, result.derivative, result.weights, result.end):
        array.setflags(write=False)
    return result


def basis(nodes: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Return values (len(at), len(nodes)) of the Lagrange polynomials of the nodes."""
    at = np.asarray(at, float)
    n = len(nodes)
    values = np.ones((len(at), n))
    for j in range(n):
        for k in range(n):
            if k != j:
                values[:, j] *= (at - nodes[k]) / (nodes[j] - nodes[k])
    return values


def basis_slope(nodes: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Return derivatives (len(at), len(nodes)) of the Lagrange polynomials."""
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


# "polynomial": bounded at the points only; "bernstein": polynomials bounded everywhere; "linear": continuous over the
# whole horizon; "constant" on each element
CONTROLS = ("polynomial", "bernstein", "linear", "constant")


@dataclass(frozen=True)
class BlockedControl:
    """The blocks of one control: elements in each, largest step between neighbours, weight of the squared step."""

    sizes: tuple[int, ...]
    step_max: float
    step_penalty: float

    @property
    def borders(self) -> list[int]:
        """Indices of the elements that begin a block, except the first."""
        return np.cumsum(self.sizes)[:-1].tolist()


Sizes = int | Sequence[int]


@dataclass(frozen=True, kw_only=True)
class Blocks:
    """Move blocking: controls are constant over given numbers of elements.

    Args:
        sizes: number of elements in each block, with the number of elements of the mesh as sum; or one number, that of
            every block, of which the last takes the rest. This holds for all controls; a mapping gives the blocks of
            each control by name. Controls that it does not name follow `control` of the mesh. The name of a vector
            stands for all its entries.
        step_max: largest step between neighbouring blocks in SI units, by name of the control.
        step_penalty: weight of the squared step in the objective, by name of the control.

    Raises ValueError for a size that is not a positive integer, a bound that is not positive, or a negative weight.

    >>> blocks = gt.Blocks(sizes=(2, 3), step_max={"force": 200.0})
    >>> gt.Mesh(5, control="constant", blocks=blocks).elements
    5
    >>> mesh = gt.Mesh(5, control="linear", blocks={"valve": (2, 3), "heater": 2})  # other controls: linear
    >>> mesh.blocks.of(["valve", "heater", "speed"], 5)[1].sizes
    (2, 2, 1)
    """

    sizes: Sizes | Mapping[str, Sizes]
    step_max: Mapping[str, float] = field(default_factory=dict)
    step_penalty: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        named = isinstance(self.sizes, Mapping)
        if named and not self.sizes:
            raise ValueError("blocks need the sizes of at least one control; found none")
        each = {n: _sizes(v, n) for n, v in self.sizes.items()} if isinstance(self.sizes, Mapping) else {}
        object.__setattr__(self, "sizes", each if named else _sizes(self.sizes, ""))
        for name, value in self.step_max.items():
            if not value > 0:
                raise ValueError(f"step_max of '{name}' must be positive; found {value:g}")
        for name, value in self.step_penalty.items():
            if not value >= 0:
                raise ValueError(f"step_penalty of '{name}' must not be negative; found {value:g}")

    @property
    def each(self) -> Mapping[str, Sizes]:
        """Sizes by name of the control; of all controls under the name ""."""
        return self.sizes if isinstance(self.sizes, Mapping) else {"": self.sizes}

    def of(self, controls: Sequence[str], elements: int, title: str = "the model") -> dict[int, BlockedControl]:
        """Return the blocks of each blocked control by its index. title: of the model, for messages.

        Raises ModelError for a name that is not a control, for a control named twice, and for a limit or penalty of a
        control without blocks.
        """
        known = f"controls of {title} are {', '.join(controls) or 'none'}"
        sizes: dict[int, tuple[int, ...]] = {}
        for name, value in self.each.items():
            indices = [j for j, c in enumerate(controls) if not name or is_of(name, c)]
            if name and not indices:
                raise ModelError(f"blocks name the unknown control '{name}'; {known}")
            for j in indices:
                if j in sizes:
                    raise ModelError(f"blocks give the sizes of '{controls[j]}' twice; keep one of them")
                sizes[j] = _filled(value, elements)
        limits: dict[str, dict[int, float]] = {"step_max": {}, "step_penalty": {}}
        for what, given in (("step_max", self.step_max), ("step_penalty", self.step_penalty)):
            for name, value in given.items():
                indices = [j for j, c in enumerate(controls) if is_of(name, c)]
                if not indices:
                    raise ModelError(f"blocks name the unknown control '{name}' in {what}; {known}")
                free = [controls[j] for j in indices if j not in sizes]
                if free:
                    raise ModelError(f"{what} limits steps of '{free[0]}', which has no blocks; give its sizes")
                limits[what] |= {j: value for j in indices}
        most, weights = limits["step_max"], limits["step_penalty"]
        return {j: BlockedControl(s, most.get(j, np.inf), weights.get(j, 0.0)) for j, s in sorted(sizes.items())}


def _sizes(value: Any, name: str) -> Sizes:
    """Return block sizes as an integer or a tuple. Raises ValueError."""
    numbers = (value,) if isinstance(value, (int, np.integer)) else tuple(value)
    whole = [isinstance(n, (int, np.integer)) and not isinstance(n, bool) and n >= 1 for n in numbers]
    if not numbers or not all(whole):
        of = f" of '{name}'" if name else ""
        raise ValueError(f"each block size{of} must be a positive integer; found {numbers}")
    return int(value) if isinstance(value, (int, np.integer)) else tuple(int(n) for n in numbers)


def _filled(sizes: Sizes, elements: int) -> tuple[int, ...]:
    """Return the sizes of all blocks; the last block of equal ones takes the rest."""
    if not isinstance(sizes, int):
        return tuple(sizes)
    whole, rest = divmod(elements, sizes)
    return (sizes,) * whole + ((rest,) if rest else ())


def is_of(name: str, element: str) -> bool:
    """Return whether `element` is the quantity of that name or an entry of that vector."""
    return element == name or element.startswith(f"{name}[")


@dataclass(frozen=True, kw_only=True)
class LengthCost:
    """Cost of free element lengths, added to the objective.

    uneven * sum_i (h_i / h_i0 - 1)^2 + sum_i h_i^(1 + power) * integral over element i of sum_n rates[n] x_n'(t)^2 dt

    with the element lengths h_i as fractions of the horizon (sum 1) and their initial values h_i0. The first term keeps
    lengths near the given ones and makes them unique; the second shortens elements in which states change fast, as
    JModelica's FreeElementLengthsData with c Q = rates and a = power.

    Args:
        uneven: weight of the first term.
        rates: weights of the squared rates by name of the state, in SI units; the name of a vector stands for all its
            entries.
        power: exponent of the second term.

    Raises ValueError for a negative weight or power, and if all weights are zero.

    >>> gt.LengthCost(uneven=1e-3, rates={"speed": 0.1}).power
    1.0
    """

    uneven: float = 0.0
    rates: Mapping[str, float] = field(default_factory=dict)
    power: float = 1.0

    def __post_init__(self) -> None:
        numbers = {"uneven": self.uneven, "power": self.power, **{f"rates of '{n}'": w for n, w in self.rates.items()}}
        for name, value in numbers.items():
            if not 0 <= value < np.inf:
                raise ValueError(f"{name} of a length cost must be finite and not negative; found {value:g}")
        if not self.uneven and not any(self.rates.values()):
            raise ValueError("a length cost needs a positive weight: uneven, or rates by name of a state")

    def weights(self, states: Sequence[Sequence[str]]) -> np.ndarray:
        """Return the weight of each state's squared rate, from all its names. Raises ModelError for an unknown name."""
        result = np.zeros(len(states))
        for name, weight in self.rates.items():
            indices = [j for j, names in enumerate(states) if any(is_of(name, n) for n in names)]
            if not indices:
                known = ", ".join(names[0] for names in states) or "none"
                raise ModelError(f"length_cost names '{name}', which is not a state; states are {known}")
            result[indices] = weight
        return result


def coefficients(control: str, table: CollocationTable) -> int:
    """Return the number of coefficients of one control on one element."""
    return {"constant": 1, "linear": 2}.get(control, len(table.points))


def control_basis(control: str, table: CollocationTable, s: np.ndarray) -> np.ndarray:
    """Return values (len(s), coefficients) of the control's basis functions; each row sums to 1."""
    s = np.asarray(s, float)
    if control == "constant":
        return np.ones((len(s), 1))
    if control == "linear":
        return np.column_stack([1 - s, s])
    if control == "bernstein":
        n = len(table.points) - 1
        return np.column_stack([comb(n, j) * s**j * (1 - s) ** (n - j) for j in range(n + 1)])
    return basis(table.points, s)


ROUND_OFF = 1e-9  # of fractions of the horizon: rounding of summed lengths and of times divided by durations


@dataclass(frozen=True)
class Mesh:
    """Mesh for direct collocation: `elements` elements with `points` points each.

    Args:
        elements: number of elements.
        points: collocation points per element.
        scheme: "radau" (last point at the element's end) or "gauss".
        control: "polynomial" (bounded at the points only), "bernstein" (the same polynomials, bounded at every instant
            through their Bernstein coefficients), "linear" (continuous) or "constant" on each element.
        lengths: relative element lengths; equal if None.
        length_ratio: (low, high) makes the lengths free: each may vary between low and high times its nominal length;
            their sum stays the horizon. Do not combine it with control "polynomial", whose overshoots it exploits.
        length_limits: (shortest, longest) duration of every element [s], for free lengths.
        length_cost: cost of free lengths, see `LengthCost`.
        blocks: keep controls constant over several elements: `Blocks`, or its sizes alone, such as
            {"force": (2, 3), "valve": 5}. Sizes for all controls at once need control "constant".

    Raises ValueError for values out of range and unknown words.

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
    length_limits: tuple[float, float] | None = field(default=None, kw_only=True)
    length_cost: LengthCost | None = field(default=None, kw_only=True)
    blocks: Blocks | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        for name in ("elements", "points"):
            value = getattr(self, name)
            if not isinstance(value, (int, np.integer)) or isinstance(value, bool):
                raise ModelError(f"{name} of a mesh must be an integer; found {value!r}")
        if self.elements < 1 or self.points < 1:
            raise ValueError(f"a mesh needs at least one element and one point; found {self.elements} x {self.points}")
        if self.scheme not in SCHEMES:
            raise ValueError(f"scheme must be 'radau' or 'gauss'; found '{self.scheme}'")
        if self.control not in CONTROLS:
            raise ValueError(f"control must be one of {', '.join(CONTROLS)}; found '{self.control}'")
        if self.lengths is not None and (
            np.shape(self.lengths) != (self.elements,) or not all(0 < h < np.inf for h in self.lengths)
        ):
            raise ModelError(
                f"a mesh of {self.elements} elements needs {self.elements} positive, finite lengths; "
                f"found {self.lengths}"
            )
        if self.length_ratio is not None and not 0 < self.length_ratio[0] <= 1 <= self.length_ratio[1]:
            raise ValueError(
                f"length_ratio must be (low, high) with 0 < low <= 1 <= high: shortest and longest element length "
                f"relative to the nominal one; found {self.length_ratio}"
            )
        for name in ("length_limits", "length_cost"):
            if getattr(self, name) is not None and self.length_ratio is None:
                raise ValueError(f"{name} needs free element lengths; give length_ratio, such as (0.2, 3.0)")
        limits = self.length_limits
        if limits is not None and not 0 <= limits[0] <= limits[1]:
            raise ValueError(
                f"length_limits must be (shortest, longest) duration of an element in seconds, with 0 <= shortest <= "
                f"longest; found {limits}"
            )
        if self.blocks is not None and not isinstance(self.blocks, Blocks):
            object.__setattr__(self, "blocks", Blocks(sizes=self.blocks))
        for name, sizes in self.blocks.each.items() if self.blocks is not None else ():
            if not name and self.control != "constant":
                raise ValueError(
                    f"blocks need control 'constant'; found '{self.control}' (or give sizes by name of the control)"
                )
            if not isinstance(sizes, int) and sum(sizes) != self.elements:
                of = f" of '{name}'" if name else ""
                raise ValueError(f"block sizes{of} sum to {sum(sizes)}, but the mesh has {self.elements} elements")

    @property
    def table(self) -> CollocationTable:
        return table(self.scheme, self.points)

    @property
    def h(self) -> np.ndarray:
        """Element lengths with sum 1; the initial ones if the lengths are free."""
        h = np.ones(self.elements) if self.lengths is None else np.array(self.lengths, float)
        return h / h.sum()

    def element_at(self, s: float) -> int:
        """Return the index of the element that contains the fraction s of the horizon; at an edge, the right one."""
        edge = int(np.searchsorted(self.edges, s + ROUND_OFF, side="right"))
        return min(self.elements - 1, max(0, edge - 1))

    def is_point(self, local: float) -> bool:
        """Return whether a fraction of an element is one of its collocation points."""
        return bool(np.any(np.abs(self.table.points - local) <= ROUND_OFF))

    @property
    def edges(self) -> np.ndarray:
        """Element boundaries on [0, 1], (elements + 1,)."""
        return np.concatenate([[0.0], np.cumsum(self.h)[:-1], [1.0]])


def given_mesh(mesh: Mesh | None) -> Mesh:
    """Return the mesh, or the default one for None. Raises ModelError for another type."""
    if mesh is None:
        return Mesh()
    if not isinstance(mesh, Mesh):
        raise ModelError(f"the mesh must be a gt.Mesh(elements, points); found {mesh!r}")
    return mesh
