"""Boolean variables, and those of enumerations, stand for what their equations say."""

from __future__ import annotations

from typing import Any

from ..flat import Flattened, ScalarEquation, ScalarWhen
from ..scalars import Flat, Symbol
from ..syntax import ModelicaError


def settle_macros(out: Flattened) -> None:
    """Each gets what stands for it everywhere, in `replaced`; those that events set stay.

    Raises ModelicaError for one without an equation, or with two.
    """
    set_by_events = {id(a.left.flat) for e in out.equations if isinstance(e, ScalarWhen) for a in e.actions}
    for flat in out.flats:
        if flat.kind == "discrete" and id(flat) not in set_by_events:
            flat.kind = "variable"  # discrete because what it follows from is
    kept: list[Any] = []
    waiting: list[ScalarEquation] = []
    for e in out.equations:
        if isinstance(e, ScalarEquation) and (_stands(e.left) or _stands(e.right)):
            waiting.append(e)
        else:
            kept.append(e)
    while waiting:
        later: list[ScalarEquation] = []
        for e in waiting:
            left, right = _open(e.left), _open(e.right)
            if left and right:
                later.append(e)
            elif left:
                e.left.flat.replaced = e.right
            elif right:
                e.right.flat.replaced = e.left
            else:
                name = (e.left if _stands(e.left) else e.right).flat.name
                raise ModelicaError(f"'{name}' has two equations", e.at)
        if len(later) == len(waiting):
            flat = later[0].left.flat
            raise ModelicaError(f"'{flat.name}' is {flat.base} and has no equation of its own", flat.at)
        waiting = later
    out.equations = kept
    for flat in out.flats:
        if _of_values(flat) and flat.replaced is None and flat.kind == "variable":
            raise ModelicaError(f"'{flat.name}' is {flat.base} and has no equation of its own", flat.at)


def _of_values(flat: Flat) -> bool:
    return flat.base not in ("Real", "Integer")


def _stands(x: Any) -> bool:
    """Is it a variable that something stands for, or an event sets?"""
    return isinstance(x, Symbol) and _of_values(x.flat) and x.flat.kind in ("variable", "input", "discrete")


def _open(x: Any) -> bool:
    return _stands(x) and x.flat.kind != "discrete" and x.flat.replaced is None
