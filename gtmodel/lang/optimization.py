"""Optimization: a model with an objective, constraints and a horizon, read like Optimica."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import casadi as ca

from .declare import Free
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
