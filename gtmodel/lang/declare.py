"""What stands in a class body: variable, input, parameter, part, parts, port, outer, potential, flow, free."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from .._lazy import hint
from .slips import floats, named, shortened
from .source import ModelError, SourceLocation, here
from .units import UnitError, si_unit

if TYPE_CHECKING:
    from .model import Model
else:
    Model = hint("gtmodel.lang.model", "Model")

Shape = tuple[int, ...]
Kind = Literal["rotation", "unit", "direction", "semidefinite"]


class Declaration:
    """One named line of a class body; remembers where it was written."""

    name: str = "?"

    def __init__(self, description: str = "") -> None:
        self.where = here()
        self.description = description

    def __repr__(self) -> str:
        return f"{type(self).__name__.lower()} '{self.name}'"

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    def __get__(self, instance: Any, owner: type | None = None) -> Any:
        return self if instance is None else instance._member(self)

    def __set__(self, instance: Any, value: Any) -> None:
        raise ModelError(
            f"models are immutable: '{self.name}' cannot be assigned; give it when the model is made, "
            f"or use model.with_({self.name}=...)",
            here(),
        )


class _Quantity(Declaration):
    def __init__(self, shape: int | Shape | None, unit: str | None, description: str) -> None:
        super().__init__(description)
        try:
            self.shape = as_shape(shape)
        except (TypeError, ValueError):
            meant = f"; write unit={shape!r}" if isinstance(shape, str) else ""
            raise ModelError(f"a shape is a whole number or several; found {shape!r}{meant}", self.where) from None
        self.unit = unit
        try:
            self.dimension = None if unit is None else si_unit(unit).dimension
        except UnitError as error:
            raise ModelError(str(error), self.where) from None


class Variable(_Quantity):
    """Record of a variable: unit, nominal, min, max, start, fixed, state preference, role."""

    def __init__(self, shape: Any, unit: str | None, description: str, role: str, attributes: dict[str, Any]) -> None:
        super().__init__(shape, unit, description)
        if -1 in self.shape:
            raise ModelError(f"a variable takes a shape of whole numbers; found {shape}", self.where)
        self.role = role
        self.attributes = attributes


class Parameter(_Quantity):
    """Record of a parameter: default value, unit, sign assumptions, bounds that its values are checked against."""

    def __init__(
        self,
        default: Any,
        shape: Any,
        unit: str | None,
        description: str,
        positive: bool,
        nonzero: bool,
        low: Any = None,
        high: Any = None,
        increasing: bool = False,
        kind: Kind | None = None,
    ) -> None:
        if shape is None and default is not None:
            shape = np.shape(default)
        super().__init__(shape, unit, description)
        self.default = default
        self.positive = positive
        self.nonzero = nonzero or positive
        self.low = low
        self.high = high
        self.increasing = increasing
        self.kind: Kind | None = kind
        if kind is not None:
            _check_kind(kind, self.shape, self.where)


class Free(_Quantity):
    """A constant that an optimisation chooses, e.g. a free final time."""

    def __init__(self, guess: Any, low: Any, high: Any, unit: str | None, description: str) -> None:
        try:
            size = floats(guess).shape
        except (TypeError, ValueError):
            raise ModelError(f"a guess takes numbers; found {guess!r}", here()) from None
        super().__init__(size, unit, description)
        self.guess = guess
        self.low = low
        self.high = high


class Discrete(_Quantity):
    """Record of a discrete variable: start value, unit, and whether it is an output of a sampled block."""

    low = high = None
    positive = nonzero = False

    def __init__(self, start: Any, shape: Any, unit: str | None, description: str, output: bool = False) -> None:
        try:
            self.start = floats(start)
        except (TypeError, ValueError):
            raise ModelError(f"the start of a discrete variable takes numbers; found {start!r}", here()) from None
        if not np.all(np.isfinite(self.start)):
            raise ModelError(f"the start of a discrete variable must be finite; found {start!r}", here())
        super().__init__(self.start.shape if shape is None else shape, unit, description)
        if self.start.shape not in ((), self.shape):
            raise ModelError(
                f"a discrete variable of shape {self.shape} takes a start of that shape; found {self.start.shape}",
                self.where,
            )
        self.output = output
        self.helper = False  # made by a translator for its own use, and recorded only where an output asks for it


class Part(Declaration):
    """A component, or an array of `count` of them, with modifiers for each."""

    def __init__(self, cls: type[Model], count: int | None, modifiers: dict[str, Any]) -> None:
        super().__init__()
        if not isinstance(cls, type):
            order = "; parts() takes the count first: gt.parts(3, Arm)" if isinstance(count, type) else ""
            raise ModelError(f"a part takes a Model class; found {cls!r}{order}", self.where)
        if not hasattr(cls, "_declared"):
            raise ModelError(f"a part takes a Model class; found the class {cls.__name__}", self.where)
        _check_count(count, self.where)
        self.cls = cls
        self.count = count
        self.modifiers = modifiers


class Port(Declaration):
    """A connector instance at the border of a component."""

    def __init__(self, cls: type[Model], count: int | None) -> None:
        super().__init__()
        if not hasattr(cls, "_signature") or not isinstance(cls, type):
            raise ModelError(f"a port takes a class of gt.Connector; found {shortened(cls)}", self.where)
        _check_count(count, self.where)
        self.cls = cls
        self.count = count


class Outer(Declaration):
    """A reference to the nearest enclosing component of a class, e.g. World (gravity)."""

    def __init__(self, cls: type[Model]) -> None:
        super().__init__()
        self.cls = cls


class Each:
    """Marks a modifier of an array part that goes to every element unchanged."""

    def __init__(self, value: Any) -> None:
        self.value = value


def as_shape(shape: int | Shape | None) -> Shape:
    if shape is None:
        return ()
    if isinstance(shape, (int, np.integer)):
        return (int(shape),)
    return tuple(-1 if n is None else int(n) for n in shape)


@named
def variable(
    shape: int | Shape | None = None,
    *,
    unit: str | None = None,
    nominal: Any = None,
    min: Any = None,
    max: Any = None,
    start: Any = None,
    fixed: bool = False,
    prefer: int = 0,
    description: str = "",
) -> Any:
    """An unknown of the model, a line of a class body: `x = gt.variable(unit="m", start=0.1)`.

    Args:
        shape: None for a scalar, n for a vector, (n, m) for a matrix.
        unit: SI unit, e.g. "N/m"; None switches the dimension check off for this variable.
        nominal: expected magnitude (> 0), used for scaling.
        min, max: bounds, used by optimisation.
        start: value at the start, or near home where an equation has several solutions; a guess unless `fixed`.
        fixed: the start value is an initial condition; it is 0 where none is given.
        prefer: preference as a state; higher is kept longer, negative is avoided.
        description: a few words, shown in errors and listings.

    Its equations decide what it becomes: a state, an unknown solved for, or what a causality is given as known. Raises
    ModelError for a unit that is none or a nominal that is not positive.

    >>> class Ball(gt.Model):
    ...     height = gt.variable(unit="m", start=2.0, fixed=True)
    ...     speed = gt.variable(unit="m/s", start=0.0, fixed=True, description="upwards")
    ...     g = gt.parameter(9.81, unit="m/s2")
    ...     def equations(self):
    ...         yield gt.der(self.height) == self.speed
    ...         yield gt.der(self.speed) == -self.g
    >>> fall = Ball().simulate(0.5)
    >>> float(fall.trajectory["height"][-1].round(3))  # 2 - 9.81 * 0.5**2 / 2
    0.774
    """
    return Variable(shape, unit, description, "variable", _attributes(nominal, min, max, start, fixed, prefer))


@named
def input(
    shape: int | Shape | None = None,
    *,
    unit: str | None = None,
    nominal: Any = None,
    min: Any = None,
    max: Any = None,
    start: Any = None,
    prefer: int = 0,
    description: str = "",
) -> Any:
    """A variable that the surroundings prescribe: known in simulation, chosen by an optimisation.

    Any causality may still ask for it as a target. Arguments and errors as for `variable`; an input has no `fixed`.

    >>> class Cart(gt.Model):
    ...     m = gt.parameter(5.0, unit="kg", positive=True)
    ...     x = gt.variable(unit="m", start=0.0, fixed=True)
    ...     v = gt.variable(unit="m/s", start=0.0, fixed=True)
    ...     force = gt.input(unit="N", min=-20.0, max=20.0)
    ...     def equations(self):
    ...         yield gt.der(self.x) == self.v
    ...         yield self.m * gt.der(self.v) == self.force
    >>> run = Cart().simulate(1.0, inputs={"force": lambda t: 10.0 * t})
    >>> float(run.trajectory["v"][-1].round(6))  # 10 t^2 / (2 m)
    1.0
    >>> Cart().causal(known="x", targets="force")(0.0, 0.0, 3.0)  # backwards: for x, der(x), der(x,2)
    (15.0, <Status.OK: 0>)
    """
    return Variable(shape, unit, description, "input", _attributes(nominal, min, max, start, False, prefer))


@named
def potential(
    shape: int | Shape | None = None, *, unit: str | None = None, prefer: int = 0, description: str = ""
) -> Any:
    """A connector variable that is equal at all connected ports: a position, a temperature, a voltage.

    It stands in the body of a `Connector`. Arguments as for `variable`.

    >>> class Pin(gt.Connector):
    ...     v = gt.potential(unit="V")
    ...     i = gt.flow(unit="A")
    >>> Pin.v.role
    'potential'
    """
    return Variable(shape, unit, description, "potential", _attributes(None, None, None, None, False, prefer))


@named
def flow(shape: int | Shape | None = None, *, unit: str | None = None, description: str = "") -> Any:
    """A connector variable that sums to zero over connected ports, positive into the component: force, current.

    It stands in the body of a `Connector`. Arguments as for `variable`. A port that nothing is connected to has flow 0.

    >>> class Pin(gt.Connector):
    ...     v = gt.potential(unit="V")
    ...     i = gt.flow(unit="A")
    >>> class Source(gt.Model):
    ...     pin = gt.port(Pin)
    ...     def equations(self):
    ...         yield self.pin.v == 24.0
    >>> class Load(gt.Model):
    ...     R = gt.parameter(8.0, unit="V/A")
    ...     pin = gt.port(Pin)
    ...     def equations(self):
    ...         yield self.pin.v == self.R * self.pin.i
    >>> class Circuit(gt.Model):
    ...     source = gt.part(Source)
    ...     lamp = gt.part(Load)
    ...     heater = gt.part(Load, R=4.0)
    ...     def equations(self):
    ...         yield gt.connect(self.source.pin, self.lamp.pin)
    ...         yield gt.connect(self.source.pin, self.heater.pin)
    >>> Circuit().causal(targets="source.pin.i")()  # -(24/8 + 24/4): out of the source
    (-9.0, <Status.OK: 0>)
    """
    return Variable(shape, unit, description, "flow", _attributes(None, None, None, None, False, 0))


@named
def parameter(
    default: Any = None,
    *,
    unit: str | None = None,
    shape: int | tuple[int | None, ...] | None = None,
    positive: bool = False,
    nonzero: bool = False,
    increasing: bool = False,
    min: Any = None,
    max: Any = None,
    kind: Kind | None = None,
    description: str = "",
) -> Any:
    """A constant of the model, whose values are checked when they are given.

    Args:
        default: value if none is given; None: whoever makes the model has to give one.
        unit: SI unit; None switches the dimension check off for it.
        shape: None for the default's; a None inside leaves that length to the value, e.g. (None, 3) for points.
        positive, nonzero: what its values are; it lets the compiler divide by it.
        increasing: each entry of a vector is greater than the one before it.
        min, max: the values it may take, as a number, in its shape, or another parameter of the class.
        kind: what it describes. "rotation" (3, 3); "unit", each row of length 1 (axes, quaternions); "direction", each
            row of any length but zero; "semidefinite" (n, n), symmetric and positive semidefinite.
        description: a few words, shown in errors and listings.

    Raises ModelError, with file and line, for a value of another shape or outside what is declared.

    >>> class Rod(gt.Model):
    ...     L = gt.parameter(1.0, unit="m", positive=True, description="length")
    >>> Rod(L=2.0).L
    2.0
    >>> Rod(L=-2.0)
    Traceback (most recent call last):
        ...
    gtmodel.lang.source.ModelError: ...
    >>> Rod(length=2.0)
    Traceback (most recent call last):
        ...
    gtmodel.lang.source.ModelError: Rod has no declaration 'length'; it has L (...)
    """
    return Parameter(default, shape, unit, description, positive, nonzero, min, max, increasing, kind)


@named
def discrete(
    start: Any = 0.0, *, shape: int | Shape | None = None, unit: str | None = None, description: str = ""
) -> Any:
    """A variable that keeps its value between events, a line of a class body: `mode = gt.discrete(0.0)`.

    Args:
        start: its value at the start of a simulation, a number or an array; `simulate(..., start={"mode": 1})` gives
            another one.
        shape: None for the start's.
        unit: SI unit; None switches the dimension check off for it.
        description: a few words, shown in errors and listings.

    It is a number for the equations, with the derivative 0. A `gt.when` gives it new values, or in a `gt.SampledBlock`,
    where it is part of the state, `step`. A switch is a discrete variable of 0 and 1. Raises ModelError for a start
    that is no finite number.

    >>> class Thermostat(gt.Model):
    ...     T = gt.variable(unit="K", start=290.0, fixed=True)
    ...     heats = gt.discrete(1.0)
    ...     def equations(self):
    ...         yield gt.der(self.T) == 0.1 * self.heats - 0.05
    ...         yield gt.when(self.T >= 293.0, self.heats == 0.0)
    ...         yield gt.when(self.T <= 291.0, self.heats == 1.0)
    >>> run = gt.simulate(Thermostat(), 150.0)
    >>> [round(e.time, 6) for e in run.events]
    [60.0, 100.0, 140.0]
    """
    return Discrete(start, shape, unit, description)


@named
def output(
    start: Any = 0.0, *, shape: int | Shape | None = None, unit: str | None = None, description: str = ""
) -> Any:
    """An output of a `gt.SampledBlock`, held between two samples; arguments and errors as for `discrete`.

    start: what it gives until the first step has one.

    >>> class Gain(gt.SampledBlock):
    ...     k = gt.parameter(2.0)
    ...     x = gt.input()
    ...     y = gt.output()
    ...     def step(self, inputs, state):
    ...         return {"y": self.k * inputs.x}
    >>> Gain(period=0.1).k
    2.0
    """
    return Discrete(start, shape, unit, description, output=True)


@named
def free(guess: Any, *, min: Any = None, max: Any = None, unit: str | None = None, description: str = "") -> Any:
    """A constant for the optimisation to choose, a line in the body of an `Optimization`.

    Args:
        guess: where the solver starts; its shape is that of the constant.
        min, max: bounds.
        unit: SI unit.

    The usual one is the time that a motion takes, `final_time = gt.free(guess=1.0, min=0.2, unit="s")`.

    >>> class Cable(gt.Optimization):  # the sum of costs 8 / a for losses and 2 a for copper
    ...     a = gt.free(1.0, min=0.1)
    ...     x = gt.variable(start=0.0, fixed=True)
    ...     def equations(self):
    ...         yield gt.der(self.x) == 8.0 / self.a
    ...     def objective(self):
    ...         return self.x.at(self.final_time) + 2.0 * self.a
    >>> round(gt.solve(Cable(), gt.Mesh(2, 1)).free["a"], 4)
    2.0
    """
    return Free(guess, min, max, unit, description)


def part(model: type[Model] | Model, **modifiers: Any) -> Any:
    """A component: a Model class, or a configured model such as `gt.robots.gantry_tau("l1_tape")`.

    Modifiers are values, parameters of the enclosing class (by name as declared there), dictionaries for nested parts,
    a Model class (redeclaration), or functions of the enclosing model. Raises ModelError for what is no model and for a
    modifier that it does not declare.

    >>> class Rod(gt.Model):
    ...     L = gt.parameter(1.0, unit="m")
    ...     mass = gt.variable(unit="kg")
    ...     density = gt.parameter(2.0, unit="kg/m")
    ...     def equations(self):
    ...         yield self.mass == self.density * self.L
    >>> class Frame(gt.Model):
    ...     height = gt.parameter(3.0, unit="m")
    ...     post = gt.part(Rod, L=height)
    ...     beam = gt.part(Rod(density=5.0), L=lambda frame: 2 * frame.height)
    >>> weigh = Frame(height=4.0).causal(targets=["post.mass", "beam.mass"])
    >>> weigh()
    (8.0, 40.0, <Status.OK: 0>)
    """
    if isinstance(model, type):
        return Part(model, None, modifiers)
    configured = getattr(model, "__dict__", {}).get("_modifiers")
    if configured is None:
        raise ModelError(f"a part takes a Model class or a configured model; found {model!r}", here())
    return Part(type(model), None, {**configured, **modifiers})


def parts(count: int, cls: type[Model], **modifiers: Any) -> Any:
    """An array of `count` components of one class; element i gets row i of each modifier, `gt.each(x)` gives x to all.

    A scalar of the enclosing model, such as a declared parameter, goes to all too.

    In equations they are a list, `self.arms[0]`; outside their names are "arms[0]", "arms[1]". Raises ModelError for
    what is no Model class, and for a modifier that has not one row for each.

    >>> class Rod(gt.Model):
    ...     L = gt.parameter(1.0, unit="m")
    ...     density = gt.parameter(1.0, unit="kg/m")
    ...     mass = gt.variable(unit="kg")
    ...     def equations(self):
    ...         yield self.mass == self.density * self.L
    >>> class Bundle(gt.Model):
    ...     rods = gt.parts(3, Rod, L=[1.0, 2.0, 3.0], density=gt.each(0.5))
    ...     mass = gt.variable(unit="kg")
    ...     def equations(self):
    ...         yield self.mass == sum(rod.mass for rod in self.rods)
    >>> Bundle().causal(targets=["rods[2].mass", "mass"])()
    (1.5, 3.0, <Status.OK: 0>)
    """
    return Part(cls, count, modifiers)


@named
def port(cls: type[Model]) -> Any:
    """A connector at the border of a component, to be joined to others by `connect` in the model that holds it.

    cls: a `Connector` class, such as gt.mechanics.Flange. In equations `self.name.s` is its potential or flow; a flow
    is positive into the component, so that a force is the one that acts on it.

    >>> class Brake(gt.Model):
    ...     d = gt.parameter(30.0, unit="N.s/m")
    ...     flange = gt.port(gt.mechanics.Flange)
    ...     def equations(self):  # the flange is pushed forwards: it moves the brake against its drag
    ...         yield self.flange.f == self.d * gt.der(self.flange.s)
    >>> class Pushed(gt.Model):
    ...     brake = gt.part(Brake)
    ...     motor = gt.part(gt.mechanics.ForceMotor)
    ...     def equations(self):
    ...         yield gt.connect(self.motor.flange, self.brake.flange)
    >>> speed = Pushed().causal(known="motor.force", targets="der(brake.flange.s)")
    >>> speed(60.0)
    (2.0, <Status.OK: 0>)
    """
    return Port(cls, None)


@named
def ports(count: int, cls: type[Model]) -> Any:
    """An array of `count` connectors at the border of a component; in equations they are a list.

    >>> class Plate(gt.Model):  # carries what hangs on its three corners
    ...     corners = gt.ports(3, gt.mechanics.PointFrame)
    ...     load = gt.variable(3, unit="N")
    ...     def equations(self):
    ...         yield self.load == sum(corner.f for corner in self.corners)
    ...         for corner, x in zip(self.corners, [0.0, 1.0, 2.0]):
    ...             yield corner.r == [x, 0.0, 0.0]
    >>> load, status = Plate().causal(targets="load")()
    >>> load.tolist()  # nothing is connected
    [0.0, 0.0, 0.0]
    """
    return Port(cls, count)


@named
def outer(cls: type[Model]) -> Any:
    """The nearest enclosing part of a class; a default one is made at the root if there is none.

    So a component deep inside reads what holds for the whole model, such as gravity, without being handed it.

    >>> class Stone(gt.Model):
    ...     m = gt.parameter(2.0, unit="kg")
    ...     world = gt.outer(gt.mechanics.World)
    ...     weight = gt.variable(3, unit="N")
    ...     def equations(self):
    ...         yield self.weight == self.m * self.world.g
    >>> class Moon(gt.Model):
    ...     world = gt.part(gt.mechanics.World, g=[0.0, 0.0, -1.62])
    ...     stone = gt.part(Stone)
    >>> float(Stone().causal(targets="weight")()[0][2])
    -19.62
    >>> float(Moon().causal(targets="stone.weight")()[0][2])
    -3.24
    """
    return Outer(cls)


def each(value: Any) -> Each:
    """Give the same modifier to every element of an array of parts; without it each gets a row of its own.

    >>> class Rod(gt.Model):
    ...     axis = gt.parameter([1.0, 0.0], unit="1")
    ...     x = gt.variable()
    ...     def equations(self):
    ...         yield self.x == self.axis[0]
    >>> class Pair(gt.Model):
    ...     rods = gt.parts(2, Rod, axis=gt.each([3.0, 4.0]))
    >>> Pair().causal(targets=["rods[0].x", "rods[1].x"])()
    (3.0, 3.0, <Status.OK: 0>)
    """
    return Each(value)


ATTRIBUTES = ("nominal", "min", "max", "start", "fixed", "prefer")


def _attributes(nominal: Any, low: Any, high: Any, start: Any, fixed: bool, prefer: int) -> dict[str, Any]:
    for name, value in zip(ATTRIBUTES, (nominal, low, high, start), strict=False):
        if isinstance(value, str):
            raise ModelError(f"{name} takes numbers; found {value!r}", here())
    if nominal is not None and np.any(np.asarray(nominal, float) <= 0):
        raise ModelError(f"a nominal is a magnitude and must be positive; found {nominal}", here())
    return dict(zip(ATTRIBUTES, (nominal, low, high, start, fixed, prefer), strict=True))


def _check_count(count: Any, where: SourceLocation) -> None:
    if count is not None and (not isinstance(count, (int, np.integer)) or isinstance(count, bool) or count < 0):
        raise ModelError(f"the count of parts or ports is a whole number and not negative; found {count!r}", where)


def _check_kind(kind: Kind, shape: Shape, where: SourceLocation) -> None:
    if kind not in get_args(Kind):
        raise ModelError(f"kinds of parameters are {', '.join(get_args(Kind))}; found '{kind}'", where)
    square = len(shape) == 2 and shape[0] == shape[1] != -1
    fits = {"unit": bool(shape), "direction": bool(shape), "semidefinite": square}.get(kind, shape == (3, 3))
    if not fits:
        expected = {"unit": "rows", "direction": "rows", "semidefinite": "(n, n)"}.get(kind, "(3, 3)")
        raise ModelError(f"a parameter of kind '{kind}' has shape {expected}; found {shape}", where)
