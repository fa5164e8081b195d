"""Optimization: a model with an objective, constraints and a horizon, read like Optimica."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import casadi as ca
import numpy as np

from .declare import Free, Variable
from .expression import Expr, operand
from .model import Model
from .scope import Instant
from .source import ModelError, here


class Optimization(Model):
    """A dynamic optimisation problem.

    Class attributes `start_time` and `final_time` are numbers [s] or `gt.free(guess=..., min=...)`.
    Inputs that no equation determines are the controls. `constraints()` yields `==`, `<=`, `>=` and
    `gt.between`; an expression with `.at(t)` is a point constraint, any other holds along the whole path.
    """

    start_time: Any = 0.0
    final_time: Any = 1.0

    def objective(self) -> Any:
        """The scalar to minimise: built from `x.at(t)`, `gt.integral(...)`, `self.final_time`, free constants."""
        raise ModelError(f"{type(self).__name__} has no objective; define objective(self)", self.__dict__.get("where"))

    def constraints(self) -> Iterable[Any]:
        """Yield relations."""
        return ()


def integral(integrand: Any) -> Expr:
    """Integral over the horizon (Lagrange cost); unit times s."""
    if not isinstance(integrand, Expr) or integrand.shape != ():
        raise ModelError("gt.integral takes a scalar expression", here())
    from .units import parse_unit

    scope = integrand.scope
    symbol = ca.SX.sym(f"integral{len(scope.instants)}")
    scope.instants.append(Instant(symbol, integrand.sx, None))
    dim = None if integrand.dimension is None else integrand.dimension * parse_unit("s").dimension
    return Expr(symbol, (), dim, scope)


def at(x: Expr, instant: Any) -> Expr:
    """Value of an expression at an instant: a number [s], `self.start_time` or `self.final_time`."""
    sx, shape = operand(instant, x.scope)
    if shape != ():
        raise ModelError(f"an instant is a scalar time; found shape {shape}", here())
    scope = x.scope
    rows, cols = x.sx.shape
    symbol = ca.SX.sym(f"at{len(scope.instants)}", rows, cols)
    scope.instants.append(Instant(symbol, x.sx, sx))
    return Expr(symbol, x.shape, x.dimension, scope)


def is_free(value: Any) -> bool:
    """True for a horizon end that the optimisation chooses."""
    return isinstance(value, Free)


class Delayed(Variable):
    """Record of an input that follows another one some time later."""

    def __init__(self, source: Variable, tau: float, history: Any) -> None:
        super().__init__(source.shape, source.unit, f"{source.name} delayed", "input", dict(source.attributes))
        self.source, self.tau, self.history = source, tau, history
        self.attributes |= {"min": None, "max": None}  # the input's own bounds hold it

    def before(self, time: float) -> float:
        """Value at a time [s] before the start of the horizon."""
        return float(self.history(time) if callable(self.history) else self.history)


def delayed(source: Any, tau: float, *, history: Any) -> Any:
    """The input `source` of the same class as it was `tau` seconds ago: `late = gt.delayed(u, 0.1, history=0.0)`.

    A constant delay of a scalar input on a given horizon, where every mesh edge is an edge `tau` earlier too.
    `history` is its value before the start: a number or a function of time [s]. Raises ModelError for another source.
    """
    if not isinstance(source, Variable) or source.role != "input" or source.shape != ():
        raise ModelError(f"gt.delayed takes a scalar gt.input of the same class; found {source!r}", here())
    if not np.isfinite(tau) or tau <= 0:
        raise ModelError(f"a delay is positive; found {tau!r} s", here())
    return Delayed(source, float(tau), history)
