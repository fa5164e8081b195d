"""connect(a, b): potentials equal, flows sum to zero; and branch(name, expression)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from .declare import Port
from .expression import Expr, Relation
from .model import Connector
from .slips import CallError, named
from .source import ModelError, SourceLocation, here
from .units import si_unit


@dataclass(frozen=True, eq=False)
class Connection:
    """Two connectors that are joined, and the line that joins them. Made by `gt.connect`."""

    a: Connector
    b: Connector
    where: SourceLocation


@dataclass(frozen=True, eq=False)
class Branch:
    """A geometric name for one of several solutions: the sign of `expression`. Made by `gt.branch`."""

    name: str
    expression: Expr
    where: SourceLocation


@dataclass(frozen=True, eq=False)
class Energy:
    """A term of the energy balance: "stored" [J], "supplied" [W] or "dissipated" [W]. Made by `gt.energy`."""

    kind: str
    expression: Expr
    where: SourceLocation


@dataclass(frozen=True, eq=False)
class TreeEdge:
    """The orientation of port b follows from port a's; where a is None, from the component itself, and b is a root.

    Made by `gt.tree_edge` and `gt.tree_root`.
    """

    a: Connector | None
    b: Connector
    where: SourceLocation


def tree_edge(a: Any, b: Any) -> TreeEdge:
    """Say that the orientation of port b follows from that of port a through this component's equations.

    Yield it in the equations of a component whose ports are `overdetermined` connectors, such as gt.mechanics.Frame,
    whose rotation matrix has nine entries for three degrees of freedom. Connections and edges must form trees, each
    with at most one root (see `tree_root`); a loop would ask for the same orientation twice, and is refused with the
    place of its connections. Raises ModelError for a port whose connector is not overdetermined.

    >>> class Flipped(gt.Model):  # frame b stands as frame a does, turned by half a turn about z
    ...     a = gt.port(gt.mechanics.Frame)
    ...     b = gt.port(gt.mechanics.Frame)
    ...     def equations(self):
    ...         a, b = self.a, self.b
    ...         yield gt.tree_edge(a, b)
    ...         yield b.R == a.R @ np.diag([-1.0, -1.0, 1.0])
    ...         yield b.r == a.r
    ...         yield b.w == a.w
    ...         yield a.f + b.f == 0
    ...         yield a.t + b.t == 0
    >>> class Machine(gt.Model):
    ...     ground = gt.part(gt.mechanics.Ground)
    ...     flipped = gt.part(Flipped)
    ...     def equations(self):
    ...         yield gt.connect(self.ground.frame, self.flipped.a)
    >>> R, status = Machine().causal(targets="flipped.b.R")()
    >>> R.diagonal().tolist()
    [-1.0, -1.0, 1.0]
    """
    first, second = _overdetermined("tree_edge", a, b)
    return TreeEdge(first, second, here())


def tree_root(port: Any) -> TreeEdge:
    """Say that this component alone gives the orientation of a port, as the world or a free body does.

    Yield it in the equations of such a component; see `tree_edge`. Raises ModelError for a port whose connector is not
    overdetermined.

    >>> class Table(gt.Model):  # stands 0.8 m above the world's origin
    ...     frame = gt.port(gt.mechanics.Frame)
    ...     def equations(self):
    ...         yield gt.tree_root(self.frame)
    ...         yield self.frame.r == [0.0, 0.0, 0.8]
    ...         yield self.frame.R == np.eye(3)
    ...         yield self.frame.w == [0.0, 0.0, 0.0]
    >>> Table().causal(targets="frame.r")()[0].tolist()
    [0.0, 0.0, 0.8]
    """
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
    """Say what a component contributes to the energy balance of a simulation; yield it among the equations.

    Args:
        stored: energy that it holds [J], kinetic or potential.
        supplied: power that is fed in from outside [W].
        dissipated: power that is lost [W], not negative.

    All are scalars, and each may be left out. `simulate` checks that what is stored changes as supplied minus
    dissipated say, over all parts: a wrong sign in an equation shows there. Raises ModelError for another shape or
    unit.

    >>> class Oscillator(gt.Model):
    ...     m = gt.parameter(2.0, unit="kg")
    ...     k = gt.parameter(50.0, unit="N/m")
    ...     x = gt.variable(unit="m", start=0.1, fixed=True)
    ...     v = gt.variable(unit="m/s", start=0.0, fixed=True)
    ...     def equations(self):
    ...         yield gt.der(self.x) == self.v
    ...         yield self.m * gt.der(self.v) == -self.k * self.x
    ...         yield gt.energy(stored=self.m / 2 * self.v**2 + self.k / 2 * self.x**2)
    >>> run = Oscillator().simulate(2.0)
    >>> run.checks["energy_balance"].passed
    True
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
def connect(a: Any, b: Any, *more: Any) -> Connection | list[Any]:
    """Join two ports of the same connector class, or two equally long arrays of ports.

    Yield it among the equations. Potentials of joined ports become equal, and their flows sum to zero; a port that is
    joined to nothing has zero flows. Raises ModelError if the classes or lengths differ or if an argument is no port.

    >>> class Oscillator(gt.Model):
    ...     wall = gt.part(gt.mechanics.FixedFlange)
    ...     spring = gt.part(gt.mechanics.FlangeSpringDamper, k=800.0)
    ...     cart = gt.part(gt.mechanics.Mass, m=2.0)
    ...     def equations(self):
    ...         yield gt.connect(self.wall.flange, self.spring.a)
    ...         yield gt.connect(self.spring.b, self.cart.flange)
    >>> f = Oscillator().causal(targets="der(cart.flange.s,2)", prefer="cart.flange.s")
    >>> f(0.01, 0.0)  # -k s / m at s = 0.01 m, at rest
    (-4.0, <Status.OK: 0>)
    """
    if more:
        count = len(more) + 2
        raise CallError(
            f"connect() joins two ports; found {count}: yield {count - 1} connections, of the first with each other",
            here(),
        )
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
    """Name one of several solutions by geometry: they differ in the sign of a scalar expression.

    Yield it among the equations. The solution on the positive side is the default one; ask for the other with
    `model.causal(..., branches={"arm[0].ahead": -1})`, where `arm[0]` is the part that yields it. An answer on the
    other side than asked for has the status WRONG_BRANCH. Raises ModelError for an expression that is no scalar.

    >>> class Rod(gt.Model):
    ...     x = gt.variable(unit="m", start=0.6)
    ...     y = gt.variable(unit="m", start=0.8)
    ...     L = gt.parameter(1.0, unit="m", positive=True)
    ...     def equations(self):
    ...         yield self.x**2 + self.y**2 == self.L**2
    ...         yield gt.branch("above", self.y)
    >>> Rod().causal(known="x", targets="y")(0.6)
    (0.8, <Status.OK: 0>)
    >>> Rod().causal(known="x", targets="y", branches={"above": -1})(0.6)
    (-0.8, <Status.OK: 0>)
    """
    if not isinstance(expression, Expr) or expression.shape != ():
        raise ModelError(f"branch '{name}' takes a scalar expression", here())
    return Branch(name, expression, here())


def between(low: Any, x: Any, high: Any) -> list[Relation]:
    """The two relations low <= x <= high, elementwise; Python itself cannot chain them for expressions.

    Yield it among the constraints of an `Optimization`. A number counts in the unit of x.

    >>> m = gt.Builder()
    >>> lower, upper = gt.between(-1.0, m.variable("x", unit="m"), 1.0)
    >>> lower.op, upper.op
    ('>=', '<=')
    """
    return [x >= low, x <= high]


def flatten_items(item: Any) -> Iterator[Any]:
    """Items yielded by equations(): lists are opened, everything else passes."""
    if isinstance(item, (list, tuple)):
        for x in item:
            yield from flatten_items(x)
    else:
        yield item
