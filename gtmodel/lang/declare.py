"""Declarations in a class body: variable, input, parameter, part, parts, port, outer, potential, flow, free."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from .._lazy import hint
from .declarations import Discrete, Each, Free, Kind, Outer, Parameter, Part, Port, Shape, Variable
from .slips import named
from .source import ModelError, here

if TYPE_CHECKING:
    from .model import Model
else:
    Model = hint("gtmodel.lang.model", "Model")


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
    kind: Literal["rotation"] | None = None,
    description: str = "",
) -> Any:
    """Declare a variable of the model in the class body: `x = gt.variable(unit="m", start=0.1)`.

    Args:
        shape: None for a scalar, n for a vector, (n, m) for a matrix.
        unit: SI unit, e.g. "N/m"; None switches the dimension check off for this variable.
        nominal: expected magnitude (> 0), used for scaling.
        min, max: bounds, used by optimisation; -inf or inf for an entry of an array that has none.
        start: start value: a guess unless `fixed`. It also selects among several solutions of an equation.
        fixed: the start value is an initial condition; 0 if there is no start value.
        prefer: preference as a state: variables with higher values are preferred, negative values are avoided.
        kind: "rotation": a rotation matrix (3, 3). Where it is known, its nine numbers count as three degrees of
            freedom, and the status is OUT_OF_RANGE for a matrix that is not a rotation.
        description: a few words, shown in errors and listings.

    The causality decides whether the variable becomes a state, an unknown to solve for or a known quantity. Raises
    ModelError for an invalid unit or a nominal value that is not positive.

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
    return Variable(shape, unit, description, "variable", _attributes(nominal, min, max, start, fixed, prefer), kind)


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
    """Declare an input: a variable that simulation takes as known and optimisation chooses.

    It can still be a target of a causality. Arguments and errors as for `variable`; an input has no `fixed`.

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
    shape: int | Shape | None = None,
    *,
    unit: str | None = None,
    prefer: int = 0,
    kind: Literal["rotation"] | None = None,
    description: str = "",
) -> Any:
    """Declare a connector variable that is equal at all connected ports: a position, a temperature, a voltage.

    Use it in the body of a `Connector`. Arguments as for `variable`.

    >>> class Pin(gt.Connector):
    ...     v = gt.potential(unit="V")
    ...     i = gt.flow(unit="A")
    >>> Pin.v.role
    'potential'
    """
    attributes = _attributes(None, None, None, None, False, prefer)
    return Variable(shape, unit, description, "potential", attributes, kind)


@named
def flow(shape: int | Shape | None = None, *, unit: str | None = None, description: str = "") -> Any:
    """Declare a connector variable whose sum over connected ports is zero, such as a force or a current.

    A flow is positive into the component; the flow of an unconnected port is 0. Use it in the body of a `Connector`.
    Arguments as for `variable`.

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
    """Declare a constant of the model. Its values are checked when they are set.

    Args:
        default: default value; None: the value has to be passed when the model is created.
        unit: SI unit; None switches the dimension check off for this parameter.
        shape: None: the shape of the default. None as an entry leaves that length open, e.g. (None, 3) for points.
        positive, nonzero: sign of the values; the compiler may then divide by the parameter.
        increasing: the entries of a vector must be strictly increasing.
        min, max: bounds: a number, an array of the parameter's shape, or another parameter of the class.
        kind: "rotation": a rotation matrix (3, 3); "unit": each row has length 1 (axes, quaternions); "direction": no
            row is zero; "semidefinite": (n, n), symmetric and positive semidefinite.
        description: a few words, shown in errors and listings.

    Raises ModelError, with file and line, if a value has another shape or violates the declaration.

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
    """Declare a variable that is constant between events, in the class body: `mode = gt.discrete(0.0)`.

    Args:
        start: value at the start of a simulation, a number or an array; `simulate(..., start={"mode": 1})` overrides
            it.
        shape: None: the shape of the start value.
        unit: SI unit; None switches the dimension check off for this variable.
        description: a few words, shown in errors and listings.

    Its time derivative is 0. A `gt.when` assigns new values. In a `gt.SampledBlock` it is part of the state, and `step`
    assigns new values. Use the values 0 and 1 for a switch. Raises ModelError for a start value that is not finite.

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
    """Declare an output of a `gt.SampledBlock`, held between samples; arguments and errors as for `discrete`.

    start: value until the first step.

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
    """Declare a constant that the optimisation chooses, in the body of an `Optimization`.

    Args:
        guess: initial guess; it also sets the shape of the constant.
        min, max: bounds.
        unit: SI unit.

    Most often it is the duration of a motion, `final_time = gt.free(guess=1.0, min=0.2, unit="s")`.

    >>> class Cable(gt.Optimization):  # minimise the cost 8 / a for losses plus 2 a for copper
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
    """Declare a component: a Model class, or a configured model such as `gt.robots.gantry_tau("l1_tape")`.

    A modifier is a value, a parameter of the enclosing class, a dictionary for a nested part, a Model class
    (redeclaration), or a function of the enclosing model. Raises ModelError if the argument is not a model, or if it
    does not declare a modifier's name.

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
        raise ModelError(f"a part needs a Model class or a configured model; found {model!r}", here())
    return Part(type(model), None, {**configured, **modifiers})


def parts(count: int, cls: type[Model], **modifiers: Any) -> Any:
    """Declare an array of `count` components of one class.

    Element i gets row i of each modifier. Every element gets the value of `gt.each(x)` and of a scalar of the enclosing
    model, such as a declared parameter. In equations the array is a list, `self.arms[0]`; elsewhere the names are
    "arms[0]", "arms[1]". Raises ModelError if `cls` is not a Model class, or if a modifier does not have `count` rows.

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
    """Declare a port of a component; the enclosing model connects it to other ports with `connect`.

    cls: a `Connector` class, such as gt.mechanics.Flange. In equations `self.name.s` is its potential or flow. A flow
    is positive into the component: a force acts on the component.

    >>> class Brake(gt.Model):
    ...     d = gt.parameter(30.0, unit="N.s/m")
    ...     flange = gt.port(gt.mechanics.Flange)
    ...     def equations(self):  # a force on the flange moves the brake against its drag
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
    """Declare an array of `count` ports of a component; in equations it is a list.

    >>> class Plate(gt.Model):  # carries loads on its three corners
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
    """Declare a reference to the nearest enclosing part of a class; if there is none, a default part at the root.

    With it a nested component reads data of the whole model, such as gravity.

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
    """Give every element of an array of parts the same modifier value; otherwise element i gets row i.

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
            raise ModelError(f"{name} must be a number or an array of numbers; found {value!r}", here())
    if nominal is not None and np.any(np.asarray(nominal, float) <= 0):
        raise ModelError(f"nominal is a magnitude and must be positive; found {nominal}", here())
    return dict(zip(ATTRIBUTES, (nominal, low, high, start, fixed, prefer), strict=True))
