"""Items yielded by equations(): connections of ports, branches, energies, edges of orientation trees and loops."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

from .declarations import Port
from .expression import Expr, Relation
from .model import Connector, Model
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

    Created by `gt.tree_edge` and `gt.tree_root`. `closing` returns the equations that replace those of the component if
    it closes a loop; None for a component that cannot. `either` is one equation in two forms: the first if the
    orientation of b follows from a, the second if that of a follows from b.
    """

    a: Connector | None
    b: Connector
    where: SourceLocation
    closing: Callable[[], Iterable[Any]] | None = None
    either: tuple[Relation, Relation] | None = None


@dataclass(frozen=True, eq=False)
class JointConstraint:
    """One constraint of a joint that closes a loop, and the reaction that enforces it. Created by `gt.constraint`."""

    relation: Relation
    reaction: Expr
    direction: str
    ports: tuple[Connector, Connector]
    where: SourceLocation


@dataclass(frozen=True, eq=False)
class Loops:
    """How the loops of a model are closed. Created by `gt.loops`."""

    cut: tuple[Model, ...]
    drop: bool
    where: SourceLocation


def tree_edge(
    a: Any, b: Any, closing: Callable[[], Iterable[Any]] | None = None, either: tuple[Any, Any] | None = None
) -> TreeEdge:
    """Declare that this component's equations determine the orientation of port b from that of port a.

    Yield it in the equations of a component whose ports are `overdetermined` connectors, such as gt.mechanics.Frame,
    whose rotation matrix has nine entries for three degrees of freedom. Connections and edges must form trees, each
    with at most one root (see `tree_root`). A loop would determine the same orientation twice. So in each loop one
    component uses the equations that `closing` yields, with a `gt.constraint` for each direction that it holds; see
    `gt.loops`. If no component of a loop has them, the error names its connections. `either` is the equation of the
    orientations in two forms, solved for that of b and for that of a: the one that follows the tree is used. Raises
    ModelError for a port whose connector is not overdetermined.

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
    return TreeEdge(first, second, here(), closing, either)


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


def constraint(a: Any, b: Any, relation: Any, reaction: Any, direction: str) -> JointConstraint:
    """Declare one constraint between the ports a and b of a joint that closes a loop.

    Args:
        relation: the scalar equation of the constraint.
        reaction: the scalar force or torque that enforces it. It is zero instead if the constraint is redundant and is
            dropped, see `gt.loops`. Its gradient by the flows of b gives the direction in messages.
        direction: what the constraint fixes, for messages: "position along" or "rotation about".

    Raises ModelError for a relation that is not a scalar equation.

    >>> class Bead(gt.Model):  # at the height of frame a, without friction
    ...     a = gt.port(gt.mechanics.Frame)
    ...     b = gt.port(gt.mechanics.Frame)
    ...     def equations(self):
    ...         a, b = self.a, self.b
    ...         yield gt.constraint(a, b, b.r[2] == a.r[2], b.f[2], "position along")
    ...         yield b.f[:2] == np.zeros(2)
    ...         yield a.f + b.f == 0
    ...         yield a.t + gt.cross(b.r - a.r, b.f) == 0
    ...         yield b.t == 0
    """
    first, second = _overdetermined("constraint", a, b)
    if not isinstance(relation, Relation) or relation.op != "==" or relation.residual.numel() != 1:
        raise ModelError("constraint() takes a scalar equation 'a == b'", here())
    if not isinstance(reaction, Expr) or reaction.shape != ():
        raise ModelError("constraint() takes the reaction as a scalar expression", here())
    return JointConstraint(relation, reaction, direction, (first, second), here())


def loops(cut: Any = (), redundant: str = "error") -> Loops:
    """Declare how the loops of joints in a model are closed; yield it in `equations()`.

    In every loop of frames one joint is cut: it uses its constraints instead of carrying an orientation on. By default
    it is a passive joint far from the ground, the last declared of these. A planar or otherwise special loop has
    redundant constraints: they prevent no further motion, and their reactions are not determined.

    Args:
        cut: the joint, or a list of joints, to be cut.
        redundant: "error" reports redundant constraints. "drop" replaces each by the equation that its reaction is
            zero, at the joints that are cut; positions and motor forces do not depend on this choice, other reactions
            do. `model.mobility()` lists both.

    Raises ModelError for another value of `redundant`, and for something that is not a part.

    A four-bar of four revolute joints:

    >>> class FourBar(gt.Model):
    ...     ground = gt.part(gt.mechanics.Ground)
    ...     crank, elbow, rocker, tip = (gt.part(gt.mechanics.Revolute) for _ in range(4))
    ...     bar, arm = (gt.part(gt.mechanics.FixedTranslation, d=[d, 0.0, 0.0]) for d in (0.3, 0.6))
    ...     top, base = (gt.part(gt.mechanics.FixedTranslation, d=[d, 0.0, 0.0]) for d in (0.7, 0.8))
    ...     motor = gt.part(gt.mechanics.TorqueMotor)
    ...     def equations(self):
    ...         ground, crank, elbow, rocker, tip = self.ground, self.crank, self.elbow, self.rocker, self.tip
    ...         yield gt.connect([ground.frame, crank.b, self.bar.b], [crank.a, self.bar.a, elbow.a])
    ...         yield gt.connect(elbow.b, self.top.a)
    ...         yield gt.connect([ground.frame, self.base.b, rocker.b], [self.base.a, rocker.a, self.arm.a])
    ...         yield gt.connect([self.top.b, self.arm.b, self.motor.shaft], [tip.a, tip.b, crank.shaft])
    ...         yield gt.loops(cut=tip, redundant="drop")
    >>> follow = FourBar().causal(known="crank.shaft.phi", targets="rocker.shaft.phi")
    >>> angle, status = follow(0.8)
    >>> print(round(abs(angle), 6), status)
    1.581155 OK
    """
    joints = tuple(flatten_items(cut))
    for joint in joints:
        if not isinstance(joint, Model) or isinstance(joint, Connector):
            raise ModelError(f"loops(cut=...) takes parts of the model; found {type(joint).__name__}", here())
    if redundant not in ("error", "drop"):
        raise ModelError(f"loops(redundant=...) is 'error' or 'drop'; found {redundant!r}", here())
    return Loops(joints, redundant == "drop", here())


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


def place_of(component: Model) -> SourceLocation | None:
    """Return file and line where the user declares a component: of the innermost enclosing part not in gtmodel."""
    place = None
    while component is not None:
        where = component.__dict__.get("_where")
        if where is not None and not where.ours:
            return where
        place, component = place or where, component._parent
    return place


def flatten_items(item: Any) -> Iterator[Any]:
    """Yield the items of nested lists one by one."""
    if isinstance(item, (list, tuple)):
        for x in item:
            yield from flatten_items(x)
    else:
        yield item
