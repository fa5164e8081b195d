"""Checks of parameter values that only binding allows: expressions of others, and bounds that are other parameters."""

from __future__ import annotations

from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from .declare import Declaration, Parameter
from .values import check_parameter

if TYPE_CHECKING:
    from .bind import ParameterRecord, Tree


def check_bound(tree: Tree) -> None:
    """ModelError as for given values, with the parameters that a value follows from and the line that gave them."""
    bound = [r for r in tree.parameters if r.values is None and not r.indices]
    named = [r for r in tree.parameters if any(isinstance(b, Declaration) for b in (r.item.low, r.item.high))]
    if not bound and not named:
        return
    owner = {tree.scope.parameters[i].element_hash(): r for r in tree.parameters for i in r.indices}
    sources = {r.name: _unique([owner[h] for s in ca.symvar(r.expression) if (h := s.element_hash()) in owner])
               for r in bound}  # fmt: skip
    known = {r.name: r.values.reshape(r.shape) for r in tree.parameters if r.values is not None}
    ready = [r for r in bound if all(o.values is not None for o in sources[r.name])]
    numbers = np.zeros(len(tree.scope.parameters))
    for r in tree.parameters:
        if r.values is not None:
            numbers[r.indices] = r.values
    f = ca.Function("bound", [ca.vertcat(*tree.scope.parameters)], [r.expression for r in ready])
    for r, value in zip(ready, f.call([ca.DM(numbers)]), strict=True):
        known[r.name] = value.full().reshape(r.shape)
    for r in _unique([*ready, *named]):
        if r.name not in known:
            continue
        assert isinstance(r.item, Parameter)
        inside = f"{r.component}." if r.component else ""
        names = [b.name for b in (r.item.low, r.item.high) if isinstance(b, Declaration)]
        others = {n: known[inside + n] for n in names if inside + n in known}
        given, array = sources.get(r.name, []), known[r.name]
        origin = ", which follows from " + " and ".join(map(_with_value, given)) if given else ""
        where = given[0].where if given else r.where
        check_parameter(r.item, array if r.shape else float(array), r.name, where, others, origin)


def _unique(records: list[ParameterRecord]) -> list[ParameterRecord]:
    return list({r.name: r for r in records}.values())


def _with_value(r: ParameterRecord) -> str:
    assert r.values is not None
    return f"{r.name} = {float(r.values[0]):.10g}" if not r.shape else r.name
