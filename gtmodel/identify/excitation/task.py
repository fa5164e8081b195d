"""An excitation of a robot as an optimisation task: coordinates, parameters and limits, with sampled rows and cost."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from ... import lang as gt
from ...compiler.causal import CausalFunction, flat_of
from ...compiler.rows import map_columns
from ...inference import negligible
from ...motion.constraints import Constraint, MotionConstraints, guard_of
from ...motion.options import Limits
from ...motion.path_parametrization import motion_function
from ...results import ArgumentError, naming
from ...robots.links import links_of
from ..regressor import Regressor
from .basis import Array, Basis, ClosedSpline, FourierSeries
from .information import Criterion, CriterionAt
from .interior_point import Derivatives
from .options import Family, IdentificationExperiment

PER_SWING = 16  # samples of the shortest swing in the optimisation: limits are exceeded by some 2 % between them
KEPT_GRIDS = 8


@dataclass(frozen=True, eq=False)
class ExcitationTask:
    """Coordinates of an excitation, the parameters to identify, and the limits.

    Args:
        basis: the family of motions of the d coordinates x.
        rows: (x, x', x'' and optionally x''') -> bounded rows (m,), such as carts, link angles, velocities, forces.
        low, high: (m,) their bounds.
        regressor: (x, x', x'') -> Y (r, p), smooth; the force is Y @ parameters.
        nominal: (p,) nominal values of the parameters, none zero; columns are scaled by them.
        criterion: "condition", "determinant" or "variance".

    Raises ArgumentError if shapes do not fit or a nominal value is zero.

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
            raise ArgumentError(f"there are {m} bounded rows; low and high need {m} numbers each")
        if np.shape(self.nominal) != (p,) or not np.all(np.isfinite(self.nominal)) or np.any(self.nominal == 0):
            raise ArgumentError(f"the regressor has {p} columns; nominal needs {p} finite numbers, none of them zero")

    @property
    def dimension(self) -> int:
        """Number d of coordinates."""
        return self.rows.numel_in(0)

    @property
    def points(self) -> int:
        """Samples of one period in the optimisation."""
        return int(np.ceil(PER_SWING * self.basis.period / self.basis.fastest))

    def times(self, finer: int = 1) -> Array:
        """Equally spaced instants [s] of one period without its end, which is the beginning."""
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
        """Rows of the basis by grid, for the grids used last."""
        return {}

    @cached_property
    def _mapped(self) -> dict[int, ca.Function]:
        return {}

    @cached_property
    def sampled(self) -> SampledCost:
        """Cost and rows at `times()`, for a search."""
        return SampledCost(self)

    @cached_property
    def size(self) -> Array:
        """(m,) typical size of each row: its larger finite bound, or one."""
        largest = np.maximum(*(np.where(np.isfinite(b), np.abs(b), 0.0) for b in (self.low, self.high)))
        return np.where(largest > 0, largest, 1.0)

    def excess(self, c: Array, times: Array) -> Array:
        """(m,) greatest violation of each row relative to its size; negative if satisfied, infinite for NaN."""
        columns = [part.T for part in self.motion(c, times, self.rows.n_in())]
        values = map_columns(self.rows, columns, self._mapped)[0] / self.size[:, None]
        over = np.maximum(values - (self.high / self.size)[:, None], (self.low / self.size)[:, None] - values)
        return np.max(np.where(np.isnan(values), np.inf, over), axis=1)

    def stacked(self, c: Array, times: Array, regressor: ca.Function | None = None) -> Array:
        """(n r, p) rows of this or another regressor along the motion."""
        f = self.regressor if regressor is None else regressor
        r, p = f.size_out(0)
        values = np.asarray(f.map(len(times))(*(part.T for part in self.motion(c, times))))
        return values.reshape(r, len(times), p).transpose(1, 0, 2).reshape(-1, p)


class SampledCost:
    """Cost of the criterion and rows (R,), relative to their size, of unknowns x (size d,), c column by column.

    The rows are those of every sample, first against their upper bounds, then against their lower ones; infinite bounds
    are omitted. Rows are satisfied if at most zero. CasADi derives functions of one sample; the chain rule with the
    constant derivatives of the motion by the unknowns does the rest.
    """

    def __init__(self, task: ExcitationTask) -> None:
        self.task = task
        self.reserve = np.zeros(len(task.low))
        d, orders, times = task.dimension, task.rows.n_in(), task.times()
        self._basis = [task.basis.rows(times, order) for order in range(orders)]
        # (n, orders d, size d): derivatives of x, x', ... by the unknowns
        self._by_unknowns = np.concatenate([np.kron(np.eye(d), B[:, None]) for B in self._basis], axis=1)
        x = [ca.SX.sym(name, d) for name in ("x", "v", "a", "j")[:orders]]
        motion, m = ca.vertcat(*x), len(task.low)
        rows = task.rows(*x) / ca.DM(task.size)
        Y = task.regressor(*x[:3])
        Yt = (ca.mtimes(Y, ca.diag(ca.DM(task.nominal))) / np.sqrt(task.points * Y.shape[0])).T
        u, z = ca.SX.sym("u", m), ca.SX.sym("z", Yt.numel())
        second = ca.hessian(ca.dot(u, rows) + ca.dot(z, ca.vec(Yt)), motion)[0]
        self._rows = _Mapped("rows", x, rows)
        self._rows_by_motion = _Mapped("rows_by_motion", x, ca.jacobian(rows, motion).T)
        self._regressor = _Mapped("regressor", x[:3], Yt)
        self._regressor_by_motion = _Mapped("by_motion", x[:3], ca.jacobian(ca.vec(Yt), ca.vertcat(*x[:3])).T)
        self._second = _Mapped("second", [u, z, *x], second)
        high, low = np.isfinite(task.high), np.isfinite(task.low)
        self._bounded = np.concatenate([np.flatnonzero(high), np.flatnonzero(low)])
        self._sign = np.concatenate([np.ones(high.sum()), -np.ones(low.sum())])
        bound = np.where(self._sign > 0, task.high[self._bounded], -task.low[self._bounded])
        self._bound = bound / task.size[self._bounded]

    def within(self, reserve: Array) -> SampledCost:
        """The same problem with bounds tightened by a reserve (m,), relative to each row's size."""
        tightened = copy(self)
        tightened.reserve = reserve
        return tightened

    def cost(self, x: Array) -> float:
        return self._criterion(self._stacked(self._motion(x))).value

    def value(self, x: Array) -> tuple[float, Array]:
        motion = self._motion(x)
        rows = self._rows(*motion).T[self._bounded] * self._sign[:, None]
        over = rows - (self._bound - self.reserve[self._bounded])[:, None]
        return self._criterion(self._stacked(motion)).value, over.reshape(-1)

    def derivatives(self, x: Array) -> Derivatives:
        motion, n, unknowns = self._motion(x), self.task.points, len(x)
        G = self._by_unknowns
        stacked = self._stacked(motion)
        p, k = stacked.shape[1], 3 * self.task.dimension
        by = (self._regressor_by_motion(*motion[:3]).reshape(n, -1, k) @ G[:, :k]).reshape(-1, p, unknowns)
        half = np.tensordot(stacked, by, (0, 0))
        along = (half + half.swapaxes(0, 1)).transpose(2, 0, 1)  # (size d, p, p) of the information matrix
        criterion = self._criterion(stacked)
        W = criterion.gradient
        A = (self._rows_by_motion(*motion).reshape(n, -1, G.shape[1]) @ G)[:, self._bounded] * self._sign[:, None]

        def hessian(y: Array) -> Array:
            u = np.zeros((len(self.task.low), n))
            np.add.at(u, self._bounded, y.reshape(-1, n) * self._sign[:, None])
            z = (2 * stacked @ W).reshape(n, -1).T
            second = self._second(u, z, *motion).reshape(n, G.shape[1], -1) @ G
            H = np.tensordot(G, second, ((0, 1), (0, 1))) + criterion.second(along)
            return H + 2 * np.tensordot(by, W @ by, ((0, 1), (0, 1)))

        gradient = np.tensordot(along, W, 2)
        return gradient, A.swapaxes(0, 1).reshape(-1, unknowns), hessian

    def _criterion(self, stacked: Array) -> CriterionAt:
        return CriterionAt(self.task.criterion, stacked.T @ stacked)

    def _stacked(self, motion: list[Array]) -> Array:
        """(n r, p) rows of the scaled regressor over the square root of their number."""
        return self._regressor(*motion[:3]).reshape(-1, len(self.task.nominal))

    def _motion(self, x: Array) -> list[Array]:
        """x, x', ... (d, n) at the samples."""
        c = x.reshape(-1, self.task.dimension, order="F")
        return [(B @ c).T for B in self._basis]


class _Mapped:
    """An expression evaluated at columns (size, n): (n, entries), each matrix column by column."""

    def __init__(self, name: str, inputs: list[ca.SX], value: ca.SX) -> None:
        self.f = ca.Function(name, inputs, [ca.densify(ca.vec(value))], {"cse": True})
        self.mapped = dict[int, ca.Function]()

    def __call__(self, *columns: Array) -> Array:
        return map_columns(self.f, columns, self.mapped)[0].T


SHARP = 1e-6  # m/s: velocity scale of the sign in the final evaluation


@dataclass(frozen=True, eq=False)
class ExcitationPlan:
    """Everything that the search for an excitation needs.

    Attributes:
        limits, experiment: as passed.
        robot: with its own friction; its forces are bounded. inverse: its `motion_function`.
        task: the optimisation; its regressor has a smoothed sign.
        regressor: names, nominal values and units of the identified parameters. sharp: its ca.Function with the true
            sign.
        centre: (low, high) box of the rest positions of random motions [m].
        keys: the name of each bounded row. times: rows of the trajectory [s].
    """

    limits: Limits
    experiment: IdentificationExperiment
    robot: gt.Model
    inverse: CausalFunction
    task: ExcitationTask
    regressor: Regressor
    sharp: ca.Function
    centre: tuple[np.ndarray, np.ndarray]
    keys: list[str]
    times: np.ndarray


def plan_of(
    robot: gt.Model, motion: Family, limits: Limits, experiment: IdentificationExperiment, criterion: Criterion
) -> ExcitationPlan:
    """The plan for a robot. Raises ArgumentError."""
    flat = flat_of(robot)
    for name in ("T", "q", "tau"):
        if flat.groups.get(name, ((), []))[0] != (3,):
            raise ArgumentError(f"the robot must declare '{name}' as a vector of 3; it has {flat.top()}", "robot")
    guard = _guard(limits, robot)
    inverse = motion_function(robot, guard)
    regressor, smooth = _regressor(robot, experiment.identified, experiment.sign_smoothing)
    _, sharp = _regressor(robot, experiment.identified, SHARP)
    if np.any(negligible(regressor.nominal, regressor.units)):
        name = regressor.names[int(np.argmin(np.abs(regressor.nominal)))]
        raise ArgumentError(
            f"the nominal value of '{name}' is zero, but columns are scaled by nominal values; give a typical value "
            "under parameters, or leave it out",
            "experiment.identified",
        )
    rows, low, high = _rows(inverse, limits.force)
    task = ExcitationTask(_basis(motion), rows, low, high, smooth, regressor.nominal, criterion)
    keys = ["force_N"] * 3 + [margin.key for margin in guard.margins]
    times = _times(motion, experiment)
    return ExcitationPlan(limits, experiment, robot, inverse, task, regressor, sharp, _centre(motion), keys, times)


def _basis(motion: Family) -> Basis:
    if motion.family == "fourier":
        return FourierSeries(motion.period, motion.harmonics)
    return ClosedSpline(motion.period, motion.intervals)


def _guard(limits: Limits, robot: gt.Model) -> MotionConstraints:
    """The margins of the limits and of each link's component along its guideway, zero at the edge of reach."""
    links = links_of(robot)
    guard, least = guard_of(limits, links), limits.link_along_guideway

    def along(part: str, i: int) -> Constraint:
        def expression(m: Any) -> Any:
            arm = getattr(m.robot, part)[i]
            return gt.dot(arm.rod.b.r - arm.rod.a.r, arm.v) / gt.norm(arm.v) - least * m.metre

        return Constraint("link_along_guideway_m", "m", expression)

    return MotionConstraints([*guard.margins, *(along(*link) for link in links)], guard.parameters)


def _rows(inverse: CausalFunction, force: float) -> tuple[ca.Function, np.ndarray, np.ndarray]:
    """(x, x', x''[, x''']) -> forces, then margins; with their bounds."""
    orders = [signal.pairs[0][1] for signal in inverse.inputs]
    x = [ca.SX.sym(n, 3) for n in ("x", "v", "a", "j")[: max(3, 1 + max(orders))]]
    outputs = inverse.casadi.call([x[k] for k in orders])
    names = [signal.name for signal in inverse.outputs]
    rows = ca.vertcat(outputs[0], *[outputs[k] for k, name in enumerate(names) if name == "margin"])
    extra = rows.numel() - 3
    return (
        ca.Function("rows", x, [rows], {"cse": True}),
        np.concatenate([np.full(3, -force), np.zeros(extra)]),
        np.concatenate([np.full(3, force), np.full(extra, np.inf)]),
    )


def _regressor(robot: gt.Model, identified: list[str], velocity_scale: float) -> tuple[Regressor, ca.Function]:
    """The regressor of the motor forces for a motion of T, with friction smoothed over a velocity scale [m/s]."""
    try:
        chosen = robot.with_(velocity_scale=velocity_scale)
    except gt.ModelError:
        chosen = robot  # a robot without this parameter keeps its own smoothing
    with naming("experiment.identified", gt.ModelError):
        regressor = Regressor(chosen, identified, known="T")
    x = [ca.SX.sym(n, 3) for n in ("x", "v", "a")]
    Y = regressor.casadi.call([x[signal.pairs[0][1]] for signal in regressor.inputs])[0]
    return regressor, ca.Function("Y", x, [Y], {"cse": True})


def _centre(motion: Family) -> tuple[np.ndarray, np.ndarray]:
    low, high = np.array(motion.place_low), np.array(motion.place_high)
    if np.any(low > high):
        k = int(np.argmax(low > high))
        raise ArgumentError(f"coordinate {k} is {low[k]:g} m, above place_high, {high[k]:g} m", "motion.place_low")
    return low, high


def _times(motion: Family, experiment: IdentificationExperiment) -> np.ndarray:
    period, step = motion.period, experiment.sample
    count = round(period / step)
    if count < 1 or abs(count * step - period) > 1e-9 * period:
        raise ArgumentError(f"{period:g} s is not a multiple of the sample time {step:g} s", "motion.period")
    return np.linspace(0.0, period, count + 1)
