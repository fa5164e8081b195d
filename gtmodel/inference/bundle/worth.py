"""What a fit with local unknowns is worth: covariance of what is shared and of what is local, and the null space."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...results.estimate import Estimate
from ...results.refusal import ArgumentError
from .elimination import BlockDirections, ReducedEquations, normal_equations, reduced
from .residual_block import BlockEvaluation, Linearised
from .shared_step import faint, solver
from .structure import Structure
from .undetermined import GaugeMotion, column_lengths, null_space, null_words

PART = 1e-8  # of a null direction in units of the scales: smaller entries are rounding


@dataclass(eq=False)
class Worth:
    """At the optimum: `C` (columns, columns) covariance of the increments of the shared unknowns, `factor` what it was
    multiplied by, the `words` on the null space."""

    s: Structure
    reduced: ReducedEquations
    C: np.ndarray
    factor: float
    null: np.ndarray
    words: list[str]
    estimate: Estimate

    def _coupling(self, b: int) -> tuple[np.ndarray, np.ndarray]:
        """Columns (k,) that local instance b meets, and W B of them (k, l)."""
        at, parts = [], []
        for width, e in self.s.entries.items():
            mine = slice(*np.searchsorted(e.of, [b, b + 1]))
            at.append((self.s.offset[e.instance[mine]][:, None] + np.arange(width)).reshape(-1))
            parts.append(self.reduced.Y[width][mine].reshape(-1, self.reduced.Y[width].shape[2]))
        l = self.reduced.roots.shape[1]
        return np.concatenate([*at, np.zeros(0, int)]).astype(int), np.concatenate([*parts, np.zeros((0, l))])

    @cached_property
    def local_covariance(self) -> np.ndarray:
        """See BundleFit."""
        s = self.s
        if s.local is None:
            raise ArgumentError("there are no local unknowns")
        out = np.full((s.local.count, s.local.moves, s.local.moves), np.nan)
        for b, k in enumerate(s.eliminated):
            out[k] = self._local(b)
        return out

    def _local(self, b: int) -> np.ndarray:
        at, Y = self._coupling(b)
        inner = self.factor * np.eye(Y.shape[1]) + Y.T @ self.C[np.ix_(at, at)] @ Y
        B = self.reduced.roots[b]
        return B @ inner @ B.T

    def joint(self, instance: int) -> np.ndarray:
        """See BundleFit."""
        place = np.flatnonzero(self.s.eliminated == instance)
        if not len(place):
            raise ArgumentError(f"there is no eliminated instance {instance}")
        at, Y = self._coupling(int(place[0]))
        cross = -self.C[:, at] @ Y @ self.reduced.roots[place[0]].T
        return np.block([[self.C, cross], [cross.T, self._local(int(place[0]))]])


def worth_of(s: Structure, blocks: Sequence[BlockEvaluation], values: Mapping[str, np.ndarray],
             motions: Sequence[GaugeMotion], dense: bool | None) -> Worth:  # fmt: skip
    """Raises ArgumentError for as many unknowns as measured values, where the noise is not known."""
    rows = [b.linearised(values, robust=False) for b in blocks]
    n = normal_equations(s, rows)
    r = reduced(s, n, 0.0, dense)
    weak, sizes = faint(s, rows, r)
    null = null_space(s, rows, r, n.V, weak)
    lengths = column_lengths(r, n.V)
    words = null_words(s, rows, null, motions, values, lengths)
    free = np.concatenate([*(s.groups[name].free[k] for name, k in s.owner), np.zeros(0, bool)])
    unknowns = int(free.sum()) + (int(s.local.free[s.eliminated].sum()) if s.local is not None else 0) - null.count
    measured = sum(lin.r.size for lin in rows)
    known, dof = blocks[0].known, float(measured - unknowns)
    if dof < 0 or (dof == 0 and not known):
        raise ArgumentError(f"{measured} measured values for {unknowns} unknowns; measure more, or give sigma")
    C, factor = solver(r, weak, sizes)(np.eye(s.columns)), _noise_factor(blocks, rows, dof, known)
    C = factor * (C + C.T) / 2
    estimate = _estimate(s, values, C, free, null, lengths, rows, dof, known, tuple(words))
    return Worth(s, r, C, factor, null.x, words, estimate)


def _noise_factor(blocks: Sequence[BlockEvaluation], rows: Sequence[Linearised], dof: float, known: bool) -> float:
    """What S^-1 is multiplied by: the residuals' variance where the noise is unknown, Huber's factor under a loss."""
    if all(b.loss.squares for b in blocks):
        return 1.0 if known else sum(float(np.vdot(x.r, x.r)) for x in rows) / dof
    total, sharp, count = 0.0, 0.0, 0
    for b, lin in zip(blocks, rows, strict=True):
        z = np.einsum("ni,ni->n", lin.r, lin.r) / b.block.width**2
        slope, m = b.loss.slope(z), lin.r.shape[1]
        total += float(np.sum(z * slope**2)) * b.block.width**2
        sharp += float(np.sum(m * slope + 2 * z * b.loss.bend(z)))
        count += lin.r.size
    return total / dof / (sharp / count) ** 2


def _estimate(s: Structure, values: Mapping[str, np.ndarray], C: np.ndarray, free: np.ndarray, null: BlockDirections,
              lengths: np.ndarray, rows: Sequence[Linearised], dof: float, known: bool,
              words: tuple[str, ...]) -> Estimate:  # fmt: skip
    names, units, numbers = [], [], []
    turn = np.eye(s.columns)
    reported = {name: g.reported(values[name]) for name, g in s.groups.items()}
    for number, (name, k) in enumerate(s.owner):
        g = s.groups[name]
        shown, slopes = reported[name]
        names += [f"{g.keys[k]}.{label}" for label in g.move_labels]
        units += list(g.units) if len(g.units) == g.moves else [""] * g.moves
        numbers.append(shown[k])
        if slopes is not None and g.turn is not None:
            at = slice(s.offset[number] + g.turn, s.offset[number] + g.turn + 3)
            turn[at, at] = slopes[k]
    kept = np.flatnonzero(free)
    x = np.concatenate([*numbers, np.zeros(0)])
    covariance = (turn @ C @ turn.T)[np.ix_(kept, kept)]
    residuals = np.concatenate([lin.r.reshape(-1) for lin in rows])
    noise = float(np.sqrt(residuals @ residuals / dof)) if dof else 1.0
    space = np.zeros((0, 0))
    if null.count:
        along_x = np.where(np.abs(null.x * lengths[: s.columns, None]) > PART, null.x, 0.0)
        along_x = (turn @ along_x)[kept]
        along_x = along_x[:, np.abs(along_x).max(axis=0, initial=0.0) > 0]
        space = along_x if along_x.size else space
    return Estimate(
        tuple(names[k] for k in kept), x[kept], (covariance + covariance.T) / 2, dof, noise, known, residuals, (),
        units=tuple(units[k] for k in kept) if any(units) else (), notes=words, null_space=space,
    )  # fmt: skip
