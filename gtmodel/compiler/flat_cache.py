"""Equal configurations share one flat model, and with it everything compiled from it before.

A configuration is immutable, and flattening depends on it and on what its methods read: two of the same class with the
same modifiers give the same while that stays the same (`lang/identity.py`). The last few are kept, so that
`gt.robots.gantry_tau("l1_tape")` asked for again costs nothing. All else that is made of a model is kept by its flat
model, so there is no other cache to look after.
"""

from __future__ import annotations

from functools import lru_cache

from ..lang.builder import Builder
from ..lang.identity import Content
from ..lang.model import Model
from ..lang.optimization import Optimization
from .flat import FlatModel, flatten

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
