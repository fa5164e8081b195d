"""Equal configurations share one flat model, and with it everything compiled from it before.

A configuration is immutable, and flattening depends on nothing else: two of the same class with the same modifiers give
the same. The last few are kept, so that `gt.robots.gantry_tau("l1_tape")` asked for again costs nothing.
"""

from __future__ import annotations

from collections.abc import Hashable
from functools import lru_cache
from typing import Any

import numpy as np

from ..lang.builder import Builder
from ..lang.model import Model
from ..lang.optimization import Optimization
from .flat import FlatModel, flatten

KEPT = 16  # of some megabytes each with their compiled functions


class _Opaque(Exception):
    """A modifier that its content does not distinguish from another one, such as a function."""


class _Configuration:
    """A model that equals any other of the same content."""

    def __init__(self, model: Model, content: Hashable) -> None:
        self.model = model
        self._content = content

    def __hash__(self) -> int:
        return hash(self._content)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Configuration) and self._content == other._content


def flat_of(model: Model | Builder) -> FlatModel:
    """The flattened model, the same for equal configurations. A Builder, to which lines are added, has one of its own,
    and so have an Optimization and a model with functions or expressions among its modifiers."""
    cached = model.__dict__.get("_flat")
    if cached is None:
        cached = _flattened(model)
        model.__dict__["_flat"] = cached
    return cached


def _flattened(model: Model | Builder) -> FlatModel:
    if not isinstance(model, Model) or isinstance(model, Optimization):
        return flatten(model)
    try:
        content = _content(model)
    except _Opaque:
        return flatten(model)
    return shared(_Configuration(model, content))


@lru_cache(maxsize=KEPT)
def shared(configuration: _Configuration) -> FlatModel:
    return flatten(configuration.model)


def _content(value: Any) -> Hashable:
    """What a modifier says, to the last bit: 0.0 is not -0.0, and 1 is not True."""
    if isinstance(value, (np.ndarray, np.generic)):
        if value.dtype.hasobject:
            raise _Opaque
        return ("array", value.dtype.str, value.shape, value.tobytes())
    if isinstance(value, float):
        return ("float", value.hex())
    if value is None or isinstance(value, (bool, int, str)):
        return (type(value), value)
    if isinstance(value, Model):
        modifiers = value.__dict__.get("_modifiers")
        if modifiers is None:  # bound already: a part of a tree, with symbols of its own
            raise _Opaque
        return (type(value), _content(modifiers))
    if isinstance(value, type):
        return value
    if isinstance(value, dict):
        return ("dict", tuple((_content(k), _content(v)) for k, v in value.items()))
    if type(value) in (list, tuple):
        return (type(value), tuple(_content(v) for v in value))
    raise _Opaque
