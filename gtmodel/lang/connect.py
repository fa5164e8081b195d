"""connect(a, b): potentials equal, flows sum to zero; and branch(name, expression)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from .declare import Port
from .expression import Expr, Relation
from .model import Connector
from .slips import named
from .source import ModelError, SourceLocation, here
from .units import si_unit


@dataclass(frozen=True, eq=False)
class Connection:
    """Two connectors joined, and the line that joins them."""

    a: Connector
    b: Connector
    where: SourceLocation


@dataclass(frozen=True, eq=False)
class Branch:
    """A geometric name for one of several solutions: the sign of `expression`."""

    name: str
    expression: Expr
    where: SourceLocation


@dataclass(frozen=True, eq=False)
class Energy:
    """A term of the energy balance: "stored" [J], "supplied" [W] or "dissipated" [W]."""

    kind: str
    expression: Expr
    where: SourceLocation


@dataclass(frozen=True, eq=False)
class TreeEdge:
    """What is overdetermined in port b follows from port a; a None: from the component itself, b is a root."""

    a: Connector | None
    b: Connector
    where: SourceLocation


def tree_edge(a: Any, b: Any) -> TreeEdge:
    """Say that the orientation of port b follows from that of port a through this component's equations.

    For connectors that declare `overdetermined`. Connections and edges must form trees, each with at most one root.
    """
    first, second = _overdetermined("tree_edge", a, b)
    return TreeEdge(first, second, here())


def tree_root(port: Any) -> TreeEdge:
    """Say that this component alone gives the orientation of a port: the world, a free body."""
    (root,) = _overdetermined("tree_root", port)
    return TreeEdge(None, root, here())


def _overdetermined(name: str, *ports: Any) -> tuple[Connector, ...]:
    for p in ports:
        if not isinstance(p, Connector) or not p.overdetermined:
            raise ModelError(
                f"{name}() takes ports whose connector is overdetermined; found {type(p).__name__}", here()
            )
    return ports


def energy(*, stored: Any = None, supplied: Any = None, dissipated: Any = None) -> list[Energy]:
    """Declare what a component contributes to the energy balance of a simulation.

    stored: energy held [J]; supplied: power fed in from outside [W]; dissipated: power lost [W]. Scalars.
    """
    units = {"stored": "J", "supplied": "W", "dissipated": "W"}
    result = []
    for kind, value in (("stored", stored), ("supplied", supplied), ("dissipated", dissipated)):
        if value is None:
            continue
        if not isinstance(value, Expr) or value.shape != ():
            raise ModelError(f"energy({kind}=...) takes a scalar expression", here())
        if value.dimension is not None and value.dimension != si_unit(units[kind]).dimension:
            raise ModelError(f"energy({kind}=...) is in {units[kind]}; found {value.dimension}", here())
        result.append(Energy(kind, value, here()))
    return result


@named
def connect(a: Any, b: Any) -> Connection | list[Any]:
    """Join two ports of the same connector class (or two equally long arrays of ports).

    Raises ModelError if the classes or lengths differ or if an argument is no port.
    """
    if isinstance(a, list) or isinstance(b, list):
        if not (isinstance(a, list) and isinstance(b, list) and len(a) == len(b)):
            raise ModelError("connect() takes two ports or two arrays of ports of equal length", here())
        return [connect(x, y) for x, y in zip(a, b, strict=True)]
    for p in (a, b):
        if not isinstance(p, Connector):
            raise ModelError(f"connect() takes ports; found {type(p).__name__}", here())
    if a._signature() != b._signature():
        raise ModelError(
            f"'{a._path}' is a {type(a).__name__} and '{b._path}' a {type(b).__name__}: "
            "only ports of one connector class can be connected",
            here(),
        )
    if a is b:
        raise ModelError(f"port '{a._path}' is connected to itself", here())
    inner = [connect(getattr(a, n), getattr(b, n)) for n, item in type(a)._declared.items() if isinstance(item, Port)]
    return [Connection(a, b, here()), *inner] if inner else Connection(a, b, here())


def branch(name: str, expression: Any) -> Branch:
    """Name a branch by geometry: solutions are told apart by the sign of a scalar expression.

    The default configuration is the positive side; ask for the other one with
    `model.causal(..., branches={"arm[0].ahead": -1})`.
    """
    if not isinstance(expression, Expr) or expression.shape != ():
        raise ModelError(f"branch '{name}' takes a scalar expression", here())
    return Branch(name, expression, here())


def between(low: Any, x: Any, high: Any) -> list[Relation]:
    """low <= x <= high."""
    return [x >= low, x <= high]


def flatten_items(item: Any) -> Iterator[Any]:
    """Items yielded by equations(): lists are opened, everything else passes."""
    if isinstance(item, (list, tuple)):
        for x in item:
            yield from flatten_items(x)
    else:
        yield item
