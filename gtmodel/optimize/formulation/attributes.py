"""What was declared about a chain symbol under any of its names: nominal, start value, and the names themselves."""

from __future__ import annotations

from ...compiler.alias import AliasResult
from ...compiler.flat import FlatModel
from ...lang.scope import derivative_name

Pair = tuple[int, int]
HIGHEST = 2  # derivatives under whose names a guess may hold a state


def names_of(flat: FlatModel, alias: AliasResult, pair: Pair) -> list[tuple[str, int]]:
    """All (name, sign) with name == sign * symbol; the symbol's own name first."""
    own = flat.symbol_name(*pair)
    return [(own, 1)] + [(n, sign) for n, sign in _by_symbol(flat, alias).get(pair, []) if n != own]


def _by_symbol(flat: FlatModel, alias: AliasResult) -> dict[Pair, list[tuple[str, int]]]:
    """Names and signs of all variables and their derivatives, by what they stand for; made once and kept with alias."""
    known = alias.names
    if known is None or known[0] is not flat or known[1] != len(alias.removed):
        names: dict[Pair, list[tuple[str, int]]] = {}
        for v in flat.variables:
            for k in range(HIGHEST + 1):
                sign, kept, order = alias.resolve(v.index, k)
                names.setdefault((kept, order), []).append((derivative_name(v.name, k), sign))
        known = alias.names = flat, len(alias.removed), names
    return known[2]


def nominal_of(flat: FlatModel, alias: AliasResult, pair: Pair) -> float:
    """Its own nominal or that of a variable that equals it; a derivative without one takes its variable's."""
    own = flat.variables[pair[0]].nominal
    declared = [v.nominal for v in flat.variables if v.nominal != 1.0 and alias.resolve(v.index, 0)[1:] == pair]
    if pair[1] == 0 and own != 1.0:
        return own
    return declared[0] if declared else own


def start_of(flat: FlatModel, alias: AliasResult, pair: Pair) -> float:
    """Its start value or that of a variable that equals it; 0 where none is declared."""
    own = flat.variables[pair[0]].start
    if pair[1] == 0 and own is not None:
        return own
    for v in flat.variables:
        sign, kept, order = alias.resolve(v.index, 0)
        if (kept, order) == pair and v.start is not None:
            return sign * v.start
    return 0.0
