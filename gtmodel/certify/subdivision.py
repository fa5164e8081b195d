"""Boxes cut in halves until every one is decided: all boxes of one level at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from functools import partial
from typing import Protocol

import numpy as np

from ..results.refusal import ArgumentError
from ..workers.mapped import mapped
from .certificate import PROVED, REFUTED, UNDECIDED
from .claims import Claim
from .intervals import Array

# shortest side of a box, relative to the whole: shorter ones hold few numbers in double
SHORTEST = 2.0**-30
BLOCK = 1024  # boxes that are decided together: between two checks of time and stop, and in one worker


@dataclass(frozen=True)
class Decision:
    """For boxes: `states` (claims, n) 1, 0 or -1, `side` (n,) along which to halve, -1 for none, and `worst`, numbers
    (k, n) whose greatest over all boxes are reported as bounds."""

    states: Array
    side: Array
    worst: Array


class Prover(Protocol):
    """A function with its claims. `decide` judges boxes lo, hi (inputs, n) for every point in them, parts of a box with
    the widths `whole` (inputs,); `at` judges points by evaluation: states (claims, n). `settled` returns the states of
    all boxes together, undecided for those that do not fit one another."""

    @property
    def claims(self) -> Sequence[Claim]: ...
    def decide(self, lo: Array, hi: Array, whole: Array) -> Decision: ...
    def at(self, points: Array) -> Array: ...
    def settled(self, lo: Array, hi: Array, states: Array, worst: Array) -> Array: ...


@dataclass
class Leaves:
    """Decided boxes, and those that were left undecided: lo, hi (inputs, n), `states` (claims, n), `share` (n,) of the
    whole volume, `worst` (k, n). `examined` boxes in all; `violated`: for each claim a point (inputs,) that violates
    it, found by evaluation, or None. `complete`: the work was not stopped. `cuts`: see `Cuts`."""

    lo: Array
    hi: Array
    states: Array
    share: Array
    worst: Array
    examined: int = 0
    violated: list[Array | None] = field(default_factory=list)
    complete: bool = True
    cuts: str = ""

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


class Cuts:
    """How a box was halved, level by level: "." for each box that was kept, else its side as a letter from A. The lower
    halves of a level come before the upper ones. Raises ArgumentError for another text."""

    def __init__(self, text: str, inputs: int) -> None:
        self.sides = np.array([ord(c) - ord("A") if c != "." else -1 for c in text], dtype=int)
        if ((self.sides < -1) | (self.sides >= inputs)).any():
            raise ArgumentError("these are not the cuts of an earlier certificate of this function", "cuts")
        self.lower, self.upper = (np.full(len(text), -1) for _ in range(2))
        first, count = 0, 1
        while count and len(text):
            cut = first + np.flatnonzero(self.sides[first : first + count] >= 0)
            first += count
            if first + 2 * cut.size > len(text):
                raise ArgumentError("the cuts of the earlier certificate are cut short", "cuts")
            self.lower[cut] = first + np.arange(cut.size)
            self.upper[cut] = first + cut.size + np.arange(cut.size)
            count = 2 * cut.size
        if first != len(text):
            raise ArgumentError("the cuts of the earlier certificate are longer than its boxes", "cuts")

    def of(self, which: Array) -> Array:
        """Return the sides along which earlier boxes were cut, -1 if not; `which` is -1 for others."""
        return np.where(which >= 0, self.sides[which], -1) if self.sides.size else np.full(which.shape, -1)


def subdivide(
    prover: Prover, lo: Array, hi: Array, max_boxes: int,
    going: Callable[[float, int], bool] = lambda share, boxes: True, whole: bool = False, cuts: str = "",
) -> Leaves:  # fmt: skip
    """Decide a box lo, hi (inputs,) by halving what is undecided.

    At most `max_boxes` boxes are examined; `going` is called with the decided share and the number of boxes, False
    ends the work. What is then left is undecided. `whole`: end as soon as the whole box cannot be proved. `cuts`: of
    an earlier run, whose boxes are decided again without those that it halved; the result is that of one run.
    """
    claims, earlier = len(prover.claims), Cuts(cuts, len(lo))
    level, depth, which = (lo[:, None].copy(), hi[:, None].copy()), np.zeros(1), np.zeros(1, dtype=int)
    parts: list[Leaves] = []
    violated: list[Array | None] = [None] * claims
    _look(prover, _corners(lo, hi), violated)
    examined, share, complete, text = 0, 0.0, True, list[str]()
    while depth.size:
        known = earlier.of(which)
        decision, ended = _decided(prover, level, hi - lo, known, lambda n: going(share, examined + n))  # noqa: B023
        complete &= not ended
        examined += depth.size
        states = decision.states
        done = ((states > 0).all(axis=0) | (states < 0).any(axis=0)) & (known < 0)
        middle = level[0] + 0.5 * (level[1] - level[0])
        _look(prover, middle[:, ~(states > 0).all(axis=0)], violated)
        stuck = (decision.side < 0) & ~done
        split = np.flatnonzero(~done & ~stuck)
        kept = done | stuck
        more = split.size > 0 and going(share + float((2.0 ** -depth[done]).sum()), examined)
        more &= not ended
        if whole and (stuck.any() or (states < 0).any() or any(v is not None for v in violated)):
            split = split[:0]
        elif not more or examined + 2 * split.size > max_boxes:
            complete = complete and (more or not split.size)
            split = split[known[split] >= 0]  # an earlier run got that far
        kept = np.ones(depth.size, dtype=bool)
        kept[split] = False
        parts.append(_leaves(level, states, depth, decision.worst, kept))
        text.append("".join("." if k else chr(ord("A") + s) for k, s in zip(kept, decision.side, strict=True)))
        share += float((2.0 ** -depth[done]).sum())
        which = _followers(earlier, which[split])
        level, depth = _halved(level, depth, split, decision.side)
    parts = [p for p in parts if p.lo.shape[1]]
    low, high, states, worst = (
        np.concatenate([getattr(p, n) for p in parts], axis=1) for n in ("lo", "hi", "states", "worst")
    )
    states = prover.settled(low, high, states, worst)
    shares = np.concatenate([p.share for p in parts])
    return Leaves(low, high, states, shares, worst, examined, violated, complete, "".join(text))


def common_faces(lo: Array, hi: Array) -> tuple[Array, Array]:
    """Return the pairs (2, n) of boxes lo, hi (inputs, boxes) that have a part of a face in common, and the middle of
    that part (inputs, n). Sides without width count as covered."""
    pairs, points = [np.zeros((2, 0), dtype=int)], [np.zeros((len(lo), 0))]
    for side in np.flatnonzero((hi > lo).any(axis=1)):
        ends, starts = (np.argsort(x[side], kind="stable") for x in (hi, lo))
        for plane in np.intersect1d(hi[side], lo[side]):
            below, above = (
                order[np.searchsorted(x[side][order], plane) : np.searchsorted(x[side][order], plane, "right")]
                for order, x in ((ends, hi), (starts, lo))
            )
            for first in range(0, below.size, BLOCK):
                some = below[first : first + BLOCK]
                low = np.maximum(lo[:, some, None], lo[:, None, above])
                high = np.minimum(hi[:, some, None], hi[:, None, above])
                flat = (hi == lo).all(axis=1)
                touching = (high > low) | (flat[:, None, None] & (high == low))
                touching[side] = True
                i, j = np.nonzero(touching.all(axis=0))
                middle = low[:, i, j] + 0.5 * (high[:, i, j] - low[:, i, j])
                middle[side] = plane
                pairs.append(np.stack([some[i], above[j]]))
                points.append(middle)
    return np.concatenate(pairs, axis=1), np.concatenate(points, axis=1)


def _followers(earlier: Cuts, which: Array) -> Array:
    if not earlier.sides.size:
        return np.full(2 * which.size, -1)
    return np.concatenate([np.where(which >= 0, x[which], -1) for x in (earlier.lower, earlier.upper)])


def _decided(
    prover: Prover, level: tuple[Array, Array], whole: Array, known: Array, going: Callable[[int], bool]
) -> tuple[Decision, bool]:
    """Decide the boxes of a level that were not cut before, block by block, in workers if there are some; when the work
    ends, the rest stays open. Returns also whether it ended."""
    lo, hi = level
    new = np.flatnonzero(known < 0)
    blocks = [new[k : k + BLOCK] for k in range(0, new.size, BLOCK)]
    claims = len(prover.claims)
    states, side, worst = np.zeros((claims, known.size), dtype=int), known.copy(), np.zeros((0, known.size))
    task = partial(_block, prover, whole)
    parts: list[Decision] = []
    # the same blocks with any number of workers, so that results have the same bytes
    boxes = ((lo[:, b], hi[:, b]) for b in blocks)
    with closing(mapped(task, boxes, waiting=lambda: not going(len(parts) * BLOCK))) as made:
        for part in made:
            parts.append(part)
            if len(parts) < len(blocks) and not going(len(parts) * BLOCK):
                break
    if blocks and not parts:
        parts.append(task((lo[:, blocks[0]], hi[:, blocks[0]])))
    for n, (b, part) in enumerate(zip(blocks, parts, strict=False)):
        worst = np.zeros((len(part.worst), known.size)) if n == 0 else worst
        states[:, b], side[b], worst[:, b] = part.states, part.side, part.worst
    return Decision(states, side, worst), len(parts) < len(blocks)


def _block(prover: Prover, whole: Array, box: tuple[Array, Array]) -> Decision:
    return prover.decide(*box, whole)


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
    worst: np.ndarray = values.max(axis=1)
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
    sizes = (hi - lo).max(axis=1)
    sides = np.flatnonzero(sizes > 0)

    def measure(lo: Array, hi: Array) -> Array:
        return prover.decide(lo, hi, sizes).worst[-1:]

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
