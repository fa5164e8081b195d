"""Block structure of the normal equations: position of every instance, and sums of products over groups of
observations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ...results.refusal import ArgumentError
from .residual_block import ResidualBlock, UnknownGroup

LONG = 12  # average group size above which one product per group is faster than one per member
PIECE = 1 << 22  # numbers of products in memory at a time


class GroupedSums:
    """Sums over members with equal integer `keys` (n,); `unique` (k,) are the keys in ascending order."""

    def __init__(self, keys: np.ndarray) -> None:
        ordered = bool(np.all(keys[1:] >= keys[:-1])) if len(keys) else True
        self.order = None if ordered else np.argsort(keys, kind="stable")
        rising = keys if self.order is None else keys[self.order]
        first = np.flatnonzero(np.concatenate([[True], rising[1:] != rising[:-1]])) if len(keys) else np.zeros(0, int)
        self.edges = np.append(first, len(keys))
        self.unique = rising[first]

    def products(
        self, A: np.ndarray, B: np.ndarray, a: np.ndarray | None = None, b: np.ndarray | None = None
    ) -> np.ndarray:
        """Return sums (k, p, q) of A[a[n]]' B[b[n]] over the members n of each group; A (., m, p), B (., m, q), and
        a[n] = b[n] = n if left out."""
        out = np.empty((len(self.unique), A.shape[2], B.shape[2]))
        n = self.edges[-1]
        if not n:
            return out
        a = self.order if a is None else a if self.order is None else a[self.order]
        b = self.order if b is None else b if self.order is None else b[self.order]
        members = max(PIECE // (A.shape[2] * B.shape[2]), 1)
        many = n > LONG * len(self.unique)
        begin = 0
        while begin < len(self.unique):
            end = int(np.searchsorted(self.edges, self.edges[begin] + members, side="right")) - 1
            end = min(max(end, begin + 1), len(self.unique))
            rows = slice(self.edges[begin], self.edges[end])
            A_rows, B_rows = A[rows] if a is None else A[a[rows]], B[rows] if b is None else B[b[rows]]
            starts = self.edges[begin : end + 1] - self.edges[begin]
            if many:
                p, q, m = A.shape[2], B.shape[2], A.shape[1]
                flat_A, flat_B = A_rows.reshape(-1, p), B_rows.reshape(-1, q)
                for k in range(end - begin):
                    part = slice(starts[k] * m, starts[k + 1] * m)
                    np.matmul(flat_A[part].T, flat_B[part], out=out[begin + k])
            else:
                members_products = np.matmul(A_rows.transpose(0, 2, 1), B_rows)
                np.add.reduceat(members_products, starts[:-1], axis=0, out=out[begin:end])
            begin = end
        return out

    def sums(self, values: np.ndarray) -> np.ndarray:
        """Return sums (k, ...) of values (n, ...)."""
        ordered = values if self.order is None else values[self.order]
        if not len(self.unique):
            return np.zeros((0, *values.shape[1:]))
        return np.add.reduceat(ordered, self.edges[:-1], axis=0)


HEAVY = 32  # shared instances per local one above which its part of S is formed separately: memory stays linear


@dataclass(eq=False)
class SplitRows:
    """Observations of a block that depend on the same kinds of unknowns, sorted by local instance. pick: their numbers
    in the block. shared: pairs (argument of the function, instance (n,)); local: one such pair or None."""

    block: ResidualBlock
    pick: np.ndarray
    shared: list[tuple[int, np.ndarray]]
    local: tuple[int, np.ndarray] | None


@dataclass(eq=False)
class CouplingEntries:
    """Blocks W of one width. instance (e,): shared instance; of (e,): its local instance; sums: (rows, argument) ->
    sums over observations and their target entries."""

    instance: np.ndarray
    of: np.ndarray
    by_instance: GroupedSums
    by_local: GroupedSums
    sums: dict[tuple[int, int], tuple[GroupedSums, np.ndarray]] = field(default_factory=dict)


@dataclass(eq=False)
class Structure:
    """Layout of the normal equations. Shared instances are numbered group by group, followed by kept local ones;
    offset, width (instances,): their columns. keys: pairs of instances with a block in S, by the pair of widths."""

    groups: dict[str, UnknownGroup]
    rows: list[SplitRows]
    local: UnknownGroup | None
    kept: np.ndarray  # local instances kept with the shared ones
    eliminated: np.ndarray  # other local instances
    owner: list[tuple[str, int]]  # group of each shared instance and its number there
    width: np.ndarray
    offset: np.ndarray
    entries: dict[int, CouplingEntries]
    keys: dict[tuple[int, int], np.ndarray]
    direct: list[DirectProducts]
    local_sums: dict[int, GroupedSums]
    shared_sums: dict[tuple[int, int], GroupedSums]
    pairs: list[EntryPairs]
    heavy: np.ndarray

    @cached_property
    def numbers(self) -> dict[str, list[int]]:
        """Shared instances of each group."""
        return {name: [k for k, (group, _) in enumerate(self.owner) if group == name] for name in self.groups}

    @property
    def columns(self) -> int:
        """Number of degrees of freedom that are not eliminated."""
        return int(self.width.sum())


@dataclass(eq=False)
class EntryPairs:
    """Pairs of entries of the same local instance, with the widths `kinds`: positions a and b in their CouplingEntries,
    sums over equal keys, and the target of each sum."""

    kinds: tuple[int, int]
    a: np.ndarray
    b: np.ndarray
    sums: GroupedSums
    to: np.ndarray


@dataclass(eq=False)
class DirectProducts:
    """Products J_k' J_m of two arguments of one block of rows, for the observations `chosen` (None: all), instances in
    ascending order, and the target of each sum."""

    rows: int
    k: int
    m: int
    chosen: np.ndarray | None
    kinds: tuple[int, int]
    sums: GroupedSums
    to: np.ndarray = field(default_factory=lambda: np.zeros(0, int))


def structure(groups: Sequence[UnknownGroup], blocks: Sequence[ResidualBlock], dense: bool | None = None) -> Structure:
    """Make the structure. Raises ArgumentError for unknown names or numbers, and for more than one local group."""
    by_name = {g.name: g for g in groups}
    if len(by_name) < len(groups) or len({k for g in groups for k in g.keys}) < sum(g.count for g in groups):
        raise ArgumentError("two groups or two instances of unknowns have the same name; make the names different")
    locals_ = [g for g in groups if g.local]
    if len(locals_) > 1:
        raise ArgumentError(f"{' and '.join(g.name for g in locals_)} are both local; only one group can be")
    local = locals_[0] if locals_ else None
    kept = np.zeros(local.count if local else 0, bool)
    for block in blocks:
        for name, index in block.seen:
            if name not in by_name:
                raise ArgumentError(f"'{block.name}' sees unknown group '{name}'; expected one of {', '.join(by_name)}")
            if len(index) and not 0 <= index.min() <= index.max() < by_name[name].count:
                raise ArgumentError(
                    f"'{block.name}' sees instance {index.max()} of '{name}', which has {by_name[name].count}"
                )
        for a, (name, i) in enumerate(block.seen):
            for other, j in block.seen[a + 1 :]:
                if name == other and np.any(i == j):
                    raise ArgumentError(f"'{block.name}' sees an instance of '{name}' twice; name it only once")
        indices = [i for name, i in block.seen if local and name == local.name]
        for other in indices[1:]:
            kept[indices[0]] = True
            kept[other] = True
    owner = [(g.name, k) for g in groups if not g.local for k in range(g.count)]
    first = {}
    for number, (name, _) in enumerate(owner):
        first.setdefault(name, number)
    place = np.full(len(kept), -1)
    if local is not None:
        place[kept] = len(owner) + np.arange(kept.sum())
        owner += [(local.name, int(k)) for k in np.flatnonzero(kept)]
    width = np.array([by_name[name].moves for name, _ in owner], int)
    offset = np.concatenate([[0], np.cumsum(width)])[:-1]
    eliminated = np.flatnonzero(~kept)
    slot = np.cumsum(~kept) - 1
    rows = [r for block in blocks for r in _split(block, local, kept, place, slot, first)]
    s = Structure(by_name, rows, local, np.flatnonzero(kept), eliminated, owner, width, offset, {}, {}, [], {}, {}, [],
                  np.zeros(0, int))  # fmt: skip
    _entries(s)
    _pairs(s, heavy_alone=dense is not False)
    return s


def _split(block: ResidualBlock, local: UnknownGroup | None, kept: np.ndarray, place: np.ndarray, slot: np.ndarray,
           first: dict[str, int]) -> list[SplitRows]:  # fmt: skip
    mine = [k for k, (name, _) in enumerate(block.seen) if local is not None and name == local.name]
    # mask of the observations whose local instance is eliminated
    gone = np.any([~kept[block.seen[k][1]] for k in mine], axis=0) if mine else np.zeros(block.n, bool)
    parts: list[SplitRows] = []
    for eliminates in (True, False):
        pick = np.flatnonzero(gone == eliminates)
        if not len(pick):
            continue
        if eliminates:
            pick = pick[np.argsort(slot[block.seen[mine[0]][1][pick]], kind="stable")]
        shared = [
            (k, place[i[pick]] if k in mine else first[name] + i[pick])
            for k, (name, i) in enumerate(block.seen)
            if not (eliminates and k in mine)
        ]
        parts.append(
            SplitRows(block, pick, shared, (mine[0], slot[block.seen[mine[0]][1][pick]]) if eliminates else None)
        )
    return parts


def _entries(s: Structure) -> None:
    """Make the blocks of W, and the sums for them, for V and for the gradients."""
    keys_by_width: dict[int, list[np.ndarray]] = {}
    n = len(s.owner)
    for number, r in enumerate(s.rows):
        for k, instance in r.shared:
            s.shared_sums[number, k] = GroupedSums(instance)
            if r.local is not None and len(instance):
                keys_by_width.setdefault(int(s.width[instance[0]]), []).append(r.local[1] * n + instance)
        if r.local is not None:
            s.local_sums[number] = GroupedSums(r.local[1])
    for width, keys in keys_by_width.items():
        unique = np.unique(np.concatenate(keys))
        s.entries[width] = CouplingEntries(unique % n, unique // n, GroupedSums(unique % n), GroupedSums(unique // n))
    for number, r in enumerate(s.rows):
        for k, instance in r.shared:
            if r.local is not None and len(instance):
                e = s.entries[int(s.width[instance[0]])]
                sums = GroupedSums(r.local[1] * n + instance)
                e.sums[number, k] = sums, np.searchsorted(e.of * n + e.instance, sums.unique)


def _pairs(s: Structure, heavy_alone: bool) -> None:
    n = len(s.owner)
    keys: dict[tuple[int, int], list[np.ndarray]] = {}
    direct: list[tuple[DirectProducts, np.ndarray]] = []
    for number, r in enumerate(s.rows):
        for place, (k, i) in enumerate(r.shared):
            for m, j in r.shared[place:]:
                for first, second, chosen in _ordered(k, i, m, j):
                    instances, others = dict(r.shared)[first][chosen], dict(r.shared)[second][chosen]
                    if not len(instances):
                        continue
                    kinds, key = (int(s.width[instances[0]]), int(s.width[others[0]])), instances * n + others
                    d = DirectProducts(
                        number, first, second, None if isinstance(chosen, slice) else chosen, kinds, GroupedSums(key)
                    )
                    keys.setdefault(kinds, []).append(d.sums.unique)
                    direct.append((d, d.sums.unique))
    degree = np.zeros(len(s.eliminated), int)
    for e in s.entries.values():
        degree += np.bincount(e.of, minlength=len(degree))
    s.heavy = np.flatnonzero(degree > HEAVY) if heavy_alone else np.zeros(0, int)
    light = np.ones(len(degree), bool)
    light[s.heavy] = False
    lists: list[tuple[tuple[int, int], np.ndarray, np.ndarray, np.ndarray]] = []
    for wa, ea in s.entries.items():
        for wb, eb in s.entries.items():
            a, b = _meeting(ea, eb, len(degree), light)
            forward = ea.instance[a] <= eb.instance[b] if wa == wb else ea.instance[a] < eb.instance[b]
            a, b = a[forward], b[forward]
            if len(a):
                key = ea.instance[a] * n + eb.instance[b]
                lists.append(((wa, wb), a, b, key))
                keys.setdefault((wa, wb), []).append(np.unique(key))
    s.keys = {kinds: np.unique(np.concatenate(k)) for kinds, k in keys.items()}
    for d, unique in direct:
        d.to = np.searchsorted(s.keys[d.kinds], unique)
        s.direct.append(d)
    for kinds, a, b, key in lists:
        sums = GroupedSums(key)
        order = slice(None) if sums.order is None else sums.order
        a, b = a[order], b[order]
        sums.order = None
        s.pairs.append(EntryPairs(kinds, a, b, sums, np.searchsorted(s.keys[kinds], sums.unique)))


def _ordered(k: int, i: np.ndarray, m: int, j: np.ndarray) -> list[tuple[int, int, slice | np.ndarray]]:
    """Arguments ordered such that the first has the lower instance number, with the observations for each order."""
    if k == m or np.all(i < j):
        return [(k, m, slice(None))]
    if np.all(j < i):
        return [(m, k, slice(None))]
    return [(k, m, np.flatnonzero(i < j)), (m, k, np.flatnonzero(j < i))]


def _meeting(a: CouplingEntries, b: CouplingEntries, locals_: int, light: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """All pairs of entries of a and b with the same local instance, sorted by it."""
    many_a, many_b = np.bincount(a.of, minlength=locals_) * light, np.bincount(b.of, minlength=locals_) * light
    start_a = np.concatenate([[0], np.cumsum(np.bincount(a.of, minlength=locals_))])[:-1]
    start_b = np.concatenate([[0], np.cumsum(np.bincount(b.of, minlength=locals_))])[:-1]
    total = many_a * many_b
    local = np.repeat(np.arange(locals_), total)
    within = np.arange(total.sum()) - np.repeat(np.cumsum(total) - total, total)
    first, second = np.divmod(within, np.maximum(many_b[local], 1))
    return start_a[local] + first, start_b[local] + second
