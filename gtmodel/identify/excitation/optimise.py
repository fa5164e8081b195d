"""Excitation: the motion from which a regressor's parameters are identified best, within all limits.

The unknowns are those of a `Basis`; information and limits are sampled at equal steps of one period. Between the
samples the limits are looked at again, and tightened by what was seen there until they hold.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import numpy as np

from ...compiler.rows import map_columns
from ...optimize.ipopt import run_ipopt
from ...optimize.judgement.diagnosis import failure
from ...optimize.solve import SolverOptions
from ...optimize.watch import Program, Progress
from ...results import ArgumentError, SolveStatus
from .basis import Array, Basis
from .information import Criterion, cost

PER_SWING = 16  # samples of the shortest swing in the optimisation: limits overshoot by some 2 % between them
FINER = 20  # times as many samples when limits are looked at again
TIGHTENINGS = 6
RESERVE = 2e-4  # of a row's size: IPOPT keeps its rows to 1e-4
BEYOND = 1.1  # times what was seen between the samples
PATIENCE, GAIN, KEPT = 25, 0.02, 1e-3  # iterations; of the cost, one per cent of a condition number; of a row's size
FARTHEST = 0.05  # of a row's size: no reserve grows by more at once
KEPT_GRIDS = 8
SHARES = (0.99, 0.97, 0.9, 0.75, 0.5)


@dataclass(frozen=True, eq=False)
class ExcitationTask:
    """What an excitation moves, which parameters it is for, and which limits it keeps.

    Args:
        basis: the family of motions of the d coordinates x.
        rows: (x, x', x'' and perhaps x''') -> bounded rows (m,), such as carts, link angles, velocities, forces.
        low, high: (m,) their bounds.
        regressor: (x, x', x'') -> Y (r, p), smooth; the force is Y @ parameters.
        nominal: (p,) the parameters' nominal values, none zero; columns are scaled by them.
        criterion: "condition", "determinant" or "variance".

    Raises ArgumentError for shapes that do not fit and for a nominal value of zero.

    >>> import casadi as ca
    >>> x, v, a = (ca.SX.sym(name) for name in "xva")  # a pendulum m x'' + d x' + c sin x
    >>> task = gt.identify.ExcitationTask(
    ...     basis=gt.identify.FourierSeries(period=4.0, harmonics=3),
    ...     rows=ca.Function("rows", [x, v, a], [ca.vertcat(x, v)]),
    ...     low=np.array([-1.0, -2.0]),
    ...     high=np.array([1.0, 2.0]),
    ...     regressor=ca.Function("Y", [x, v, a], [ca.horzcat(a, v, ca.sin(x))]),
    ...     nominal=np.array([2.0, 1.0, 5.0]),
    ... )
    >>> task.dimension, task.basis.size, task.points  # coordinates, unknowns of each, samples of a period
    (1, 5, 48)
    """

    basis: Basis
    rows: ca.Function
    low: Array
    high: Array
    regressor: ca.Function
    nominal: Array
    criterion: Criterion = "condition"

    def __post_init__(self) -> None:
        m, p = self.rows.numel_out(0), self.regressor.size2_out(0)
        if np.shape(self.low) != (m,) or np.shape(self.high) != (m,):
            raise ArgumentError(f"there are {m} bounded rows; low and high take as many")
        if np.shape(self.nominal) != (p,) or not np.all(np.isfinite(self.nominal)) or np.any(self.nominal == 0):
            raise ArgumentError(f"the regressor has {p} columns; nominal takes as many numbers, none of them zero")

    @property
    def dimension(self) -> int:
        """Number d of coordinates."""
        return self.rows.numel_in(0)

    @property
    def points(self) -> int:
        """Samples of one period in the optimisation."""
        return int(np.ceil(PER_SWING * self.basis.period / self.basis.fastest))

    def times(self, finer: int = 1) -> Array:
        """Equally spaced instants [s] of one period, its end left out: it is the beginning."""
        count = self.points * finer
        return np.arange(count) * (self.basis.period / count)

    def motion(self, c: Array, times: Array, orders: int = 3) -> list[Array]:
        """x, x', x'', ... (n, d) at times [s] for unknowns c (size, d)."""
        key = np.ascontiguousarray(times, dtype=float).tobytes()
        if key not in self._basis_rows:
            while len(self._basis_rows) >= KEPT_GRIDS:
                self._basis_rows.pop(next(iter(self._basis_rows)))
            self._basis_rows[key] = []
        known = self._basis_rows[key]
        known += [self.basis.rows(times, order) for order in range(len(known), orders)]
        return [rows @ c for rows in known[:orders]]

    @cached_property
    def _basis_rows(self) -> dict[bytes, list[Array]]:
        """Of the grids last asked for: the same ones again and again."""
        return {}

    @cached_property
    def _mapped(self) -> dict[int, ca.Function]:
        return {}

    @cached_property
    def size(self) -> Array:
        """(m,) typical size of each row: its larger finite bound, or one."""
        largest = np.maximum(*(np.where(np.isfinite(b), np.abs(b), 0.0) for b in (self.low, self.high)))
        return np.where(largest > 0, largest, 1.0)

    def excess(self, c: Array, times: Array) -> Array:
        """(m,) greatest violation of each row in its size, negative where it is kept; infinite for no number."""
        columns = [part.T for part in self.motion(c, times, self.rows.n_in())]
        values = map_columns(self.rows, columns, self._mapped)[0] / self.size[:, None]
        over = np.maximum(values - (self.high / self.size)[:, None], (self.low / self.size)[:, None] - values)
        return np.max(np.where(np.isnan(values), np.inf, over), axis=1)

    def stacked(self, c: Array, times: Array, regressor: ca.Function | None = None) -> Array:
        """(n r, p) rows of the regressor along the motion, or of another one."""
        f = self.regressor if regressor is None else regressor
        r, p = f.size_out(0)
        values = np.asarray(f.map(len(times))(*(part.T for part in self.motion(c, times))))
        return values.reshape(r, len(times), p).transpose(1, 0, 2).reshape(-1, p)


@dataclass(frozen=True, eq=False)
class Excitation:
    """The motion found: unknowns `c` (size, d) of the basis, and how the search ended.

    `objective` is the logarithmic cost of the criterion, `seconds` the time that the search took. `excess` (m,) is the
    violation of each row on a grid FINER times as fine as the optimisation's, in the row's size: kept where <= 0.
    """

    status: SolveStatus
    message: str
    objective: float
    iterations: int
    c: Array
    excess: Array
    seconds: float

    @property
    def feasible(self) -> bool:
        """Whether every row is kept on the fine grid."""
        return bool(np.all(self.excess <= 0))


def optimise_excitation(
    task: ExcitationTask,
    start: Array,
    *,
    max_iterations: int = 400,
    tolerance: float = 1e-2,
    max_seconds: float | None = None,
    progress: Progress | None = None,
) -> Excitation:
    """The best motion near a start, by IPOPT.

    Args:
        task: what is moved and within which limits.
        start: unknowns c (size, d), which should keep the limits: a random feasible draw.
        max_iterations: of all tightenings together.
        tolerance: of IPOPT, on the cost's logarithm: 1e-2 gives the condition number to about a hundredth.
        max_seconds: the search ends then with its best motion.
        progress: called with (iteration, cost, violation); True stops, keeping the best iterate.

    The result is never worse than the start: where the search does not lead to a better motion that keeps all limits,
    the start itself comes back, and the message says so.

    >>> import casadi as ca
    >>> x, v, a = (ca.SX.sym(name) for name in "xva")  # a pendulum m x'' + d x' + c sin x
    >>> task = gt.identify.ExcitationTask(
    ...     basis=gt.identify.FourierSeries(period=4.0, harmonics=3),
    ...     rows=ca.Function("rows", [x, v, a], [ca.vertcat(x, v)]),
    ...     low=np.array([-1.0, -2.0]),
    ...     high=np.array([1.0, 2.0]),
    ...     regressor=ca.Function("Y", [x, v, a], [ca.horzcat(a, v, ca.sin(x))]),
    ...     nominal=np.array([2.0, 1.0, 5.0]),
    ... )
    >>> (start,) = gt.identify.random_excitations(task, (np.array([-0.5]), np.array([0.5])), 1, seed=1)
    >>> best = gt.identify.optimise_excitation(task, start)
    >>> before, after = (gt.identify.condition(task.stacked(c, task.times()), task.nominal) for c in (start, best.c))
    >>> best.status.ok, best.feasible, after < before
    (True, True, True)
    """
    begin = time.perf_counter()
    nlp = _assemble(task)
    fine = task.times(FINER)
    x, reserve = start.reshape(-1, order="F"), np.full(len(task.low), RESERVE)
    best, best_cost, iterations = start, float(nlp.value(x)), 0
    status, message, warm = SolveStatus.FAILED, "", None
    for _ in range(TIGHTENINGS):
        left = None if max_seconds is None else max(0.0, max_seconds - (time.perf_counter() - begin))
        rest = max(0, max_iterations - iterations)
        # gradients alone: an exact Hessian costs ten times as much per step and saves few
        options = SolverOptions(tolerance=tolerance, max_iterations=rest, max_seconds=left, hessian="lbfgs")
        patience = _Patience(progress)
        run = run_ipopt(nlp.within(task, reserve), x, options, patience, warm)
        iterations += run.iterations
        if patience.over:
            status, message = (
                SolveStatus.SOLVED,
                f"solved; {PATIENCE} iterations no longer brought {GAIN:g} of the cost",
            )
        else:
            run = run.at_best()
            status, message = run.status, "solved" if run.status.ok else failure(run, [])
        x, warm = run.x, run.multipliers
        c = x.reshape(start.shape, order="F")
        over = task.excess(c, fine)
        for share in SHARES if np.any(over > 0) else (1.0,):  # of the way from the start that keeps all limits
            nearer = start + share * (c - start)
            value = float(nlp.value(nearer.reshape(-1, order="F")))
            if value < best_cost and np.all(task.excess(nearer, fine) <= 0):
                best, best_cost = nearer, value
                break
        if np.all(over <= 0) or status is SolveStatus.INTERRUPTED or iterations >= max_iterations:
            break
        reserve = reserve + np.where(over > 0, np.minimum(BEYOND * over, FARTHEST) + RESERVE, 0.0)
        if np.any(over > FARTHEST):  # out of reach between two samples: no point to go on from
            x, warm = best.reshape(-1, order="F"), None
    if best is start:
        message += "; no motion better than the start keeps all limits, so the start is kept"
    seconds = time.perf_counter() - begin
    return Excitation(status, message, best_cost, iterations, best, task.excess(best, fine), seconds)


@dataclass(eq=False)
class _Patience:
    """Stops a search whose cost no longer falls; `over` says that this, and not the caller, was why."""

    progress: Progress | None
    best: float = np.inf
    since: int = 0
    over: bool = False

    def __call__(self, iteration: int, cost: float, violation: float) -> bool:
        if violation <= KEPT and cost < self.best - GAIN:
            self.best, self.since = cost, iteration
        asked = self.progress is not None and self.progress(iteration, cost, violation)
        self.over = not asked and np.isfinite(self.best) and iteration - self.since >= PATIENCE
        return asked or self.over


@dataclass(eq=False)
class _Program(Program):
    """The excitation's NLP: unknowns column by column of c, rows in their size."""

    value: ca.Function
    rows: int

    def within(self, task: ExcitationTask, reserve: Array) -> _Program:
        """Bounds of every row at every sample, drawn in by a reserve in its size."""
        low, high = (np.tile(b / task.size + s * reserve, self.rows) for b, s in ((task.low, 1), (task.high, -1)))
        free = np.full(self.nlp["x"].numel(), np.inf)
        return replace(self, lbx=-free, ubx=free, lbg=low, ubg=high)


def _assemble(task: ExcitationTask) -> _Program:
    times, n, d = task.times(), task.points, task.dimension
    unknown = ca.MX.sym("c", task.basis.size * d)
    c = ca.reshape(unknown, task.basis.size, d)
    orders = task.rows.n_in()
    motion = [ca.mtimes(ca.DM(task.basis.rows(times, order)), c).T for order in range(orders)]
    x = [ca.SX.sym(name, d) for name in ("x", "v", "a", "j")[:orders]]
    Y = ca.mtimes(task.regressor(*x[:3]), ca.diag(ca.DM(task.nominal)))
    information = ca.Function("information", x[:3], [ca.mtimes(Y.T, Y) / (n * Y.shape[0])], {"cse": True})
    scaled = ca.Function("scaled", x, [task.rows(*x) / ca.DM(task.size)], {"cse": True})
    p = len(task.nominal)
    M = ca.reshape(ca.sum2(ca.reshape(information.map(n)(*motion[:3]), p * p, n)), p, p)
    f = cost(task.criterion, p)(M)
    g = ca.vec(scaled.map(n)(*motion))
    none, value = np.zeros(0), ca.Function("value", [unknown], [f])
    return _Program({}, {"x": unknown, "f": f, "g": g}, none, none, none, none, value, n)
