"""The home pose of a model whose start values do not satisfy its equations, shared by all causalities.

Forward and inverse functions continue this pose; from different poses they might lead to different assembly modes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from ...lang.source import ModelError
from ..alias import AliasResult, eliminate
from ..flat import FlatModel, FlatVariable
from .points import RESIDUAL_TOLERANCE, Sampler

# distance in nominals beyond which a start value counts as moved: sample points are closer to it
MOVED = 0.1
# distances in nominals of the random start values from which a single variable is moved
SPREADS = (0.0, 0.3, 0.3, 1.0, 1.0, 3.0, 3.0)
SHOWN = 6

Pair = tuple[int, int]


@dataclass(frozen=True)
class Moved:
    """A start value that was moved: name of the scalar variable, declared value and value at home."""

    name: str
    start: float
    home: float


def starts_of(flat: FlatModel, alias: AliasResult, home: dict[int, float] | None = None) -> dict[Pair, float]:
    """Return start values by kept symbol. The home pose has precedence, then the kept variable, then its aliases."""
    starts: dict[Pair, float] = {}
    for index, value in sorted((home or {}).items()):
        sign, kept, order = alias.resolve(index, 0)
        starts.setdefault((kept, order), sign * value)
    for v in sorted(flat.variables, key=lambda v: v.index in alias.removed):
        if v.start is not None:
            sign, kept, order = alias.resolve(v.index, 0)
            starts.setdefault((kept, order), sign * v.start)
    return starts


def moved(flat: FlatModel, sampler: Sampler, w: np.ndarray, starts: dict[Pair, float]) -> list[Moved]:
    """Return the start values that a consistent point does not keep."""
    moves = []
    for (index, order), start in sorted(starts.items()):
        place = sampler.position.get((index, order))
        if place is not None and abs(w[place] - start) > MOVED * flat.variables[index].nominal:
            moves.append(Moved(flat.symbol_name(index, order), start, float(w[place])))
    return moves


def moved_sentence(flat: FlatModel, changes: list[Moved]) -> str:
    """Return a sentence about the start values that were moved; empty if there are none."""
    if not changes:
        return ""
    names = ", ".join(f"{m.name} from {m.start:.4g} to {m.home:.4g}" for m in changes[:SHOWN])
    rest = f" and {len(changes) - SHOWN} more" if len(changes) > SHOWN else ""
    return (
        f"the start values of {flat.title} do not satisfy its equations: the home pose moves {names}{rest}; set "
        "consistent start values, otherwise functions may return another assembly mode than intended"
    )


def refuse_starts(flat: FlatModel, alias: AliasResult, sampler: Sampler, changes: list[Moved]) -> None:
    """Raise ModelError if fixed start values were moved and no pose has them; guesses may move."""
    fixed: dict[Pair, FlatVariable] = {}
    for v in flat.variables:
        if v.fixed and v.start is not None:
            fixed.setdefault(alias.resolve(v.index, 0)[1:], v)
    names = {flat.symbol_name(*pair): v for pair, v in fixed.items()}
    at_fault = [names[m.name] for m in changes if m.name in names]
    if not at_fault:
        return
    declared = replace(sampler, starts=starts_of(flat, alias))
    if declared.keeps({p for p in fixed if p in sampler.position}):
        return
    values = ", ".join(f"{v.name} = {v.start:g}" for v in at_fault[:SHOWN])
    raise ModelError(
        f"{flat.title} cannot be assembled with the fixed start values {values}: no pose with them satisfies the "
        "equations; set reachable values, or remove fixed=True to make them guesses",
        at_fault[0].where,
    )


def home_of(flat: FlatModel) -> dict[int, float]:
    """Return variables, by index, at a consistent pose in which as few start values as possible are moved.

    If moving one declared variable suffices, only this one moves: a wrong guess of passive joints does not move the
    actuated ones. Otherwise all move as little as possible. Empty if no pose is found.
    """
    if "home" not in flat.cache:
        flat.cache["home"] = _home_of(flat)
    return flat.cache["home"]


def _home_of(flat: FlatModel) -> dict[int, float]:
    alias = eliminate(flat, frozenset())
    residuals = [e.residual for e in alias.equations]
    inside = [flat.scope.symbols_in(r) for r in residuals]
    # only equations of positions: those of rates and forces depend on the causality
    chosen = [n for n, symbols in enumerate(inside) if symbols and all(order == 0 for _, order in symbols)]
    pairs = sorted({p for n in chosen for p in inside[n]})
    starts = {p: x for p, x in starts_of(flat, alias).items() if p in set(pairs)}
    if not starts:
        return {}
    sampler = Sampler(flat, pairs, [ca.vertcat(*[residuals[n] for n in chosen])], starts)
    best: tuple[float, np.ndarray] | None = None
    for group in [set[Pair](), *_groups(flat, starts)]:  # first only variables without a start value
        free = np.array([p in group or p not in starts for p in pairs], dtype=float)
        for seed, spread in enumerate(SPREADS):
            rng = np.random.default_rng(seed)
            w = sampler.near(rng, 0.0)
            for p in sorted(group):
                w[sampler.position[p]] += spread * flat.variables[p[0]].nominal * rng.standard_normal()
            sampler.follow(w, free, range(len(pairs)))
            if sampler.residual(w) <= RESIDUAL_TOLERANCE:
                off = [(w[sampler.position[p]] - starts[p]) / flat.variables[p[0]].nominal for p in sorted(group)]
                if best is None or np.linalg.norm(off) < best[0] - RESIDUAL_TOLERANCE:
                    best = (float(np.linalg.norm(off)), w)
            if best is not None and not group:
                return {index: float(w[n]) for n, (index, _) in enumerate(pairs)}
    if best is None:
        nearest = sampler.nearest()
        if nearest is None:
            return {}
        best = (0.0, nearest)
    return {index: float(best[1][n]) for n, (index, _) in enumerate(pairs)}


def _groups(flat: FlatModel, starts: dict[Pair, float]) -> list[set[Pair]]:
    """Return the start values grouped by declared variable, in order of declaration."""
    name_of = {i: name for name, (_, indices) in flat.groups.items() for i in indices}
    groups: dict[str, set[Pair]] = {}
    for p in sorted(starts):
        groups.setdefault(name_of.get(p[0], flat.variables[p[0]].name), set()).add(p)
    return list(groups.values())
