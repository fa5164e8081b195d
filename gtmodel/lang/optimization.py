"""Optimization: a model with an objective, constraints and a horizon, as in Optimica."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from .declarations import Variable
from .expression import ONE, Expr
from .model import Model
from .scope import Instant, Misfit
from .source import ModelError, SourceLocation, here
from .units import SECOND


class Optimization(Model):
    """A dynamic optimisation problem: a Model with an objective, constraints and a horizon. `gt.solve` solves it.

    The class attributes `start_time` and `final_time` are numbers [s], by default 0 and 1, or
    `gt.free(guess=..., min=...)`. The controls are the inputs that no equation determines. `objective()` returns the
    scalar to minimise. `constraints()` yields `==`, `<=`, `>=` and `gt.between`: an expression with `.at(t)` is a point
    constraint, any other one a path constraint. The bounds `min` and `max` of variables are path constraints too.

    >>> class Fastest(gt.Optimization):  # a cart from x = 1 m to 0, from rest to rest
    ...     final_time = gt.free(1.0, min=0.1, unit="s")
    ...     x = gt.variable(unit="m", start=1.0, fixed=True)
    ...     v = gt.variable(unit="m/s", start=0.0, fixed=True)
    ...     a = gt.input(unit="m/s2", min=-1.0, max=1.0)
    ...     def equations(self):
    ...         yield gt.der(self.x) == self.v
    ...         yield gt.der(self.v) == self.a
    ...     def objective(self):
    ...         return self.final_time
    ...     def constraints(self):
    ...         yield self.x.at(self.final_time) == 0
    ...         yield self.v.at(self.final_time) == 0
    >>> solution = gt.solve(Fastest(), gt.Mesh(10, control="constant"))
    >>> round(solution.final_time, 4)  # 2 sqrt(x / a): full thrust, full brake
    2.0
    """

    start_time: Any = 0.0
    final_time: Any = 1.0
    _written: ClassVar[SourceLocation]  # first line of the class, in its Python file or Modelica text

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        if "_written" not in vars(cls):
            cls._written = here()
        # `final_time = T` gives a declared quantity a second name
        for name in ("start_time", "final_time"):
            item = cls._declared.get(name)
            alias = next((n for n, declared in cls._declared.items() if n != name and declared is item), None)
            if item is not None and alias is None and item.name != name and item.name in cls._declared:
                alias = item.name  # a subclass declares it anew
            if item is not None and alias is not None:
                item.name = alias
                del cls._declared[name]

    def objective(self) -> Any:
        """Return the scalar to minimise, an expression of `x.at(t)`, `gt.integral(...)`, `self.final_time` and free
        constants."""
        raise ModelError(f"{type(self).__name__} has no objective; define objective(self)", self.__dict__.get("where"))

    def constraints(self) -> Iterable[Any]:
        """Yield the constraints: relations with `.at(t)` are point constraints, all others path constraints."""
        return ()


def integral(integrand: Any) -> Expr:
    """Return the integral of a scalar over the horizon (Lagrange cost), for objectives and constraints.

    Its unit is the unit of the integrand times s. Raises ModelError if the argument is not a scalar expression.

    >>> class Regulator(gt.Optimization):
    ...     x = gt.variable(start=1.0, fixed=True)
    ...     u = gt.input()
    ...     def equations(self):
    ...         yield gt.der(self.x) == self.u
    ...     def objective(self):
    ...         return gt.integral(self.x**2 + self.u**2)
    >>> round(gt.solve(Regulator(), gt.Mesh(5)).objective, 4)  # tanh(1)
    0.7616
    """
    if not isinstance(integrand, Expr) or integrand.shape != ():
        raise ModelError("gt.integral takes a scalar expression", here())
    scope = integrand.scope
    symbol = ca.SX.sym(f"integral{len(scope.instants)}")
    scope.instants.append(Instant(symbol, integrand.sx, None))
    dim = None if integrand.dimension is None else integrand.dimension * SECOND
    return Expr(symbol, (), dim, scope)


class Delayed(Variable):
    """Declaration of a delayed copy of an input."""

    def __init__(self, source: Variable, tau: float, history: Any) -> None:
        super().__init__(source.shape, source.unit, f"{source.name} delayed", "input", dict(source.attributes))
        self.source, self.tau, self.history = source, tau, history
        self.attributes |= {"min": None, "max": None}  # the bounds of the source suffice

    def before(self, time: float) -> float:
        """Return the value at a time [s] before the start of the horizon."""
        value: Any = self.history(time) if callable(self.history) else self.history
        try:
            number = float(value)
        except (TypeError, ValueError):
            number = np.nan
        if not np.isfinite(number):
            raise ModelError(
                f"the history of '{self.name}' must be a finite number at {time:g} s; found {value!r}", self.where
            )
        return number


def delayed(source: Any, tau: float, *, history: Any) -> Any:
    """Declare an input `source` of the same class delayed by `tau` seconds: `late = gt.delayed(u, 0.1, history=0.0)`.

    Args:
        source: a scalar gt.input of the same class. A part may delay its own input.
        tau: constant delay [s], positive.
        history: the source before the start: a number or a function of time [s].

    It is for optimisation on a fixed horizon. The mesh must have an edge `tau` before and `tau` after each edge. Raises
    ModelError for another source or a delay that is not positive.

    >>> class Late(gt.Optimization):  # x' = u(t - 0.5); the control has no effect before 0.5 s
    ...     x = gt.variable(start=1.0, fixed=True)
    ...     u = gt.input()
    ...     late = gt.delayed(u, 0.5, history=0.0)
    ...     final_time = 2.0
    ...     def equations(self):
    ...         yield gt.der(self.x) == self.late
    ...     def objective(self):
    ...         return gt.integral(self.x**2 + self.u**2)
    >>> round(gt.solve(Late(), gt.Mesh(4)).objective, 3)  # 0.5 + tanh(1.5)
    1.405
    """
    if not isinstance(source, Variable) or source.role != "input" or source.shape != ():
        raise ModelError(f"gt.delayed takes a scalar gt.input of the same class; found {source!r}", here())
    if not np.isfinite(tau) or tau <= 0:
        raise ModelError(f"a delay must be positive; found {tau!r} s", here())
    return Delayed(source, float(tau), history)


def misfit(expression: Any, times: Any, measured: Any, *, sigma: Any = None) -> Expr:
    """Return the sum of squares of (expression - measured) / sigma over the measured instants: an estimation cost.

    Args:
        expression: scalar or vector (k,) expression of the model.
        times: instants (n,) [s] within the horizon.
        measured: values (n,) or (n, k), in the expression's SI unit.
        sigma: standard deviation of the noise, a number or (k,), in the same unit; None: one unknown standard deviation
            for all measured values, estimated from the residuals. See gt.estimate for the covariance.

    Raises ModelError for incompatible shapes and for numbers that are not finite.

    >>> class Decay(gt.Optimization):
    ...     rate = gt.free(1.0, min=0.0, unit="1/s")
    ...     x = gt.variable(start=1.0, fixed=True)
    ...     def equations(self):
    ...         yield gt.der(self.x) == -self.rate * self.x
    ...     def objective(self):
    ...         return gt.misfit(self.x, times=[0.5, 1.0], measured=[0.37, 0.13], sigma=0.01)
    >>> round(gt.solve(Decay(), gt.Mesh(4)).free["rate"], 2)  # exp(-2 t), with noise
    2.01
    """
    if not isinstance(expression, Expr) or len(expression.shape) > 1:
        raise ModelError(f"gt.misfit takes a scalar or a vector expression; found {expression!r}", here())
    instants = np.asarray(times, float)
    size = expression.shape[0] if expression.shape else 1
    values = np.asarray(measured, float)
    if instants.ndim != 1 or values.shape not in ((len(instants), *expression.shape), (len(instants), size)):
        raise ModelError(
            f"gt.misfit takes n instants and n rows of the expression's shape {expression.shape}; found "
            f"{instants.shape} and {values.shape}",
            here(),
        )
    if not (np.all(np.isfinite(instants)) and np.all(np.isfinite(values))) or not instants.size:
        raise ModelError("gt.misfit needs at least one measured value, and all must be finite", here())
    noise = np.ones(()) if sigma is None else np.asarray(sigma, float)
    if noise.shape not in ((), (size,)):
        raise ModelError(f"sigma must be one number, or one for each of {size} columns; found {noise.shape}", here())
    noise = np.broadcast_to(noise, (size,))
    if not np.all((noise > 0) & np.isfinite(noise)):
        raise ModelError(f"sigma is a standard deviation and must be positive and finite; found {sigma!r}", here())
    values = values.reshape(len(instants), size)
    residuals = [
        (expression.at(float(t)).sx - ca.DM(row)) / ca.DM(noise) for t, row in zip(instants, values, strict=True)
    ]
    everything = ca.vertcat(*residuals)
    expression.scope.misfits.append(Misfit(everything, sigma is not None))
    return Expr(ca.sumsqr(everything), (), ONE, expression.scope)
