"""The bundle fit: descent over shared unknowns on the Schur complement of the local ones, and the covariances of
both."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ...results.estimate import Estimate
from ...results.refusal import ArgumentError
from ...results.status import SolveStatus
from ..descent import Descent, DescentStep, minimised
from .elimination import (
    BlockDirections,
    BlockNormal,
    ReducedEquations,
    along,
    faint,
    normal_equations,
    reduced,
    solver,
    step_solver,
)
from .residual_block import BlockEvaluation, Linearised, ResidualBlock, UnknownGroup
from .structure import Structure, structure
from .undetermined import GaugeMotion, column_lengths, null_space, null_words

PART = 1e-8  # of a null direction in units of the scales: smaller entries are round-off


@dataclass(eq=False)
class Worth:
    """Uncertainty at the optimum. C (columns, columns): covariance of the increments of the shared unknowns; factor:
    the noise factor in it; words: sentences on the null space."""

    s: Structure
    reduced: ReducedEquations
    C: np.ndarray
    factor: float
    null: np.ndarray
    words: list[str]
    estimate: Estimate

    def _coupling(self, b: int) -> tuple[np.ndarray, np.ndarray]:
        """Columns (k,) coupled with local instance b, and their rows of W B (k, l)."""
        columns, parts = [], []
        for width, e in self.s.entries.items():
            mine = slice(*np.searchsorted(e.of, [b, b + 1]))
            columns.append((self.s.offset[e.instance[mine]][:, None] + np.arange(width)).reshape(-1))
            parts.append(self.reduced.Y[width][mine].reshape(-1, self.reduced.Y[width].shape[2]))
        l = self.reduced.roots.shape[1]
        return np.concatenate([*columns, np.zeros(0, int)]).astype(int), np.concatenate([*parts, np.zeros((0, l))])

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
        columns, Y = self._coupling(b)
        inner = self.factor * np.eye(Y.shape[1]) + Y.T @ self.C[np.ix_(columns, columns)] @ Y
        B = self.reduced.roots[b]
        return B @ inner @ B.T

    def joint(self, instance: int) -> np.ndarray:
        """See BundleFit."""
        place = np.flatnonzero(self.s.eliminated == instance)
        if not len(place):
            raise ArgumentError(f"there is no eliminated instance {instance}")
        columns, Y = self._coupling(int(place[0]))
        cross = -self.C[:, columns] @ Y @ self.reduced.roots[place[0]].T
        return np.block([[self.C, cross], [cross.T, self._local(int(place[0]))]])


def worth_of(s: Structure, blocks: Sequence[BlockEvaluation], values: Mapping[str, np.ndarray],
             motions: Sequence[GaugeMotion], dense: bool | None) -> Worth:  # fmt: skip
    """Uncertainty at an optimum. Raises ArgumentError if there are too few measured values for the unknowns."""
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
    """Factor on S^-1: the variance of the residuals if the noise is unknown, Huber's factor with a loss."""
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
        instances, slopes = reported[name]
        names += [f"{g.keys[k]}.{label}" for label in g.move_labels]
        units += list(g.units) if len(g.units) == g.moves else [""] * g.moves
        numbers.append(instances[k])
        if slopes is not None and g.turn is not None:
            columns = slice(s.offset[number] + g.turn, s.offset[number] + g.turn + 3)
            turn[columns, columns] = slopes[k]
    shared = np.flatnonzero(free)
    x = np.concatenate([*numbers, np.zeros(0)])
    covariance = (turn @ C @ turn.T)[np.ix_(shared, shared)]
    residuals = np.concatenate([lin.r.reshape(-1) for lin in rows])
    noise = float(np.sqrt(residuals @ residuals / dof)) if dof else 1.0
    space = np.zeros((0, 0))
    if null.count:
        along_x = np.where(np.abs(null.x * lengths[: s.columns, None]) > PART, null.x, 0.0)
        along_x = (turn @ along_x)[shared]
        along_x = along_x[:, np.abs(along_x).max(axis=0, initial=0.0) > 0]
        space = along_x if along_x.size else space
    return Estimate(
        tuple(names[k] for k in shared), x[shared], (covariance + covariance.T) / 2, dof, noise, known, residuals, (),
        units=tuple(units[k] for k in shared) if any(units) else (), notes=words, null_space=space,
    )  # fmt: skip


Values = dict[str, np.ndarray]

DAMPING = 1e-4  # initial damping, relative to the squared lengths of all columns


@dataclass(frozen=True, eq=False)
class BundleFit(Descent):
    """Result of a bundle fit.

    cost: half the sum of squares of the whitened residuals, or of their losses.
    residuals: by block, (n, m), neither whitened nor weighted, in the order of the data.
    estimate: of all shared unknowns, named "instance.label", rotations as rotation vectors [rad]; None unless solved.
    notes: sentences on undetermined directions; undetermined: their number.
    """

    x: Values
    residuals: dict[str, np.ndarray]
    estimate: Estimate | None = None
    notes: tuple[str, ...] = ()
    undetermined: int = 0
    _worth: Worth | None = field(default=None, repr=False)

    @property
    def values(self) -> Values:
        """Values by group, (count, size), including local ones."""
        return self.x

    @property
    def shared_covariance(self) -> np.ndarray:
        """Covariance of the increments of all shared unknowns, group by group, rotations in their own frames; zero for
        fixed entries. Raises ArgumentError unless solved."""
        if self._worth is None:
            raise ArgumentError(f"a fit that is not solved has no covariance: {self.message}")
        return self._worth.C

    @cached_property
    def local_covariance(self) -> np.ndarray:
        """Covariance (count, moves, moves) of the increments of each local instance (rotations in its own frame); NaN
        for instances kept with the shared unknowns. Raises ArgumentError unless solved."""
        if self._worth is None:
            raise ArgumentError(f"a fit that is not solved has no covariance: {self.message}")
        return self._worth.local_covariance

    def joint_covariance(self, instance: int) -> np.ndarray:
        """Return the joint covariance of the increments of all shared unknowns followed by one local instance.

        Raises ArgumentError unless solved.
        """
        if self._worth is None:
            raise ArgumentError(f"a fit that is not solved has no covariance: {self.message}")
        return self._worth.joint(instance)


def bundle_fit(
    groups: Sequence[UnknownGroup],
    blocks: Sequence[ResidualBlock],
    *,
    motions: Sequence[GaugeMotion] = (),
    hold_undetermined: bool = False,
    dense: bool | None = None,
    tolerance: float = 1e-10,
    limit: int = 100,
    covariance: bool = True,
    stop: Callable[[], bool] | None = None,
) -> BundleFit:
    """Solve a least-squares problem with shared and local unknowns; the local ones are eliminated (Schur complement).

    Time and memory are linear in the number of observations.

    groups, blocks: the problem; at most one group is local. motions: names of undetermined directions, see GaugeMotion.
    hold_undetermined: whether to leave undetermined directions unchanged and report them; otherwise they are an error.
    dense: whether S is a dense matrix; by default up to 4,500 columns.
    tolerance: the iteration ends with a step that changes the residuals by a smaller share of their length. limit:
        largest number of steps.
    covariance: whether to form the Estimate.
    stop: called before each step; if it returns True, the fit ends with the best values so far, status INTERRUPTED.

    Source: Brown 1958 and Triggs and others 2000, "Bundle adjustment: a modern synthesis", section 6.1.

    Raises ArgumentError for an inconsistent problem, or for undetermined directions. A failed iteration has its
    `status`.

    >>> import casadi as ca
    >>> z, a, data = ca.SX.sym("z", 2), ca.SX.sym("a"), ca.SX.sym("data", 2)  # lines of one slope through a bend
    >>> f = ca.Function("line", [a, z, data], [z[0] + a * data[0] + z[1] * data[0] ** 2 - data[1]])
    >>> x, which = np.tile(np.linspace(0.0, 1.0, 9), 4), np.repeat(np.arange(4), 9)
    >>> y = 3.0 + 2.0 * x + which * x**2
    >>> B = gt.inference.bundle
    >>> fit = B.bundle_fit(
    ...     [B.UnknownGroup("slope", [[0.0]], ["a"]), B.UnknownGroup("line", np.zeros((4, 2)), ["c", "b"], local=True)],
    ...     [B.ResidualBlock("points", f, [("slope", 0), ("line", which)], np.column_stack([x, y]), sigma=0.1)])
    >>> fit.status.ok, round(fit.estimate.value("slope.a"), 6), fit.values["line"][3].round(6)
    (True, 2.0, array([3., 3.]))
    """
    s = structure(groups, blocks, dense)
    by_name = {g.name: g for g in groups}
    evaluations = [BlockEvaluation(r.block, by_name, r.pick) for r in s.rows]
    if len({e.known for e in evaluations}) > 1:
        names = ", ".join(f"'{e.block.name}'" for e in evaluations if not e.known)
        raise ArgumentError(
            f"the noise of {names} is not stated, but that of other blocks is; give sigma to all blocks or none"
        )
    start = {name: g.start.copy() for name, g in s.groups.items()}
    end = minimised(
        lambda values: _Here(s, dense, values, [e.linearised(values) for e in evaluations]), start, limit=limit,
        tolerance=tolerance, stop=stop, stuck="are the starting values near enough?",
        unended="use a larger limit",
    )  # fmt: skip
    if end.status is SolveStatus.NOT_FINITE:
        end = replace(end, message=_invalid(evaluations, start))
    raw = _residuals(blocks, s, evaluations, end.x)
    if not end.status.ok or not covariance:
        return BundleFit(**vars(end), residuals=raw)
    worth = worth_of(s, evaluations, end.x, motions, dense)
    if worth.words and not hold_undetermined:
        raise ArgumentError("; ".join(worth.words))
    return BundleFit(
        **vars(end), residuals=raw, estimate=worth.estimate, notes=tuple(worth.words),
        undetermined=worth.null.shape[1], _worth=worth,
    )  # fmt: skip


def _residuals(blocks: Sequence[ResidualBlock], s: Structure, evaluations: Sequence[BlockEvaluation],
               values: Values) -> dict[str, np.ndarray]:  # fmt: skip
    out = {b.name: np.zeros((b.n, b.m)) for b in blocks}
    for r, e in zip(s.rows, evaluations, strict=True):
        out[r.block.name][r.pick] = e.raw(values)
    return out


def _invalid(evaluations: Sequence[BlockEvaluation], values: Values) -> str:
    counts = {b.block.name: int(b.invalid(values).sum()) for b in evaluations}
    bad = [f"{k} of '{name}'" for name, k in counts.items() if k]
    return (
        f"at the start {' and '.join(bad)} are outside the range of their model or not finite; give a better start"
        if bad
        else "the derivatives are not finite at the start"
    )


@dataclass(eq=False)
class _Here:
    """Linearised rows at some values, and the steps from there."""

    s: Structure
    dense: bool | None
    values: Values
    rows: list[Linearised]

    @cached_property
    def cost(self) -> float:
        return float(sum(r.cost for r in self.rows))

    @cached_property
    def normal(self) -> BlockNormal:
        return normal_equations(self.s, self.rows)

    @property
    def finite(self) -> bool:
        return bool(np.isfinite(self.cost)) and self.normal.finite

    def step(self, damping: float) -> DescentStep | None:
        r = reduced(self.s, self.normal, damping, self.dense)
        x = -step_solver(self.s, self.rows, r)(r.g)
        z = r.back(x)
        squares = sum(float(np.vdot(a, a)) for a in along(self.s, self.rows, x[:, None], z[:, :, None]))
        if squares == 0.0:
            return None
        change, length = float(np.sqrt(squares)), float(np.sqrt(sum(float(np.vdot(a.r, a.r)) for a in self.rows)))
        scale = np.where(r.scale > 0, r.scale, 1.0)
        full, reach = (float(np.linalg.norm(v * scale)) for v in (x, self._shared()))
        return DescentStep(self._moved(x, z), full, 1 + reach, change, length, change, DAMPING, damping == 0.0)

    def _moved(self, x: np.ndarray, z: np.ndarray) -> Values:
        s, new = self.s, {}
        for name, g in s.groups.items():
            step = np.zeros((g.count, g.moves))
            if g is s.local:
                step[s.eliminated] = z
            for number in s.numbers[name]:
                step[s.owner[number][1]] = x[s.offset[number] : s.offset[number] + g.moves]
            new[name] = g.moved(self.values[name], step)
        return new

    def _shared(self) -> np.ndarray:
        """Shared unknowns (columns,), a quaternion as zeros."""
        parts = []
        for name, k in self.s.owner:
            g, v = self.s.groups[name], self.values[name][k]
            parts.append(v if g.turn is None else np.concatenate([v[: g.turn], np.zeros(3), v[g.turn + 4 :]]))
        return np.concatenate([*parts, np.zeros(0)])
