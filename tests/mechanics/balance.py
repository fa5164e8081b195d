"""The power balance of a model at one point: change of stored energy against power in and out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

import gtmodel as gt
from gtmodel.compiler.causal import flat_of
from tests.support.residuals import arguments


def power_balance(
    model: gt.Model, values: Mapping[str, Any], known: Sequence[str] | str = (), prefer: Sequence[str] | str = ()
) -> float:
    """(d stored/dt - supplied + dissipated) / sum of their sizes [1].

    The energies are what the components declare; no equation of motion enters but through the accelerations.
    """
    flat = flat_of(model)
    sign = {"stored": 1.0, "supplied": -1.0, "dissipated": 1.0}
    terms = [
        sign[e.kind] * (flat.scope.derivative(e.expression) if e.kind == "stored" else e.expression)
        for e in flat.energies
    ]
    column = ca.vertcat(*terms)
    pairs = flat.scope.symbols_in(column)
    f = model.causal(known, [flat.symbol_name(*p) for p in pairs], prefer)
    given = arguments(f, values)
    *found, status = f(*given)
    assert status == gt.Status.OK, f.diagnose(*given)
    symbols = ca.vertcat(*[flat.scope.symbol(*p) for p in pairs])
    powers = np.asarray(ca.Function("powers", [symbols, flat.p], [column])(np.array(found), flat.p0)).reshape(-1)
    return abs(float(powers.sum())) / float(np.abs(powers).sum())
