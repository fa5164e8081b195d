"""The descent over shared unknowns, on the Schur complement of the local ones."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ...results.estimate import Estimate
from ...results.refusal import ArgumentError
from ...results.status import SolveStatus
from ..descent import Descent, DescentStep, minimised
from .elimination import BlockNormal, along, normal_equations, reduced
from .residual_block import BlockEvaluation, Linearised, ResidualBlock
from .shared_step import step_solver
from .structure import Structure, structure
from .undetermined import GaugeMotion
from .unknown_group import UnknownGroup
from .worth import Worth, worth_of

Values = dict[str, np.ndarray]

DAMPING = 1e-4  # to begin with, as a part of the squared lengths of all columns


@dataclass(frozen=True, eq=False)
class BundleFit(Descent):
    """Where the fit ended.

    cost: half the sum of squares of the whitened residuals, or of their losses.
    residuals: by block, (n, m), neither whitened nor weighted, in the order of the data.
    estimate: of all shared unknowns, named "instance.label", rotations as rotation vectors [rad]; None unless solved.
    notes: sentences on what the data do not determine; undetermined: in how many directions.
    """

    x: Values
    residuals: dict[str, np.ndarray]
    estimate: Estimate | None = None
    notes: tuple[str, ...] = ()
    undetermined: int = 0
    _worth: Worth | None = field(default=None, repr=False)

    @property
    def values(self) -> Values:
        """By group, (count, size); local ones too."""
        return self.x

    @property
    def shared_covariance(self) -> np.ndarray:
        """Covariance of the increments of all shared unknowns, group by group, those of quaternions in their own
        frames; zero for what is fixed. Raises ArgumentError unless solved."""
        if self._worth is None:
            raise ArgumentError(f"a fit that is not solved has no covariance: {self.message}")
        return self._worth.C

    @cached_property
    def local_covariance(self) -> np.ndarray:
        """Covariance (count, moves, moves) of each local instance, in its increments (rotations in its own frame); NaN
        for what was kept with the shared unknowns. Raises ArgumentError unless solved."""
        if self._worth is None:
            raise ArgumentError(f"a fit that is not solved has no covariance: {self.message}")
        return self._worth.local_covariance

    def joint_covariance(self, instance: int) -> np.ndarray:
        """Covariance of the increments of all shared unknowns and, behind them, of one local instance. Raises
        ArgumentError unless solved."""
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
    """Least squares over shared and local unknowns: the local ones are eliminated (Schur complement), so that time and
    memory grow with the observations and not with their square.

    groups, blocks: the problem; at most one group is local. motions: what to call the directions in which nothing
        measured moves, see GaugeMotion.
    hold_undetermined: whether such directions are left where they are and reported; otherwise they are refused.
    dense: whether S is a dense matrix; by default up to 4,500 columns.
    tolerance: the iteration ends with a step that changes the residuals by this part of their length. limit: of steps.
    covariance: whether to form the Estimate.
    stop: asked before each step; True ends the fit with the best values so far, status INTERRUPTED.

    Source: Brown 1958 and Triggs and others 2000, "Bundle adjustment: a modern synthesis", section 6.1.

    Raises ArgumentError for a problem that does not fit together, or for what is not determined. An iteration that
    fails is a `status`.

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
            f"the noise of {names} is not given, and that of others is; give sigma to all blocks or none"
        )
    start = {name: g.start.copy() for name, g in s.groups.items()}
    end = minimised(
        lambda values: _Here(s, dense, values, [e.linearised(values) for e in evaluations]), start, limit=limit,
        tolerance=tolerance, stop=stop, stuck="are the starting values near enough?",
        unended="give a larger limit",
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
        f"at the start {' and '.join(bad)} lie outside the range of their model or are not finite; start nearer"
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
