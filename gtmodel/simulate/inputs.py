"""What drives a simulation: constants, functions of time, tables, trajectories."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ..compiler.flat import FlatModel
from ..lang.source import ModelError
from ..results.trajectory import Trajectory


@dataclass(eq=False)
class Inputs:
    """Scalar known variables as functions of time.

    `functions`: index -> expression of `t`; `tables`: index -> (times, values), piecewise linear and held at
    its ends. `knots` are the times at which a table bends: the integrator restarts there.
    """

    t: ca.SX
    functions: dict[int, ca.SX]
    tables: dict[int, tuple[np.ndarray, np.ndarray]]

    @property
    def known(self) -> list[int]:
        return sorted([*self.functions, *self.tables])

    @property
    def knots(self) -> np.ndarray:
        times = [t for t, _ in self.tables.values()]
        return np.unique(np.concatenate(times)) if times else np.zeros(0)

    def table_values(self, time: float) -> np.ndarray:
        """Values of all tables at one time, in the order of their indices."""
        return np.array([np.interp(time, *self.tables[i]) for i in sorted(self.tables)])


def read_inputs(flat: FlatModel, given: Mapping[str, Any]) -> Inputs:
    """Inputs from what a person gave by name.

    Each value is a number or array, a function of time (of one CasADi-compatible argument, e.g.
    ``lambda t: np.sin(t)``), a pair (times, values), or a Trajectory that holds the name.

    Raises ModelError for a wrong name, shape, or a function that cannot be evaluated symbolically.
    """
    t = ca.SX.sym("t")
    functions: dict[int, ca.SX] = {}
    tables: dict[int, tuple[np.ndarray, np.ndarray]] = {}
    for name, value in given.items():
        shape, indices, order = flat.lookup(name)
        if order:
            raise ModelError(f"input '{name}' is a derivative; give the variable itself as a function of time")
        if isinstance(value, Trajectory):
            value = (value.time, value[name])
        if isinstance(value, tuple) and len(value) == 2:
            times, values = np.asarray(value[0], float), np.asarray(value[1], float)
            _check_table(name, times, values, len(indices))
            columns = values.reshape(len(times), -1)
            for k, i in enumerate(indices):
                tables[i] = (times, columns[:, k])
            continue
        expressions = _symbolic(name, value, t) if callable(value) else _constant(name, value)
        if len(expressions) not in (1, len(indices)):
            raise ModelError(f"input '{name}' has {len(indices)} entries; found {len(expressions)}")
        for k, i in enumerate(indices):
            functions[i] = expressions[k if len(expressions) > 1 else 0]
    return Inputs(t, functions, tables)


def _constant(name: str, value: Any) -> list[ca.SX]:
    try:
        array = np.asarray(value, dtype=float).reshape(-1)
    except (TypeError, ValueError):
        raise ModelError(
            f"input '{name}' takes a number, an array, a function of time, (times, values) or a Trajectory; "
            f"found {type(value).__name__}"
        ) from None
    if not np.all(np.isfinite(array)):
        raise ModelError(f"input '{name}' must be finite; found {value}")
    return [ca.SX(float(x)) for x in array]


def _symbolic(name: str, function: Callable[[Any], Any], t: ca.SX) -> list[ca.SX]:
    try:
        value = function(t)
    except Exception as error:
        raise ModelError(
            f"input '{name}' cannot be written as an expression of time ({type(error).__name__}: {error}); use "
            "functions such as np.sin, or give (times, values)"
        ) from None
    if isinstance(value, ca.SX):
        return [value[k] for k in range(value.numel())]
    return [ca.SX(v) for v in np.atleast_1d(np.asarray(value, dtype=object)).tolist()]


def _check_table(name: str, times: np.ndarray, values: np.ndarray, size: int) -> None:
    rows = values.shape[0] if values.ndim else 0
    if times.ndim != 1 or rows != len(times) or values.size != size * len(times):
        raise ModelError(
            f"the table of input '{name}' takes times (n,) and values (n,) or (n, {size}); found {times.shape} and "
            f"{values.shape}"
        )
    if not (np.all(np.isfinite(times)) and np.all(np.isfinite(values))):
        raise ModelError(f"the table of input '{name}' holds numbers that are not finite")
    if np.any(np.diff(times) <= 0):
        raise ModelError(f"the times of input '{name}' must increase strictly")
