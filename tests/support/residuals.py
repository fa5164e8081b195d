"""Every equation as the person wrote it, evaluated at what a causality computes: the strongest check there is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

import gtmodel as gt
from gtmodel.compiler.causal import flat_of
from gtmodel.compiler.flat import FlatModel


def every_pair(flat: FlatModel) -> list[tuple[int, int]]:
    """All (variable, derivative order) that stand in the model's own equations, aliases included."""
    return sorted({p for e in flat.equations for p in flat.scope.symbols_in(e.residual)})


def arguments(f: gt.CausalFunction, values: Mapping[str, Any]) -> list[Any]:
    """The arguments of a function from values by name, such as {"T": ..., "der(T)": ...}; surplus ones are left."""
    scalars: dict[tuple[int, int], float] = {}
    for name, value in values.items():
        _, indices, order = f.flat.lookup(name)
        scalars.update({(i, order): v for i, v in zip(indices, np.ravel(value), strict=True)})
    return [np.reshape([scalars[p] for p in s.pairs], s.shape) for s in f.inputs]


def original_residuals(
    model: gt.Model,
    values: Mapping[str, Any],
    known: Sequence[str] | str = (),
    prefer: Sequence[str] | str = (),
    branches: Mapping[str, int] | None = None,
    time: float = 0.0,
) -> np.ndarray:
    """Residuals of the equations before any elimination, in SI units.

    All names are asked for at once, so that none is forgotten on the way.
    """
    flat = flat_of(model)
    pairs = every_pair(flat)
    f = model.causal(known, [flat.symbol_name(*p) for p in pairs], prefer, branches)
    given = arguments(f, values) + ([time] if f.plan.uses_time else [])
    *found, status = f(*given)
    assert status == gt.Status.OK, f.diagnose(*given)
    symbols = ca.vertcat(*[flat.scope.symbol(*p) for p in pairs])
    equations = ca.vertcat(*[e.residual for e in flat.equations])
    g = ca.Function("equations", [symbols, flat.p, flat.scope.time], [equations])
    return np.asarray(g(np.array(found, dtype=float), flat.p0, time).full()).reshape(-1)
