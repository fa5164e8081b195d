"""One flat model for equal configurations, with everything compiled from it before, and the same with other values of
some parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from threading import get_ident
from typing import Any

import casadi as ca
import numpy as np

from .._near import meant
from ..lang.bind import ParameterRecord, VariableRecord
from ..lang.builder import Builder
from ..lang.declare import Declaration, Parameter
from ..lang.identity import Content
from ..lang.model import Model
from ..lang.optimization import Optimization
from ..lang.source import ModelError, about
from ..lang.values import BoundParameters, check_parameter
from .flat import FlatModel, flatten, variables_of


def values_by_place(flat: FlatModel, given: Mapping[str, Any]) -> dict[int, float]:
    """Values of parameters that a person gave by name, by their places in `flat.p`.

    Raises ModelError for a name that is no parameter with a value of its own, and for a value that it does not take.
    """
    values: dict[int, float] = {}
    for name, value in given.items():
        with about(f"parameters.{name}"):
            record = _record(flat, name)
            assert isinstance(record.item, Parameter)
            array = check_parameter(record.item, value, name)
            if array.shape != record.shape:
                raise ModelError(
                    f"parameter '{name}' has shape {record.shape} in this model; found a value of shape {array.shape}"
                )
            values |= dict(zip(record.indices, array.reshape(-1).tolist(), strict=True))
    return values


def _record(flat: FlatModel, name: str) -> ParameterRecord:
    known = {r.name: r for r in flat.tree.parameters if isinstance(r.item, Parameter)}
    if name not in known:
        own = ", ".join(n for n, r in known.items() if r.indices and "." not in n) or "none"
        hint = meant(name, known, f"top-level ones are {own}", most=2)
        raise ModelError(f"{flat.title} has no parameter '{name}'; {hint}")
    record = known[name]
    if not record.indices:
        sources = ", ".join(dict.fromkeys(s.name().split("[")[0] for s in ca.symvar(record.expression)))
        raise ModelError(
            f"parameter '{name}' follows from {sources or 'numbers in the model'}; give that another value"
        )
    return record


def with_values(flat: FlatModel, values: Mapping[int, float]) -> FlatModel:
    """The model with other numbers at some places of `flat.p`; attributes of variables follow, what was compiled does
    not come along.

    Raises ModelError where a parameter that follows from these, or is bounded by them, is not allowed.
    """
    if not values:
        return flat
    dependent = _dependent(flat, tuple(sorted(values)))
    parameters = [_with(r, values) for r in dependent.parameters]
    if dependent.bounds is not None:
        dependent.bounds.check(parameters)
    variables = flat.variables
    if dependent.variables:
        tree = replace(flat.tree, parameters=parameters, variables=dependent.variables)
        others = {v.index: v for v in variables_of(tree)}
        variables = [others.get(v.index, v) for v in variables]
    given = [replace(q, value=values[n]) if n in values else q for n, q in enumerate(flat.parameters)]
    return replace(flat, parameters=given, variables=variables, cache={})


@dataclass(frozen=True, eq=False)
class _Dependent:
    """What follows from some parameters: `variables` with such attributes, `parameters` with all that have values of
    their own; `bounds`: what these must keep, None where that is nothing."""

    parameters: list[ParameterRecord]
    variables: list[VariableRecord]
    bounds: BoundParameters | None


def _dependent(flat: FlatModel, places: tuple[int, ...]) -> _Dependent:
    key = "dependent", get_ident(), places
    if key not in flat.cache:
        column = ca.vertcat(*[flat.parameters[n].symbol for n in places])
        own = [r for r in flat.tree.parameters if r.indices]
        bound = [r for r in flat.tree.parameters if not r.indices and ca.depends_on(r.expression, column)]
        named = any(isinstance(b, Declaration) for r in own for b in (r.item.low, r.item.high))
        attributes = [(r, [a for a in r.attributes.values() if isinstance(a, ca.SX)]) for r in flat.tree.variables]
        variables = [r for r, given in attributes if given and ca.depends_on(ca.vertcat(*map(ca.vec, given)), column)]
        parameters = [*own, *bound]
        bounds = BoundParameters(replace(flat.tree, parameters=parameters)) if bound or named else None
        flat.cache[key] = _Dependent(parameters, variables, bounds)
    return flat.cache[key]


def _with(record: ParameterRecord, values: Mapping[int, float]) -> ParameterRecord:
    if record.values is None or not any(i in values for i in record.indices):
        return record
    numbers = [values.get(i, x) for i, x in zip(record.indices, record.values.tolist(), strict=True)]
    return replace(record, values=np.array(numbers))


KEPT = 16  # of some megabytes each with their compiled functions


class _Configuration:
    """A model that equals any other of the same content."""

    def __init__(self, model: Model, content: Content) -> None:
        self.model = model
        self._content = content

    def __hash__(self) -> int:
        return hash(self._content.key)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Configuration) and self._content.key == other._content.key


def flat_of(model: Model | Builder) -> FlatModel:
    """The flattened model, the same for equal configurations. A Builder, to which lines are added, has one of its own,
    and so have an Optimization and a model that reads what may change unseen. A model whose methods read something that
    has changed since, such as a global, is flattened anew."""
    own: FlatModel | None = getattr(model, "_flat", None)
    kept: Content | None = getattr(model, "_content", None)
    if isinstance(model, Builder):
        model._flat = flatten(model) if own is None else own
        return model._flat
    if own is not None and kept is None:
        return own
    content = Content(model)
    if own is None or kept is None or kept.key != content.key:
        alone = isinstance(model, Optimization) or not content.whole
        own = flatten(model) if alone else shared(_Configuration(model, content))
        model._keep(_flat=own, _content=content)
    return own


@lru_cache(maxsize=KEPT)
def shared(configuration: _Configuration) -> FlatModel:
    return flatten(configuration.model)
