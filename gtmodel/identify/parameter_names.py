"""Scalar parameters of a model by the names that a person writes: "m_p", "m_c" for all its entries, "m_c[1]"."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from gtmodel.compiler.flat import FlatModel
from gtmodel.lang import ModelError

from .._near import meant


class ParameterError(ModelError):
    """A parameter cannot be used as it was asked for; `parameter` is its name."""

    def __init__(self, sentence: str, parameter: str = "") -> None:
        super().__init__(sentence)
        self.parameter = parameter


def scalar_parameters(flat: FlatModel, names: Sequence[str]) -> list[int]:
    """Positions in `flat.parameters`; an array's name stands for all its entries, in order.

    Raises ParameterError for an unknown name with close matches, a name given twice, or one that follows from others;
    ModelError for no name.
    """
    every = [q.name for q in flat.parameters]
    places: list[int] = []
    for name in names:
        here = [k for k, one in enumerate(every) if one == name or one.startswith(f"{name}[")]
        if not here:
            raise ParameterError(_unknown(flat, name, every), name)
        twice = sorted(set(here) & set(places))
        if twice:
            raise ParameterError(f"parameter '{every[twice[0]]}' is named twice; name each once", every[twice[0]])
        places += here
    if not places:
        raise ModelError(f"{flat.title}: no parameter is named; name at least one, such as '{every[0]}'")
    return places


def among(every: Sequence[str], names: Sequence[str]) -> list[int]:
    """Positions of names among scalar ones; an array's name stands for all its entries. ModelError for another."""
    places: list[int] = []
    for name in names:
        here = [k for k, one in enumerate(every) if one == name or one.startswith(f"{name}[")]
        if not here:
            raise ModelError(f"'{name}' is no parameter of this regressor; it has {', '.join(every)}")
        places += here
    return sorted(set(places))


def _unknown(flat: FlatModel, name: str, every: list[str]) -> str:
    if name in flat.bindings:
        inside = {s.element_hash() for s in ca.symvar(ca.SX(flat.bindings[name]))}
        origin = [q.name for q in flat.parameters if q.symbol.element_hash() in inside]
        return f"parameter '{name}' of {flat.title} follows from {', '.join(origin) or 'numbers'}; name these instead"
    known = list(dict.fromkeys([*(n.partition("[")[0] for n in every), *every]))
    hint = meant(name, known, f"there are {', '.join(known[:12])}", most=3)
    return f"{flat.title} has no parameter '{name}'; {hint}"
