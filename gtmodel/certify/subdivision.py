"""Boxes cut in halves until every one is decided: all boxes of one level at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from .certificate import PROVED, REFUTED, UNDECIDED
from .claims import Claim
from .intervals import Array

# shortest side of a box, relative to the whole: shorter ones hold few numbers in double
SHORTEST = 2.0**-30
BLOCK = 4096  # boxes between two checks of time and stop


@dataclass(frozen=True)
class Decision:
    """For boxes: `states` (claims, n) 1, 0 or -1, `side` (n,) along which to halve, -1 for none, and `worst`, numbers
    (k, n) whose greatest over all boxes are reported as bounds."""

    states: Array
    side: Array
    worst: Array


class Prover(Protocol):
    """A function with its claims. `decide` judges boxes lo, hi (inputs, n) for every point in them; `at` judges points
    by evaluation: states (claims, n)."""

    @property
    def claims(self) -> Sequence[Claim]: ...
    def decide(self, lo: Array, hi: Array) -> Decision: ...
    def at(self, points: Array) -> Array: ...


@dataclass
class Leaves:
    """Decided boxes, and those that were left undecided: lo, hi (inputs, n), `states` (claims, n), `share` (n,) of the
    whole volume, `worst` (k, n). `examined` boxes in all; `violated`: for each claim a point (inputs,) that violates
    it, found by evaluation, or None. `complete`: the work was not stopped."""

    lo: Array
    hi: Array
    states: Array
    share: Array
    worst: Array
    examined: int = 0
    violated: list[Array | None] = field(default_factory=list)
    complete: bool = True

    @property
    def verdicts(self) -> Array:
        """(n,): PROVED if all claims hold, REFUTED if one holds nowhere, else UNDECIDED."""
        return np.where(
            (self.states < 0).any(axis=0), REFUTED, np.where((self.states > 0).all(axis=0), PROVED, UNDECIDED)
        )

    def volume(self, verdict: int) -> float:
        """Share of the whole volume with this verdict, from 0 to 1; 1 only if all boxes have it, however small the
        others are."""
        chosen = self.verdicts == verdict
        return 1.0 if chosen.all() else min(float(self.share[chosen].sum()), 1.0 - 2.0**-53)


def subdivide(
    prover: Prover,
    lo: Array,
    hi: Array,
    max_boxes: int,
    going: Callable[[float, int], bool] = lambda share, boxes: True,
    whole: bool = False,
) -> Leaves:
    """Decide a box lo, hi (inputs,) by halving what is undecided.

    At most `max_boxes` boxes are examined; `going` is called with the decided share and the number of boxes, False
    ends the work. What is then left is undecided. `whole`: end as soon as the whole box cannot be proved.
    """
    claims = len(prover.claims)
    level, depth = (lo[:, None].copy(), hi[:, None].copy()), np.zeros(1)
    parts: list[Leaves] = []
    violated: list[Array | None] = [None] * claims
    _look(prover, _corners(lo, hi), violated)
    examined, share, complete = 0, 0.0, True
    while depth.size:
        decision, ended = _decided(prover, level, lambda n: going(share, examined + n))  # noqa: B023, called at once
        complete &= not ended
        examined += depth.size
        states = decision.states
        done = (states > 0).all(axis=0) | (states < 0).any(axis=0)
        middle = level[0] + 0.5 * (level[1] - level[0])
        looked = ~(states > 0).all(axis=0)
        _look(prover, middle[:, looked], violated)
        stuck = (decision.side < 0) & ~done
        split = np.flatnonzero(~done & ~stuck)
        kept = done | stuck
        more = split.size > 0 and going(share + float((2.0 ** -depth[done]).sum()), examined)
        more &= not ended
        if whole and (stuck.any() or (states < 0).any() or any(v is not None for v in violated)):
            split = split[:0]
            kept[:] = True
        elif not more or examined + 2 * split.size > max_boxes:
            complete = complete and (more or not split.size)
            kept[:], split = True, split[:0]
        parts.append(_leaves(level, states, depth, decision.worst, kept))
        share += float((2.0 ** -depth[done]).sum())
        level, depth = _halved(level, depth, split, decision.side)
    return Leaves(
        np.concatenate([p.lo for p in parts], axis=1), np.concatenate([p.hi for p in parts], axis=1),
        np.concatenate([p.states for p in parts], axis=1), np.concatenate([p.share for p in parts]),
        np.concatenate([p.worst for p in parts], axis=1), examined, violated, complete,
    )  # fmt: skip


def _decided(prover: Prover, level: tuple[Array, Array], going: Callable[[int], bool]) -> tuple[Decision, bool]:
    """Decide the boxes of a level block by block; when the work ends, the rest stays open. Returns also whether it
    ended."""
    lo, hi = level
    parts: list[Decision] = []
    ended = False
    for first in range(0, lo.shape[1], BLOCK):
        if parts and not going(first):
            rest = lo.shape[1] - first
            states, worst = (np.zeros((len(x), rest), dtype=x.dtype) for x in (parts[0].states, parts[0].worst))
            parts.append(Decision(states, np.full(rest, -1), worst))
            ended = True
            break
        parts.append(prover.decide(lo[:, first : first + BLOCK], hi[:, first : first + BLOCK]))
    joined = Decision(*(np.concatenate([getattr(p, n) for p in parts], axis=-1) for n in ("states", "side", "worst")))
    return joined, ended


def _leaves(level: tuple[Array, Array], states: Array, depth: Array, worst: Array, kept: Array) -> Leaves:
    return Leaves(level[0][:, kept], level[1][:, kept], states[:, kept], 2.0 ** -depth[kept], worst[:, kept])


def _halved(level: tuple[Array, Array], depth: Array, split: Array, side: Array) -> tuple[tuple[Array, Array], Array]:
    lo, hi = level[0][:, split], level[1][:, split]
    sides, n = side[split], np.arange(split.size)
    middle = lo[sides, n] + 0.5 * (hi[sides, n] - lo[sides, n])
    below, above = hi.copy(), lo.copy()
    below[sides, n], above[sides, n] = middle, middle
    return (np.concatenate([lo, above], axis=1), np.concatenate([below, hi], axis=1)), np.tile(depth[split] + 1, 2)


def sharpened(
    measure: Callable[[Array, Array], Array], lo: Array, hi: Array, sides: Array, budget: int,
    values: Array | None = None, near: float = 0.02,
) -> Array:  # fmt: skip
    """Return greatest values (k,) of `measure`, (k, n) bounds over boxes, made sharper by halving the boxes with the
    worst bounds, in turn along `sides`. values: those of the boxes, if they are known. near: boxes within this part of
    the worst bound are halved together."""
    values = measure(lo, hi) if values is None else values
    worst = values.max(axis=1)
    if not sides.size:
        return worst
    turn = np.zeros(lo.shape[1], dtype=int)
    while budget > 0:
        with np.errstate(invalid="ignore"):
            size = np.abs(worst)[:, None]
            chosen = np.flatnonzero(
                (values >= worst[:, None] - near * size).any(axis=0) & np.isfinite(values).all(axis=0)
            )
        chosen = chosen[: max(1, budget // 2)]
        if not chosen.size:
            break
        n = np.arange(chosen.size)
        side = sides[turn[chosen] % sides.size]
        middle = 0.5 * (lo[side, chosen] + hi[side, chosen])
        below, above = hi[:, chosen].copy(), lo[:, chosen].copy()
        below[side, n], above[side, n] = middle, middle
        new_lo, new_hi = np.concatenate([lo[:, chosen], above], axis=1), np.concatenate([below, hi[:, chosen]], axis=1)
        new = np.minimum(measure(new_lo, new_hi), np.tile(values[:, chosen], 2))  # the bound of the parent holds too
        rest = np.delete(np.arange(lo.shape[1]), chosen)
        lo, hi = np.concatenate([lo[:, rest], new_lo], axis=1), np.concatenate([hi[:, rest], new_hi], axis=1)
        values = np.concatenate([values[:, rest], new], axis=1)
        turn = np.concatenate([turn[rest], np.tile(turn[chosen] + 1, 2)])
        worst = values.max(axis=1)
        budget -= 2 * chosen.size
    return worst


def least_singular(prover: Prover, leaves: Leaves, chosen: Array, budget: int) -> float:
    """Return a lower bound of the smallest singular value over the chosen boxes, which a prover gives, negative, as the
    last row of `worst`."""
    lo, hi = leaves.lo[:, chosen], leaves.hi[:, chosen]
    sides = np.flatnonzero((hi > lo).any(axis=1))

    def measure(lo: Array, hi: Array) -> Array:
        return prover.decide(lo, hi).worst[-1:]

    return float(-sharpened(measure, lo, hi, sides, budget, leaves.worst[-1:, chosen], near=0.5)[0])


def _look(prover: Prover, points: Array, violated: list[Array | None]) -> None:
    """Evaluate points, and keep for each claim the first one that violates it."""
    if all(v is not None for v in violated) or not points.shape[1]:
        return
    states = prover.at(points)
    for k, row in enumerate(states):
        if violated[k] is None and (row < 0).any():
            violated[k] = points[:, int(np.argmax(row < 0))].copy()


def _corners(lo: Array, hi: Array) -> Array:
    """The corners of a box with up to eight different sides; else the two ends."""
    sides = np.flatnonzero(hi > lo)
    if len(sides) > 8:
        return np.stack([lo, hi], axis=1)
    corners = np.tile(lo[:, None], 2 ** len(sides))
    for k, side in enumerate(sides):
        corners[side, np.arange(corners.shape[1]) >> k & 1 == 1] = hi[side]
    return corners
