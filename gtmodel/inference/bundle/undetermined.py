"""Undetermined directions, in which no residual changes: their number and their names."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from ..._pickling import Portable
from ..covariance import listed
from .elimination import SILENT, BlockDirections, ReducedEquations
from .residual_block import Linearised
from .structure import Structure

SHOWN, PART = 6, 0.05  # names in a sentence, and their least share of the largest entry


@dataclass(frozen=True, eq=False)
class GaugeMotion(Portable):
    """A motion of unknowns that may leave all residuals unchanged.

    words: description, "all cameras and points move together along x"; remedy: "fix a camera". direction: values by
    group -> increments (count, moves) by group; groups without an entry do not move.

    >>> shift = gt.inference.bundle.GaugeMotion("all marks move together", "fix one of them",
    ...     lambda values: {"mark": np.ones_like(values["mark"])})
    >>> shift.direction({"mark": np.array([[1.0], [4.0]])})["mark"].ravel()
    array([1., 1.])
    """

    words: str
    remedy: str
    direction: Callable[[Mapping[str, np.ndarray]], Mapping[str, np.ndarray]]


def column_lengths(r: ReducedEquations, V: np.ndarray) -> np.ndarray:
    """Lengths of all columns of J, shared then local; one for zero columns."""
    local = np.sqrt(np.einsum("bii->bi", V)).reshape(-1)
    both = np.concatenate([r.scale, local])
    return np.where(both > 0, both, 1.0)


def null_space(
    s: Structure, rows: Sequence[Linearised], r: ReducedEquations, V: np.ndarray, faint: BlockDirections
) -> BlockDirections:
    """Directions of free unknowns in which no residual changes, from the `faint` ones of S and from single unknowns;
    orthogonal in units of the column lengths."""
    free = np.concatenate([*(s.groups[n].free[k] for n, k in s.owner), np.zeros(0, bool)])
    unseen = np.flatnonzero((r.scale == 0) & free)
    unit = np.zeros((s.columns, len(unseen)))
    unit[unseen, np.arange(len(unseen))] = 1.0
    candidates = faint.then(BlockDirections(unit, np.zeros((len(s.eliminated), V.shape[1], len(unseen)))))
    candidates = candidates.then(_weak(s, r))
    return _silent(s, rows, candidates, column_lengths(r, V))


def _weak(s: Structure, r: ReducedEquations) -> BlockDirections:
    """Directions within single local instances that their residuals do not determine."""
    directions: list[tuple[int, np.ndarray]] = []
    if r.weak is not None and s.local is not None:
        for b in np.flatnonzero(np.abs(r.weak).max(axis=(1, 2)) > 0):
            free = s.local.free[s.eliminated[b]]
            U, sizes, _ = np.linalg.svd(r.weak[b] * free[:, None])
            directions += [(int(b), U[:, k]) for k in np.flatnonzero(sizes > 1e-6 * max(sizes[0], 1e-300))]
    z = np.zeros((*r.h.shape, len(directions)))
    for k, (b, v) in enumerate(directions):
        z[b, :, k] = v
    return BlockDirections(np.zeros((s.columns, len(directions))), z)


def _silent(s: Structure, rows: Sequence[Linearised], n: BlockDirections, lengths: np.ndarray) -> BlockDirections:
    """Combinations of these directions in which no residual changes."""
    if not n.count:
        return n
    _, sizes, Vt = np.linalg.svd(n.flat(lengths), full_matrices=False)
    nonzero = sizes > 1e-10 * sizes[0]
    n = n.of(Vt[nonzero].T / sizes[nonzero])
    n, sizes = n.by_length(s, rows)
    return n.of(np.eye(n.count)[:, sizes <= SILENT])


def null_words(s: Structure, rows: Sequence[Linearised], n: BlockDirections, motions: Sequence[GaugeMotion],
               values: Mapping[str, np.ndarray], lengths: np.ndarray) -> list[str]:  # fmt: skip
    """A sentence per direction: gauge motions by name with their remedy, then the others by their unknowns."""
    if not n.count:
        return []
    sentences, known = [], np.zeros((len(lengths), 0))
    basis = np.linalg.qr(n.flat(lengths))[0]
    moving = [m for m in motions if m.direction(values)]
    parts = [_of_motion(s, m.direction(values)) for m in moving]
    single = []
    for m, (part, moves_fixed) in zip(moving, parts, strict=True):
        flat = part.flat(lengths)[:, 0]
        size = np.linalg.norm(flat)
        if size > 0 and not moves_fixed and np.linalg.norm(flat - basis @ (basis.T @ flat)) <= 1e-5 * size:
            single.append(m)
            sentences.append(f"{m.words}: {m.remedy}")
            known = np.column_stack([known, flat / size])
    if parts:
        every = np.column_stack([p.flat(lengths)[:, 0] for p, _ in parts])
        every = every / np.maximum(np.linalg.norm(every, axis=0), 1e-300)
        inside = np.linalg.svd(basis.T @ np.linalg.qr(every)[0])
        common = basis @ inside[0][:, : len(inside[1])][:, inside[1] > 1 - 1e-9]
        extra = _rest(common, known)
        for v in extra.T:
            weights = np.linalg.lstsq(every, v, rcond=None)[0]
            involved = [m for m, w in zip(moving, weights, strict=True) if abs(w) > PART * np.abs(weights).max()]
            remedies = list(dict.fromkeys(m.remedy for m in involved))
            sentences.append(
                f"a combination of motions is free ({'; '.join(m.words for m in involved)}): {' or '.join(remedies)}"
            )
        known = np.column_stack([known, extra])
    names = _names(s)
    for v in _rest(basis, known).T:
        size = np.abs(v)
        involved = [names[k] for k in np.flatnonzero(size > PART * size.max())]
        if len(involved) == 1:
            sentences.append(f"the data do not determine {involved[0]}: no measurement depends on it")
            continue
        more = f" and {len(involved) - SHOWN} more" if len(involved) > SHOWN else ""
        unknowns = ", ".join(involved[:SHOWN]) + more if more else listed(involved)
        sentences.append(
            f"the data do not determine {unknowns} apart from each other: fix one, or measure something that depends "
            "on only one of them"
        )
    return sentences


def _rest(basis: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Basis of the part of `basis` orthogonal to `known`, as sparse as possible."""
    if known.shape[1]:
        Q = np.linalg.qr(known)[0]
        basis = basis - Q @ (Q.T @ basis)
    U, sizes, _ = np.linalg.svd(basis, full_matrices=False)
    rest = U[:, sizes > 1e-4]
    if rest.shape[1] > 1:  # row reduction with pivots separates directions of different unknowns
        _, _, order = scipy.linalg.qr(rest.T, pivoting=True, mode="economic")
        pivots = np.sort(order[: rest.shape[1]])
        rest = rest @ np.linalg.inv(rest[pivots])
        rest = rest / np.linalg.norm(rest, axis=0)
    return rest


def _of_motion(s: Structure, direction: Mapping[str, np.ndarray]) -> tuple[BlockDirections, bool]:
    """A motion as one direction, and whether it moves fixed unknowns."""
    x = np.zeros((s.columns, 1))
    z = np.zeros((len(s.eliminated), s.local.moves if s.local is not None else 0, 1))
    moves_fixed = False
    for name, step in direction.items():
        g = s.groups[name]
        moves_fixed |= bool(np.any(np.abs(step[~g.free]) > 1e-9 * np.abs(step).max(initial=0.0)))
        if g is s.local:
            z[:, :, 0] = step[s.eliminated]
        for number in s.numbers[name]:
            x[s.offset[number] : s.offset[number] + g.moves, 0] = step[s.owner[number][1]]
    return BlockDirections(x, z), moves_fixed


def _names(s: Structure) -> list[str]:
    names = [f"{s.groups[n].keys[k]}.{label}" for n, k in s.owner for label in s.groups[n].move_labels]
    if s.local is not None:
        names += [f"{s.local.keys[k]}.{label}" for k in s.eliminated for label in s.local.move_labels]
    return names
