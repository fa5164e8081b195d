"""Cache of flat models, one for all equal configurations; and flat models with other parameter values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from threading import get_ident
from typing import Any

import casadi as ca
import numpy as np

from .._near import meant
from ..lang.bind import ParameterRecord, VariableRecord
from ..lang.builder import Builder
from ..lang.declarations import Declaration, Parameter
from ..lang.identity import Content
from ..lang.model import Model
from ..lang.optimization import Optimization
from ..lang.source import ModelError, about
from ..lang.values import BoundParameters, check_parameter
from .flat import FlatModel, flatten, variables_of
from .loops import settled


def values_by_place(flat: FlatModel, parameters: Mapping[str, Any]) -> dict[int, float]:
    """Return parameter values, passed by name, by their positions in `flat.p`.

    Raises ModelError for a name that is not a parameter with a value of its own, and for a wrong value.
    """
    values: dict[int, float] = {}
    for name, value in parameters.items():
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
        names = ", ".join(n for n, r in known.items() if r.indices and "." not in n) or "none"
        hint = meant(name, known, f"top-level parameters are {names}", most=2)
        raise ModelError(f"{flat.title} has no parameter '{name}'; {hint}")
    record = known[name]
    if not record.indices:
        sources = ", ".join(dict.fromkeys(s.name().split("[")[0] for s in ca.symvar(record.expression)))
        raise ModelError(
            f"parameter '{name}' follows from {sources or 'numbers in the model'}; change that value instead"
        )
    return record


def with_values(flat: FlatModel, values: Mapping[int, float]) -> FlatModel:
    """Return the model with other values at some positions of `flat.p`, with an empty cache.

    Attributes of variables that depend on these parameters change too. Raises ModelError for a wrong value of a
    parameter that depends on these, or is bounded by them.
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
    flat_parameters = [replace(q, value=values[n]) if n in values else q for n, q in enumerate(flat.parameters)]
    changed = replace(flat, parameters=flat_parameters, variables=variables, cache={})
    changed.made = with_values, (flat, dict(values))
    return changed


@dataclass(frozen=True, eq=False)
class _Dependent:
    """Quantities that depend on some parameters: `variables` with such attributes; `parameters`: the dependent ones and
    all with own values; `bounds`: the checks of their values, or None."""

    parameters: list[ParameterRecord]
    variables: list[VariableRecord]
    bounds: BoundParameters | None


def _dependent(flat: FlatModel, positions: tuple[int, ...]) -> _Dependent:
    key = "dependent", get_ident(), positions
    if key not in flat.cache:
        column = ca.vertcat(*[flat.parameters[n].symbol for n in positions])
        records = [r for r in flat.tree.parameters if r.indices]
        bound = [r for r in flat.tree.parameters if not r.indices and ca.depends_on(r.expression, column)]
        named = any(isinstance(b, Declaration) for r in records for b in (r.item.low, r.item.high))
        attributes = [(r, [a for a in r.attributes.values() if isinstance(a, ca.SX)]) for r in flat.tree.variables]
        variables = [r for r, a in attributes if a and ca.depends_on(ca.vertcat(*map(ca.vec, a)), column)]
        parameters = [*records, *bound]
        bounds = BoundParameters(replace(flat.tree, parameters=parameters)) if bound or named else None
        flat.cache[key] = _Dependent(parameters, variables, bounds)
    return flat.cache[key]


def _with(record: ParameterRecord, values: Mapping[int, float]) -> ParameterRecord:
    if record.values is None or not any(i in values for i in record.indices):
        return record
    numbers = [values.get(i, x) for i, x in zip(record.indices, record.values.tolist(), strict=True)]
    return replace(record, values=np.array(numbers))


def flattened(model: Model | Builder) -> FlatModel:
    """Return the flattened model with its loops settled; see `loops.settled` for its errors."""
    return settled(flatten(model))


KEPT = 16  # each takes some megabytes with its compiled functions


class _Configuration:
    """A cache key: a model that equals every model with the same content."""

    def __init__(self, model: Model, content: Content) -> None:
        self.model = model
        self._content = content

    def __hash__(self) -> int:
        return hash(self._content.key)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Configuration) and self._content.key == other._content.key


def flat_of(model: Model | Builder) -> FlatModel:
    """Return the flattened model; equal configurations share one.

    A Builder, an Optimization, and a model that reads data that may change unnoticed do not share it. A model is
    flattened again if data that its methods read, such as a global, have changed.
    """
    flat: FlatModel | None = getattr(model, "_flat", None)
    old_content: Content | None = getattr(model, "_content", None)
    if isinstance(model, Builder):
        if flat is None:
            model._flat = flattened(model)
            model._flat.made = flat_of, (model,)
        return model._flat
    if flat is not None and old_content is None:
        return flat
    content = Content(model)
    if flat is None or old_content is None or old_content.key != content.key:
        if flat is not None:
            flat.made = None
        alone = isinstance(model, Optimization) or not content.whole
        flat = flattened(model) if alone else shared(_Configuration(model, content))
        flat.made = flat_of, (model,)
        if flat.scope.source is not flat:
            flat.scope.belong(flat)
        model._keep(_flat=flat, _content=content)
    return flat


@lru_cache(maxsize=KEPT)
def shared(configuration: _Configuration) -> FlatModel:
    return flattened(configuration.model)


def with_tunable(model: Model, names: Sequence[str]) -> tuple[Model, dict[str, Any]]:
    """Return a model that all models share which differ only in these modifiers, and the values of this one by name.

    Names without a modifier, and all names of a Builder or a model that is not cached, keep their values in the model.
    Raises ModelError for a name that is not a parameter with a value of its own.
    """
    if isinstance(model, (Builder, Optimization)):
        return model, {}
    rest, values = model._apart_from(names)
    content = Content((rest, tuple(values)))
    if not values or not content.whole:
        first, values = model, {}
    else:
        first = _first(_Configuration(model, content))
    flat = flat_of(first)
    for name in names:
        with about(f"tunable.{name}"):
            _record(flat, name)
    return first, values


@lru_cache(maxsize=KEPT)
def _first(configuration: _Configuration) -> Model:
    return configuration.model
