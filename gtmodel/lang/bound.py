"""Checks of parameter values that only binding allows: expressions of others, and bounds that are other parameters."""

from __future__ import annotations

from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from .declare import Declaration, Parameter
from .values import check_parameter

if TYPE_CHECKING:
    from .bind import ParameterRecord, Tree


class BoundParameters:
    """Which parameters follow from others, or are bounded by them: the same for all values of a tree's parameters."""

    def __init__(self, tree: Tree) -> None:
        bound = [r for r in tree.parameters if r.values is None and not r.indices]
        named = [r for r in tree.parameters if any(isinstance(b, Declaration) for b in (r.item.low, r.item.high))]
        owner = {tree.scope.parameters[i].element_hash(): r for r in tree.parameters for i in r.indices}
        self._size = len(tree.scope.parameters)
        self._sources: dict[str, list[str]] = {}
        self._ready: list[ParameterRecord] = []
        for r in bound:
            given = _unique([owner[h] for s in ca.symvar(r.expression) if (h := s.element_hash()) in owner])
            self._sources[r.name] = [o.name for o in given]
            if all(o.values is not None for o in given):
                self._ready.append(r)
        self._checked = _unique([*self._ready, *named])
        expressions = [r.expression for r in self._ready]
        self._values = ca.Function("bound", [ca.vertcat(*tree.scope.parameters)], expressions)

    def check(self, parameters: list[ParameterRecord]) -> None:
        """ModelError as for given values, with the parameters that a value follows from and the line that gave them.
        The parameters are those of the tree, with any values where they have some of their own."""
        known: dict[str, np.ndarray] = {}
        numbers, by_name = np.zeros(self._size), {r.name: r for r in parameters}
        for r in parameters:
            if r.values is not None:
                numbers[r.indices] = r.values
                known[r.name] = r.values.reshape(r.shape)
        for r, value in zip(self._ready, self._values.call([ca.DM(numbers)]), strict=True):
            known[r.name] = value.full().reshape(r.shape)
        for r in self._checked:
            if r.name not in known:
                continue
            assert isinstance(r.item, Parameter)
            inside = f"{r.component}." if r.component else ""
            names = [b.name for b in (r.item.low, r.item.high) if isinstance(b, Declaration)]
            others = {n: known[inside + n] for n in names if inside + n in known}
            given, array = [by_name[name] for name in self._sources.get(r.name, [])], known[r.name]
            origin = ", which follows from " + " and ".join(map(_with_value, given)) if given else ""
            where = given[0].where if given else r.where
            check_parameter(r.item, array if r.shape else float(array), r.name, where, others, origin)


def check_bound(tree: Tree) -> None:
    """ModelError where a parameter that follows from others, or is bounded by them, is not allowed."""
    own = [r for r in tree.parameters if r.values is None and not r.indices]
    named = any(isinstance(b, Declaration) for r in tree.parameters for b in (r.item.low, r.item.high))
    if own or named:
        BoundParameters(tree).check(tree.parameters)


def _unique(records: list[ParameterRecord]) -> list[ParameterRecord]:
    return list({r.name: r for r in records}.values())


def _with_value(r: ParameterRecord) -> str:
    assert r.values is not None
    return f"{r.name} = {float(r.values[0]):.10g}" if not r.shape else r.name
