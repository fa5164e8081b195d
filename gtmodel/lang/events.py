"""Events: conditions, when, reinit, pre, equations that switch with a condition, and sampled blocks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from .condition import Condition, condition_of
from .declare import parameter
from .expression import DimensionError, Expr, Relation, gathered, operand, relation, row_by_row, scope_of
from .model import Model
from .scope import Scope
from .slips import named
from .source import ModelError, SourceLocation, dropped, here
from .units import si_unit


@named
def sample(period: Any, offset: Any = 0.0) -> Condition:
    """Return the condition that becomes true at the times offset, offset + period, ... [s], for `gt.when`.

    Both arguments are numbers or parameters in s. The sample times are exact: two samples coincide at the common
    multiples of their periods. Raises ModelError for a period that is not positive. For controllers, see
    `gt.SampledBlock`.

    >>> class Counter(gt.Model):
    ...     n = gt.discrete(0.0)
    ...     x = gt.variable(start=0.0, fixed=True)
    ...     def equations(self):
    ...         yield gt.der(self.x) == self.n
    ...         yield gt.when(gt.sample(0.25, offset=0.25), self.n == gt.pre(self.n) + 1.0)
    >>> run = gt.simulate(Counter(), 1.1)
    >>> float(run.trajectory["n"][-1])
    4.0
    """
    every, start = (gathered(x) for x in (period, offset))
    for x, name in ((every, "period"), (start, "offset")):
        if isinstance(x, Expr):
            if x.shape != () or x.scope.symbols_in(x.sx):
                raise ModelError(f"the {name} of sample() must be a number or a parameter; found {x.sx}", here())
        elif isinstance(x, bool) or not isinstance(x, (int, float)):
            raise ModelError(f"the {name} of sample() must be a number of seconds; found {x!r}", here())
    if not isinstance(every, Expr) and not every > 0:
        raise ModelError(f"the period of sample() must be positive; found {every:g} s", here())
    times = [x.sx if isinstance(x, Expr) else ca.SX(float(x)) for x in (every, start)]
    return Condition("sample", (), None, here(), *times)


@named
def initial() -> Condition:
    """Return the condition that is true only at the start of a simulation, for `gt.when`.

    Combine it with another condition by `&` to initialise a discrete variable, such as the direction in which friction
    starts to slide. If it changes nothing, the simulation records no event.

    >>> class Drawer(gt.Model):
    ...     x = gt.variable(start=0.0, fixed=True)
    ...     side = gt.discrete(0.0)
    ...     def equations(self):
    ...         yield gt.der(self.x) == 1.0
    ...         yield gt.when(gt.initial() & (self.x >= 1.0), self.side == 1.0)
    >>> [float(gt.simulate(Drawer(), 2.0, start={"x": x}).trajectory["side"][-1]) for x in (0.0, 1.5)]
    [0.0, 1.0]
    """
    return Condition("initial", (), None, here())


@dataclass(frozen=True, eq=False)
class Reinit:
    """A variable that an event resets to a value, optionally by an impulse of `force`. Created by `gt.reinit`."""

    variable: ca.SX
    value: ca.SX
    force: ca.SX | None
    where: SourceLocation


@dataclass(frozen=True, eq=False)
class EnergyLoss:
    """The stored energy [J] lost at an event. Created by `gt.energy_loss`."""

    expression: ca.SX
    where: SourceLocation


@dataclass(frozen=True, eq=False)
class Termination:
    """The end of a simulation at an event, with a message. Created by `gt.terminate`."""

    sentence: str
    failed: bool
    where: SourceLocation


@dataclass(frozen=True, eq=False)
class When:
    """Actions at the instants when a condition becomes true; `before`: the preceding branch. Created by `gt.when`."""

    condition: Condition
    actions: tuple[Relation | Reinit | EnergyLoss | Termination, ...]
    where: SourceLocation
    before: When | None = None

    def elsewhen(self, condition: Any, *actions: Any) -> When:
        """Add actions for the instants when another condition becomes true, unless a preceding condition does so too.

        If several conditions become true at the same instant, only the first branch acts; the others are skipped. Each
        branch is a separate event, numbered in order. Arguments and errors as in `gt.when`.

        >>> class Tank(gt.Model):
        ...     level = gt.variable(unit="m", start=0.5, fixed=True)
        ...     pump = gt.discrete(1.0, unit="m/s")
        ...     def equations(self):
        ...         yield gt.der(self.level) == self.pump - 0.2
        ...         yield gt.when(self.level >= 1.0, self.pump == 0.0).elsewhen(self.level <= 0.2, self.pump == 1.0)
        >>> [round(e.time, 9) for e in gt.simulate(Tank(), 6.0).events]  # 0.5 / 0.8, then 0.8 / 0.2 and 0.8 / 0.8 later
        [0.625, 4.625, 5.625]
        """
        return _when(condition, actions, self)

    def branches(self) -> list[When]:
        """Return the preceding branches and this one, in order."""
        return [*(self.before.branches() if self.before is not None else ()), self]


@named
def when(condition: Any, *actions: Any) -> When:
    """Execute actions at each instant when a condition becomes true; yield it in `equations()`.

    Args:
        condition: a relation, several combined with `&`, `|` and `~`, or `gt.sample(period)`.
        actions: `n == expression` assigns a new value to a discrete variable; `gt.reinit(v, expression)` resets a
            continuous variable; `gt.energy_loss(expression)` declares the energy lost at this instant;
            `gt.terminate(...)` ends the simulation.

    Nothing happens while the condition stays true, or if it is already true at the start. On the right-hand side of an
    action, continuous variables have their values just before the event; `gt.pre(n)` is the value of a discrete
    variable before the event and `n` its value after it. Events triggered by the actions occur at the same instant,
    until nothing changes any more. `gt.simulate` locates the instant to round-off. `.elsewhen(...)` adds branches that
    act if no earlier branch does. Raises ModelError if an argument is not an action.

    >>> class Ball(gt.Model):
    ...     h = gt.variable(unit="m", start=1.0, fixed=True)
    ...     v = gt.variable(unit="m/s", start=0.0, fixed=True)
    ...     bounces = gt.discrete(0.0)
    ...     def equations(self):
    ...         yield gt.der(self.h) == self.v
    ...         yield gt.der(self.v) == -9.81
    ...         yield gt.when(
    ...             self.h <= 0.0,
    ...             gt.reinit(self.v, -0.8 * self.v),
    ...             self.bounces == gt.pre(self.bounces) + 1.0,
    ...         )
    >>> run = gt.simulate(Ball(), 1.5)
    >>> [round(e.time, 6) for e in run.events]  # sqrt(2 h / g), and 2 * 0.8 times that later
    [0.451524, 1.173961]
    """
    return _when(condition, actions, None)


def _when(condition: Any, actions: tuple[Any, ...], before: When | None) -> When:
    if not actions:
        raise ModelError("an event without an action has no effect; pass when() at least one action", here())
    flat: list[Any] = []
    for action in actions:
        flat.extend(action if isinstance(action, (list, tuple)) else [action])
    for action in flat:
        if not isinstance(action, (Relation, Reinit, EnergyLoss, Termination)):
            raise ModelError(
                "an action of when() must be n == expression for a discrete variable n, gt.reinit, gt.energy_loss or "
                f"gt.terminate; found {type(action).__name__}",
                here(),
            )
        if isinstance(action, Relation) and action.op != "==":
            raise ModelError(f"a relation with '{action.op}' is not an action of when(); expected '=='", action.where)
    if dropped() is not None:
        raise ModelError("the result of this when() is discarded; write yield in front of it", here())
    return When(condition_of(condition), tuple(flat), here(), before)


@named
def reinit(x: Any, value: Any, *, impulse: Any = None) -> Reinit:
    """An action of `gt.when`: reset a continuous variable, or its derivative, to a value.

    Args:
        x: a state of the simulation, `self.v` or `gt.der(self.s)`, scalar or vector.
        value: the new value, an expression of quantities just before the event.
        impulse: a force of the model with the shape of x. An equation of its own, `self.contact == 0`, must keep it
            zero between impacts. At the event an impulse of this force gives x its new value, and all other velocities
            follow from the model's masses and constraints. Without `impulse` the other states keep their values.

    Raises ModelError if x is not a variable, and for another shape or unit.

    >>> class Pushed(gt.Model):  # two carts with a spring between them; the first one hits a wall
    ...     x = gt.variable(2, unit="m", start=[1.0, 2.0], fixed=True)
    ...     v = gt.variable(2, unit="m/s", start=[-1.0, -1.0], fixed=True)
    ...     m = gt.parameter(2.0, unit="kg")
    ...     k = gt.parameter(50.0, unit="N/m")
    ...     wall = gt.variable(unit="N")
    ...     def equations(self):
    ...         spring = self.k * (self.x[1] - self.x[0] - 1.0)
    ...         yield gt.der(self.x) == self.v
    ...         yield self.m * gt.der(self.v[0]) == self.wall + spring
    ...         yield self.m * gt.der(self.v[1]) == -spring
    ...         yield self.wall == 0.0
    ...         yield gt.when(self.x[0] <= 0.0, gt.reinit(self.v[0], -0.5 * self.v[0], impulse=self.wall))
    >>> run = gt.simulate(Pushed(), 1.2)
    >>> round(run.events[0].impulses["wall"], 6)  # N.s: 2 kg (0.5 + 1) m/s
    3.0
    """
    for argument, name in ((x, "reinit()"), (impulse, "the impulse of reinit()")):
        if argument is None and argument is impulse:
            continue
        if not isinstance(argument, Expr) or any(argument.scope.owner(s) is None for s in _entries(argument.sx)):
            text = argument.sx if isinstance(argument, Expr) else repr(argument)
            raise ModelError(f"{name} must be a variable of the model or its derivative; found {text}", here())
    if impulse is not None and impulse.shape != x.shape:
        raise ModelError(f"the impulse of reinit() must have the shape {x.shape} of x; found {impulse.shape}", here())
    equation = relation(x, value, "==")
    force = None if impulse is None else row_by_row(impulse.sx)
    return Reinit(row_by_row(equation.lhs), row_by_row(equation.rhs), force, here())


@named
def energy_loss(energy: Any) -> EnergyLoss:
    """An action of `gt.when`: declare the stored energy [J] lost at this instant, for example in an impact.

    energy: a scalar expression of quantities just before the event, not negative. `simulate` compares it with the
    change of the stored energy declared with `gt.energy`. Raises ModelError for another shape or unit.

    >>> m = gt.Builder()
    >>> v = m.variable("v", unit="m/s")
    >>> mass = m.parameter("mass", 2.0, unit="kg")
    >>> gt.energy_loss((1 - 0.8**2) * mass / 2 * v**2).expression.shape
    (1, 1)
    """
    if not isinstance(energy, Expr) or energy.shape != ():
        raise ModelError("energy_loss() takes a scalar expression", here())
    if energy.dimension is not None and energy.dimension != si_unit("J").dimension:
        raise ModelError(f"energy_loss() takes an energy in J; found {energy.dimension}", here())
    return EnergyLoss(energy.sx, here())


@named
def terminate(sentence: str, *, failed: bool = False) -> Termination:
    """An action of `gt.when`: end the simulation at this instant, after all events of the instant.

    Args:
        sentence: the reason; it becomes the result's message.
        failed: True if the motion has left the validity range of the model: the run has the status `failed`, or raises
            unless `simulate` was called with `throw=False`. False if the simulation just ends early.

    Raises ModelError for an empty sentence.

    >>> class Stone(gt.Model):
    ...     h = gt.variable(unit="m", start=5.0, fixed=True)
    ...     v = gt.variable(unit="m/s", start=0.0, fixed=True)
    ...     def equations(self):
    ...         yield gt.der(self.h) == self.v
    ...         yield gt.der(self.v) == -10.0
    ...         yield gt.when(self.h <= 0.0, gt.terminate("it is on the ground"))
    >>> run = gt.simulate(Stone(), 3.0)
    >>> run.status.value, round(float(run.trajectory.time[-1]), 9)  # sqrt(2 h / g)
    ('solved', 1.0)
    """
    if not isinstance(sentence, str) or not sentence.strip():
        raise ModelError(f"terminate() needs a sentence with the reason; found {sentence!r}", here())
    return Termination(sentence, failed, here())


@named
def pre(x: Any) -> Expr:
    """Return the value of an expression just before the event, in an action of `gt.when`.

    Use it for discrete variables: `n == gt.pre(n) + 1`. In an action, continuous variables always have their values
    before the event. Raises ModelError if x is not an expression.

    >>> m = gt.Builder()
    >>> gt.pre(m.variable("x", unit="m"))
    Expr(pre(x), shape=(), unit=m)
    """
    if not isinstance(x, Expr):
        raise ModelError(f"pre() takes an expression of the model; found {x!r}", here())
    return Expr(x.scope.before(x.sx), x.shape, x.dimension, x.scope)


@named
def If(condition: Any, then: Any, otherwise: Any) -> Any:  # `if` is a keyword
    """Return one of two expressions or equations, depending on a condition; `simulate` locates the switch exactly.

    Args:
        condition: a relation, or several combined with `&`, `|` and `~`.
        then, otherwise: expressions of equal shape and unit, or two equations `a == b`, possibly of different
            variables: an ideal diode is `gt.If(conducts, self.v == 0, self.i == 0)`.

    Between two switches only the active side is evaluated; the other one may be undefined. Raises ModelError if the
    shapes or units differ. In an optimisation use `gt.maximum`, `gt.clip` or a smooth function instead.

    >>> class Charger(gt.Model):  # 2 A up to 4.2 V, then 0 A
    ...     v = gt.variable(unit="V", start=3.0, fixed=True)
    ...     current = gt.variable(unit="A")
    ...     C = gt.parameter(1.0, unit="A.s/V")
    ...     rating = gt.parameter(2.0, unit="A")
    ...     def equations(self):
    ...         yield self.C * gt.der(self.v) == self.current
    ...         yield self.current == gt.If(self.v >= 4.2, 0.0 * self.rating, self.rating)
    >>> run = gt.simulate(Charger(), 1.0)
    >>> [round(e.time, 6) for e in run.events], float(run.trajectory["v"][-1].round(6))
    ([0.6], 4.2)
    """
    switch = condition_of(condition)
    if instant := next((c.operation for c in switch.walk() if c.operation in ("sample", "initial")), None):
        raise ModelError(f"{instant}() is true only at single instants; use it in gt.when", here())
    equations = [isinstance(x, Relation) for x in (then, otherwise)]
    if any(equations):
        if not all(equations) or then.op != "==" or otherwise.op != "==":
            raise ModelError("If() takes two expressions or two equations a == b", here())
        a, b = then.residual, otherwise.residual
        if a.shape != b.shape:
            raise ModelError(
                f"the equations of If() have {a.numel()} and {b.numel()} rows; expected equal numbers", here()
            )
        m = then.scope.mode(switch)
        return Relation(m * a + (1 - m) * b, ca.SX.zeros(*a.shape), "==", None, here(), then.scope)
    then, otherwise = gathered(then), gathered(otherwise)
    scope = scope_of(then, otherwise) or _scope_of(switch)
    (a, shape), (b, shape_b) = operand(then, scope), operand(otherwise, scope)
    if shape != shape_b:
        raise ModelError(f"the sides of If() have shapes {shape} and {shape_b}; expected equal shapes", here())
    dimensions = {x.dimension for x in (then, otherwise) if isinstance(x, Expr) and x.dimension is not None}
    if len(dimensions) > 1:
        raise DimensionError(
            f"the sides of If() have different units: {' and '.join(sorted(map(str, dimensions)))}", here()
        )
    m = scope.mode(switch)
    return Expr(m * a + (1 - m) * b, shape, dimensions.pop() if dimensions else None, scope)


def _scope_of(condition: Condition) -> Scope:
    """Return the scope of the expressions in a condition."""
    return next(c.relation.scope for c in condition.walk() if c.relation is not None)


def _entries(sx: ca.SX) -> list[ca.SX]:
    return ca.vertsplit(ca.vec(sx)) if sx.numel() else []


class SampledBlock(Model):
    """A sampled controller or filter: every `period` it reads its inputs and computes outputs, with zero-order hold.

    A subclass declares inputs (`gt.input`), outputs (`gt.output`), states (`gt.discrete`) and parameters, and defines
    `step(self, inputs, state)` on numbers. `step` returns a dictionary of new outputs and new states; those that it
    does not name keep their values. In `step`, `self.kp` is the value of a parameter, `inputs.x` a float or an array,
    `state.integral` the value of a state.

    A block is a part like any other, `gt.part(PI, period=0.004, kp=30.0)`: the equations of the enclosing model
    determine its inputs and use its outputs. Only `gt.simulate` runs it.

    period: sampling period [s]. offset: time of the first sample [s]. delay: time from a sample to the update of the
    outputs [s], less or more than a period.

    >>> class PI(gt.SampledBlock):
    ...     kp = gt.parameter(4.0, unit="1/s")
    ...     ki = gt.parameter(2.0, unit="1/s2")
    ...     error = gt.input(unit="m")
    ...     integral = gt.discrete(0.0, unit="m.s")
    ...     speed = gt.output(unit="m/s")
    ...     def step(self, inputs, state):
    ...         integral = state.integral + self.period * inputs.error
    ...         return {"speed": self.kp * inputs.error + self.ki * integral, "integral": integral}
    >>> class Loop(gt.Model):
    ...     x = gt.variable(unit="m", start=0.0, fixed=True)
    ...     law = gt.part(PI, period=0.004, delay=0.008)
    ...     def equations(self):
    ...         yield gt.der(self.x) == self.law.speed
    ...         yield self.law.error == 0.1 - self.x
    >>> run = gt.simulate(Loop(), 5.0)
    >>> float(run.trajectory["x"][-1].round(3)), len(run.samples["law"])
    (0.101, 1251)
    """

    period = parameter(unit="s", positive=True, description="sampling period")
    delay = parameter(0.0, unit="s", min=0.0, description="time from a sample to the update of the outputs")
    offset = parameter(0.0, unit="s", min=0.0, description="time of the first sample")

    def step(self, inputs: Any, state: Any) -> dict[str, Any]:
        """Return the new outputs and states, from the inputs and the previous states; a subclass defines it.

        inputs, state: objects with the declared names as attributes, numbers or NumPy arrays. Raises ModelError if a
        class does not define `step`.
        """
        cls = type(self)
        lines = [item.where for item in cls._declared.values() if item is not SampledBlock._declared.get(item.name)]
        raise ModelError(f"{cls.__name__} has no step(self, inputs, state); define it", lines[0] if lines else None)
