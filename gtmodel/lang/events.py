"""What happens at an instant: conditions, when, reinit, pre, equations that depend on conditions, and blocks that
compute at sample instants."""

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
    """The condition that becomes true at the instants offset, offset + period, ... [s], for `gt.when`.

    Both are numbers or parameters in s. Instants are counted exactly: two samples whose periods have a common multiple
    meet there. Raises ModelError for a period that is not positive. For controllers, see `gt.SampledBlock`.

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
    for x, what in ((every, "a period"), (start, "an offset")):
        if isinstance(x, Expr):
            if x.shape != () or x.scope.symbols_in(x.sx):
                raise ModelError(f"{what} of sample() is a number or a parameter; found {x.sx}", here())
        elif isinstance(x, bool) or not isinstance(x, (int, float)):
            raise ModelError(f"{what} of sample() is a number of seconds; found {x!r}", here())
    if not isinstance(every, Expr) and not every > 0:
        raise ModelError(f"a period of sample() is positive; found {every:g} s", here())
    places = [x.sx if isinstance(x, Expr) else ca.SX(float(x)) for x in (every, start)]
    return Condition("sample", (), None, here(), *places)


@named
def initial() -> Condition:
    """The condition that is true at the start of a simulation and never again, for `gt.when`.

    For what is to be decided there, as the direction in which a friction begins to slide; joined by `&` with what
    decides it. Where nothing changes by it the simulation has no event.

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
    """A variable that starts anew at an event, from a value, by an impulse of `force`. Made by `gt.reinit`."""

    variable: ca.SX
    value: ca.SX
    force: ca.SX | None
    where: SourceLocation


@dataclass(frozen=True, eq=False)
class EnergyLoss:
    """The energy [J] that an event takes out of what is stored. Made by `gt.energy_loss`."""

    expression: ca.SX
    where: SourceLocation


@dataclass(frozen=True, eq=False)
class Termination:
    """A simulation ends at an event, with a sentence. Made by `gt.terminate`."""

    sentence: str
    failed: bool
    where: SourceLocation


@dataclass(frozen=True, eq=False)
class When:
    """Actions at the instants at which a condition becomes true; `before`: what has precedence. Made by `gt.when`."""

    condition: Condition
    actions: tuple[Relation | Reinit | EnergyLoss | Termination, ...]
    where: SourceLocation
    before: When | None = None

    def elsewhen(self, condition: Any, *actions: Any) -> When:
        """Other actions at the instants at which another condition becomes true, unless one before it does so too.

        Of conditions that become true at one instant only the first one acts; the others have had their moment. Each
        branch is an event of its own, counted in its place. Arguments and errors as of `gt.when`.

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
        """This one and those that have precedence, the first one first."""
        return [*(self.before.branches() if self.before is not None else ()), self]


@named
def when(condition: Any, *actions: Any) -> When:
    """At each instant at which a condition becomes true, do all of the actions; yield it among the equations.

    Args:
        condition: a relation, several joined by `&`, `|` and `~`, or `gt.sample(period)`.
        actions: `n == expression` gives a discrete variable a new value; `gt.reinit(v, expression)` lets a continuous
            one start anew; `gt.energy_loss(expression)` says how much energy goes at this instant; `gt.terminate(...)`
            ends the simulation.

    Nothing happens while the condition stays true, nor at the start where it is true already. On the right of an action
    continuous variables have the values that they reached, `gt.pre(n)` is the value of a discrete variable before the
    event, and `n` alone the one after it. What follows from the actions happens at the same instant, until nothing
    changes any more. `gt.simulate` finds the instant to round-off. `.elsewhen(...)` behind it adds branches that act
    where no earlier one does. Raises ModelError for what is no action.

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
        raise ModelError("an event without an action has no effect; give when() what is to happen", here())
    given: list[Any] = []
    for action in actions:
        given.extend(action if isinstance(action, (list, tuple)) else [action])
    for action in given:
        if not isinstance(action, (Relation, Reinit, EnergyLoss, Termination)):
            shown = type(action).__name__
            raise ModelError(
                f"an action of when() is n == expression of a discrete variable, gt.reinit, gt.energy_loss or "
                f"gt.terminate; found {shown}",
                here(),
            )
        if isinstance(action, Relation) and action.op != "==":
            raise ModelError(f"'{action.op}' is no action of when(); expected '=='", action.where)
    if dropped() is not None:
        raise ModelError("nothing takes what this when() says; write yield in front of it", here())
    return When(condition_of(condition), tuple(given), here(), before)


@named
def reinit(x: Any, value: Any, *, impulse: Any = None) -> Reinit:
    """An action of `gt.when`: a continuous variable, or its derivative, starts anew from a value.

    Args:
        x: a variable that the simulation integrates, `self.v` or `gt.der(self.s)`, scalar or vector.
        value: an expression of what was there just before the event.
        impulse: a force of the model, as many entries as x, that is zero between impacts by an equation of its own,
            `self.contact == 0`. An impulse of it then gives x its value, and all other velocities follow from the
            model's masses and constraints. Left out, other states keep their values.

    Raises ModelError for what is no variable, and for another shape or unit.

    >>> class Pushed(gt.Model):  # two carts, joined by a spring, of which the first one hits a wall
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
    for given, what in ((x, "reinit()"), (impulse, "the impulse of reinit()")):
        if given is None and given is impulse:
            continue
        if not isinstance(given, Expr) or any(given.scope.owner(s) is None for s in _entries(given.sx)):
            shown = given.sx if isinstance(given, Expr) else repr(given)
            raise ModelError(f"{what} takes a variable of the model, or its derivative; found {shown}", here())
    if impulse is not None and impulse.shape != x.shape:
        raise ModelError(f"reinit() of shape {x.shape} takes an impulse of that shape; found {impulse.shape}", here())
    same = relation(x, value, "==")
    force = None if impulse is None else row_by_row(impulse.sx)
    return Reinit(row_by_row(same.lhs), row_by_row(same.rhs), force, here())


@named
def energy_loss(energy: Any) -> EnergyLoss:
    """An action of `gt.when`: the energy [J] that leaves the model's stored energy at this instant, as an impact's.

    energy: a scalar expression of what was there just before the event, not negative. `simulate` compares it with the
    change of the stored energies that the model declares by `gt.energy`. Raises ModelError for another shape or unit.

    >>> m = gt.Builder()
    >>> v = m.variable("v", unit="m/s")
    >>> mass = m.parameter("mass", 2.0, unit="kg")
    >>> gt.energy_loss((1 - 0.8**2) * mass / 2 * v**2).expression.shape
    (1, 1)
    """
    if not isinstance(energy, Expr) or energy.shape != ():
        raise ModelError("energy_loss() takes a scalar expression", here())
    if energy.dimension is not None and energy.dimension != si_unit("J").dimension:
        raise ModelError(f"energy_loss() is in J; found {energy.dimension}", here())
    return EnergyLoss(energy.sx, here())


@named
def terminate(sentence: str, *, failed: bool = False) -> Termination:
    """An action of `gt.when`: the simulation ends at this instant, once all that happens there has happened.

    Args:
        sentence: why, which becomes the result's message.
        failed: the motion has left what the model is good for: the run has the status `failed`, and a simulation that
            is to raise raises. Else it has reached its end early, which is no failure.

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
        raise ModelError(f"terminate() takes a sentence that says why; found {sentence!r}", here())
    return Termination(sentence, failed, here())


@named
def pre(x: Any) -> Expr:
    """The value of an expression just before the event, in an action of `gt.when`.

    It is for discrete variables: `n == gt.pre(n) + 1`. Continuous variables have the values before the event there
    anyhow. Raises ModelError for what is no expression.

    >>> m = gt.Builder()
    >>> gt.pre(m.variable("x", unit="m"))
    Expr(pre(x), shape=(), unit=m)
    """
    if not isinstance(x, Expr):
        raise ModelError(f"pre() takes an expression of the model; found {x!r}", here())
    return Expr(x.scope.before(x.sx), x.shape, x.dimension, x.scope)


@named
def If(condition: Any, then: Any, otherwise: Any) -> Any:  # as Modelica's, and `if` is taken
    """One of two expressions, or one of two equations, by a condition; `simulate` switches at the exact instant.

    Args:
        condition: a relation, or several joined by `&`, `|` and `~`.
        then, otherwise: expressions of one shape and unit, or two equations `a == b`, which may speak of different
            things: an ideal diode is `gt.If(conducts, self.v == 0, self.i == 0)`.

    Between two switches only one side is there: the other one may be undefined. Raises ModelError for shapes or units
    that do not fit. In an optimisation use `gt.maximum`, `gt.clip` or a smooth function in its place.

    >>> class Charger(gt.Model):  # 2 A until 4.2 V are reached, then nothing
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
    chosen = condition_of(condition)
    if instant := next((c.operation for c in chosen.walk() if c.operation in ("sample", "initial")), None):
        raise ModelError(f"{instant}() is true at single instants only: it belongs into gt.when", here())
    equations = [isinstance(x, Relation) for x in (then, otherwise)]
    if any(equations):
        if not all(equations) or then.op != "==" or otherwise.op != "==":
            raise ModelError("If() takes two expressions or two equations a == b", here())
        a, b = then.residual, otherwise.residual
        if a.shape != b.shape:
            raise ModelError(f"the equations of If() have {a.numel()} and {b.numel()} rows", here())
        m = then.scope.mode(chosen)
        return Relation(m * a + (1 - m) * b, ca.SX.zeros(*a.shape), "==", None, here(), then.scope)
    then, otherwise = gathered(then), gathered(otherwise)
    scope = scope_of(then, otherwise) or _scope_of(chosen)
    (a, shape), (b, other) = operand(then, scope), operand(otherwise, scope)
    if shape != other:
        raise ModelError(f"the sides of If() have shapes {shape} and {other}; expected equal ones", here())
    dimensions = {x.dimension for x in (then, otherwise) if isinstance(x, Expr) and x.dimension is not None}
    if len(dimensions) > 1:
        raise DimensionError(f"units do not fit in If(): {' and '.join(sorted(map(str, dimensions)))}", here())
    m = scope.mode(chosen)
    return Expr(m * a + (1 - m) * b, shape, dimensions.pop() if dimensions else None, scope)


def _scope_of(condition: Condition) -> Scope:
    """Of the expressions that it compares."""
    return next(c.relation.scope for c in condition.walk() if c.relation is not None)


def _entries(sx: ca.SX) -> list[ca.SX]:
    return ca.vertsplit(ca.vec(sx)) if sx.numel() else []


class SampledBlock(Model):
    """A controller or filter that reads its inputs every `period` and computes outputs, which are held until the next.

    A subclass declares inputs (`gt.input`), outputs (`gt.output`), what it remembers (`gt.discrete`) and parameters,
    and writes `step(self, inputs, state)` on numbers: it returns a dictionary of new outputs and new values of what it
    remembers; what it does not name keeps its value. In `step`, `self.kp` is the number of a parameter, `inputs.x` a
    float or an array, `state.integral` what was remembered.

    The block is a part like any other, `gt.part(PI, period=0.004, kp=30.0)`: the enclosing model's equations say what
    its inputs are and use its outputs. Only `gt.simulate` runs it.

    period: time between two samples [s]. offset: of the first one [s]. delay: between a sample and the instant at which
    its outputs are there [s], any part of a period or several of them.

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

    period = parameter(unit="s", positive=True, description="time between two samples")
    delay = parameter(0.0, unit="s", min=0.0, description="between a sample and its outputs")
    offset = parameter(0.0, unit="s", min=0.0, description="time of the first sample")

    def step(self, inputs: Any, state: Any) -> dict[str, Any]:
        """New outputs and state from the inputs at a sample and the state before it; a subclass writes it.

        inputs, state: have the declared names as attributes, numbers or arrays of NumPy. Raises ModelError in a class
        that has none.
        """
        cls = type(self)
        own = [item.where for item in cls._declared.values() if item is not SampledBlock._declared.get(item.name)]
        raise ModelError(f"{cls.__name__} has no step(self, inputs, state); write one", own[0] if own else None)
