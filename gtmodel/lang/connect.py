"""Items yielded by equations(): connections of ports, branches, energies and edges of orientation trees."""

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
    """Two connected connectors and the line that connects them. Created by `gt.connect`."""

    a: Connector
    b: Connector
    where: SourceLocation


@dataclass(frozen=True, eq=False)
class Branch:
    """A named branch of solutions, identified by the sign of `expression`. Created by `gt.branch`."""

    name: str
    expression: Expr
    where: SourceLocation


@dataclass(frozen=True, eq=False)
class Energy:
    """A term of the energy balance: "stored" [J], "supplied" [W] or "dissipated" [W]. Created by `gt.energy`."""

    kind: str
    expression: Expr
    where: SourceLocation


@dataclass(frozen=True, eq=False)
class TreeEdge:
    """The orientation of port b follows from port a; if a is None, the component fixes it and b is a root.

    Created by `gt.tree_edge` and `gt.tree_root`.
    """

    a: Connector | None
    b: Connector
    where: SourceLocation


def tree_edge(a: Any, b: Any) -> TreeEdge:
    """Declare that this component's equations determine the orientation of port b from that of port a.

    Yield it in the equations of a component whose ports are `overdetermined` connectors, such as gt.mechanics.Frame,
    whose rotation matrix has nine entries for three degrees of freedom. Connections and edges must form trees, each
    with at most one root (see `tree_root`). A loop would determine the same orientation twice; the error names its
    connections. Raises ModelError for a port whose connector is not overdetermined.

    >>> class Flipped(gt.Model):  # frame b is frame a turned by 180 degrees about z
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
    """Declare that this component determines the orientation of a port by itself, as the world or a free body does.

    Yield it in the component's equations; see `tree_edge`. Raises ModelError for a port whose connector is not
    overdetermined.

    >>> class Table(gt.Model):  # 0.8 m above the world's origin
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
            raise ModelError(f"{name}() takes ports of an overdetermined connector; found {type(p).__name__}", here())
    return ports


def energy(*, stored: Any = None, supplied: Any = None, dissipated: Any = None) -> list[Energy]:
    """Declare a component's contribution to the energy balance of a simulation; yield it in `equations()`.

    Args:
        stored: stored energy [J], kinetic or potential.
        supplied: power supplied from outside [W].
        dissipated: dissipated power [W], not negative.

    All are optional scalars. `simulate` checks that the total stored energy changes at the rate of the supplied minus
    the dissipated power; a wrong sign in an equation makes this check fail. Raises ModelError for another shape or
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
            raise ModelError(
                f"energy({kind}=...) takes an expression in {units[kind]}; found {value.dimension}", here()
            )
        result.append(Energy(kind, value, here()))
    return result


@named
def connect(a: Any, b: Any, *more: Any) -> Connection | list[Any]:
    """Connect two ports of the same connector class, or two arrays of ports of equal length.

    Yield it in `equations()`. The potentials of connected ports are equal and their flows sum to zero; the flows of an
    unconnected port are zero. Raises ModelError if the classes or lengths differ or if an argument is not a port.

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
            f"connect() takes two ports; found {count}: yield {count - 1} connections, from the first port to each of "
            "the others",
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
            f"'{a._path}' is a {type(a).__name__} and '{b._path}' is a {type(b).__name__}: "
            "only ports of the same connector class can be connected",
            here(),
        )
    if a is b:
        raise ModelError(f"port '{a._path}' is connected to itself", here())
    inner = [connect(getattr(a, n), getattr(b, n)) for n, item in type(a)._declared.items() if isinstance(item, Port)]
    return [Connection(a, b, here()), *inner] if inner else Connection(a, b, here())


def branch(name: str, expression: Any) -> Branch:
    """Name one of several solutions by the sign of a scalar expression.

    Yield it in `equations()`. The default is the solution with the positive sign; select the other one with
    `model.causal(..., branches={"arm[0].ahead": -1})`, if the part `arm[0]` yields it. A solution with the wrong sign
    has the status WRONG_BRANCH. Raises ModelError for an expression that is not scalar.

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
    """Return the two relations low <= x <= high, elementwise; Python cannot chain comparisons of expressions.

    Yield it in the constraints of an `Optimization`. A number takes the unit of x.

    >>> m = gt.Builder()
    >>> lower, upper = gt.between(-1.0, m.variable("x", unit="m"), 1.0)
    >>> lower.op, upper.op
    ('>=', '<=')
    """
    return [x >= low, x <= high]


def flatten_items(item: Any) -> Iterator[Any]:
    """Yield the items of nested lists one by one."""
    if isinstance(item, (list, tuple)):
        for x in item:
            yield from flatten_items(x)
    else:
        yield item
