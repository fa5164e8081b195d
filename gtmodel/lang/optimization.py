"""Optimization: a model with an objective, constraints and a horizon, read like Optimica."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import casadi as ca
import numpy as np

from .declare import Variable
from .expression import ONE, Expr
from .model import Model
from .scope import Instant, Misfit
from .source import ModelError, here
from .units import SECOND


class Optimization(Model):
    """A dynamic optimisation problem.

    Class attributes `start_time` and `final_time` are numbers [s] or `gt.free(guess=..., min=...)`.
    Inputs that no equation determines are the controls. `constraints()` yields `==`, `<=`, `>=` and
    `gt.between`; an expression with `.at(t)` is a point constraint, any other holds along the whole path.
    """

    start_time: Any = 0.0
    final_time: Any = 1.0

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        # `final_time = T` is the same quantity under a second name
        for name in ("start_time", "final_time"):
            item = cls._declared.get(name)
            twin = next((n for n, other in cls._declared.items() if n != name and other is item), None)
            if item is not None and twin is None and item.name != name and item.name in cls._declared:
                twin = item.name  # declared anew by a subclass
            if item is not None and twin is not None:
                item.name = twin
                del cls._declared[name]

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
    scope = integrand.scope
    symbol = ca.SX.sym(f"integral{len(scope.instants)}")
    scope.instants.append(Instant(symbol, integrand.sx, None))
    dim = None if integrand.dimension is None else integrand.dimension * SECOND
    return Expr(symbol, (), dim, scope)


class Delayed(Variable):
    """Record of an input that follows another one some time later."""

    def __init__(self, source: Variable, tau: float, history: Any) -> None:
        super().__init__(source.shape, source.unit, f"{source.name} delayed", "input", dict(source.attributes))
        self.source, self.tau, self.history = source, tau, history
        self.attributes |= {"min": None, "max": None}  # the input's own bounds hold it

    def before(self, time: float) -> float:
        """Value at a time [s] before the start of the horizon."""
        value: Any = self.history(time) if callable(self.history) else self.history
        try:
            found = float(value)
        except (TypeError, ValueError):
            found = np.nan
        if not np.isfinite(found):
            raise ModelError(
                f"the history of '{self.name}' is a finite number at {time:g} s; found {value!r}", self.where
            )
        return found


def delayed(source: Any, tau: float, *, history: Any) -> Any:
    """The input `source` of the same class as it was `tau` seconds ago: `late = gt.delayed(u, 0.1, history=0.0)`.

    A constant delay of a scalar input on a given horizon, where every mesh edge is an edge `tau` earlier and
    later, too. A part may delay its own input.
    `history` is its value before the start: a number or a function of time [s]. Raises ModelError for another source.
    """
    if not isinstance(source, Variable) or source.role != "input" or source.shape != ():
        raise ModelError(f"gt.delayed takes a scalar gt.input of the same class; found {source!r}", here())
    if not np.isfinite(tau) or tau <= 0:
        raise ModelError(f"a delay is positive; found {tau!r} s", here())
    return Delayed(source, float(tau), history)


def misfit(expression: Any, times: Any, measured: Any, *, sigma: Any = None) -> Expr:
    """Sum of squares of (expression - measured) / sigma over measured instants: the cost of an estimation.

    Args:
        expression: scalar or vector (k,) of the model.
        times: instants (n,) [s] within the horizon.
        measured: values (n,) or (n, k), in the expression's SI unit.
        sigma: standard deviation of the noise, a number or (k,), in the same unit; None: one unknown number for all
            measured values, told by what is left over. See gt.estimate for the covariance.

    Raises ModelError for shapes that do not fit and numbers that are not finite.
    """
    if not isinstance(expression, Expr) or len(expression.shape) > 1:
        raise ModelError(f"gt.misfit takes a scalar or a vector expression; found {expression!r}", here())
    at_times = np.asarray(times, float)
    size = expression.shape[0] if expression.shape else 1
    values = np.asarray(measured, float)
    if at_times.ndim != 1 or values.shape not in ((len(at_times), *expression.shape), (len(at_times), size)):
        raise ModelError(
            f"gt.misfit takes n instants and a row for each of the expression's shape {expression.shape}; found "
            f"{at_times.shape} and {values.shape}",
            here(),
        )
    if not (np.all(np.isfinite(at_times)) and np.all(np.isfinite(values))) or not at_times.size:
        raise ModelError("gt.misfit takes at least one measured value, and finite ones only", here())
    noise = np.ones(()) if sigma is None else np.asarray(sigma, float)
    if noise.shape not in ((), (size,)):
        raise ModelError(f"sigma is one number, or one for each of {size} measured; found {noise.shape}", here())
    noise = np.broadcast_to(noise, (size,))
    if not np.all((noise > 0) & np.isfinite(noise)):
        raise ModelError(f"sigma is a standard deviation, positive and finite; found {sigma!r}", here())
    values = values.reshape(len(at_times), size)
    residuals = [
        (expression.at(float(t)).sx - ca.DM(row)) / ca.DM(noise) for t, row in zip(at_times, values, strict=True)
    ]
    everything = ca.vertcat(*residuals)
    expression.scope.misfits.append(Misfit(everything, sigma is not None))
    return Expr(ca.sumsqr(everything), (), ONE, expression.scope)
