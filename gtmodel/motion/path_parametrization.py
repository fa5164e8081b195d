"""Path parametrisation: functions of the path coordinate, branch-following causal functions, link positions, and the
motion from squared path speeds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import casadi as ca
import numpy as np

from .. import lang as gt
from .._lazy import hint
from ..compiler.causal import CausalFunction, compile_causal, flat_of
from ..compiler.rows import PointFunction
from ..lang import Model
from ..optimize.path import Curve, PathMotion, PathTask, solve_path
from ..optimize.watch import Progress
from ..results import ArgumentError, Status, Trajectory
from ..robots.links import link_names
from .constraints import NO_GUARD, MotionConstraints
from .options import MotionProblem
from .task import trapezoid

if TYPE_CHECKING:
    from .paths import Path
else:
    Path = hint("gtmodel.motion.paths", "Path")

STEPS = 8  # limit of Newton steps from the previous instant
SAME = 1e-6  # relative and absolute tolerance for equal solutions from two starts
CONVERGED = 1e-12  # relative size of a correction that counts as converged


class FollowedBranch:
    """The first target of a causal function at closely spaced instants, as in an integrator.

    Newton's method starts from the previous instant. The function's own solution from the home pose, which takes
    several times as long, is used only at the first instant and if Newton's method fails. `statuses` evaluates margins
    and the branch at all recorded instants at once.

    >>> class Cubic(gt.Model):
    ...     x, u = gt.variable(), gt.input()
    ...     def equations(self):
    ...         yield self.x**3 + self.x == self.u
    >>> f = gt.motion.followed_branch.FollowedBranch(Cubic().causal(known="u", targets="x"))
    >>> [round(float(f.kept(u)[0]), 4) for u in (2.0, 2.1)], f.statuses()
    ([1.0, 1.0248], array([0, 0]))
    """

    def __init__(self, f: CausalFunction) -> None:
        self.f = f
        self.near: list[np.ndarray] = []
        self._closed = PointFunction(f.closed)
        self._residuals = [(PointFunction(k.residual), k.scale) for k in f.kernels]
        self._kept: list[tuple[tuple[np.ndarray, ...], np.ndarray]] = []

    def __call__(self, *arguments: Any) -> np.ndarray:
        """Return the target (n,); NaN if the function fails."""
        columns = [np.asarray(a, float).reshape(-1) for a in arguments]
        known, unknowns = np.concatenate(columns), []
        for (residual, scale), z in zip(self._residuals, self.near, strict=bool(self.near)):
            corrected = _corrected(residual, scale, z, known)
            if corrected is None:
                break
            unknowns.append(corrected)
            known = np.concatenate([known, corrected])
        if len(unknowns) < len(self.f.kernels):
            unknowns = [z.reshape(-1) for z in self.f.unknowns(*arguments)[0]]
        self.near = unknowns if all(np.all(np.isfinite(z)) for z in unknowns) else []
        return self._closed(*columns, *unknowns)[0].reshape(-1)

    def kept(self, *arguments: Any) -> np.ndarray:
        """Return the target and record the instant for `statuses`."""
        value = self(*arguments)
        self._kept.append((tuple(np.asarray(a, float) for a in arguments), value))
        return value

    def statuses(self) -> np.ndarray:
        """Return the function's own status at all recorded instants; WRONG_BRANCH if its value differs."""
        value, *_, status = self.f(*(np.array(column) for column in zip(*(a for a, _ in self._kept), strict=True)))
        recorded = np.array([v for _, v in self._kept])
        same = np.isclose(recorded, np.reshape(value, recorded.shape), rtol=SAME, atol=SAME).all(axis=1)
        return np.where((status == Status.OK) & ~same, Status.WRONG_BRANCH, status)


def _corrected(residual: PointFunction, scale: np.ndarray, z: np.ndarray, known: np.ndarray) -> np.ndarray | None:
    """Solve by Newton's method from z; None if it does not converge in a few steps."""
    last = np.inf
    for _ in range(STEPS):
        r, jacobian = residual(z, known)
        try:
            step = np.linalg.solve(jacobian, r).reshape(-1)
        except np.linalg.LinAlgError:
            return None
        z, size = z - step, float(np.max(np.abs(step) / scale))
        if size <= CONVERGED:
            return z
        if not size < last:  # rounding, or no convergence
            return z if size <= 1e3 * CONVERGED else None
        last = size
    return None


def motion_function(robot: gt.Model, guard: MotionConstraints = NO_GUARD) -> CausalFunction:
    """Return (T, T', T'') -> forces, carts, cart speeds, link joints (`joint_names`), and the guard's margins."""
    p = guard.prefix
    names = [f"{p}tau", f"{p}q", f"der({p}q)", *(f"{p}{name}" for name in joint_names(robot))]
    return compile_causal(guard.model(robot), known=f"{p}T", targets=[*names, *(["margin"] if guard.margins else [])])


def joint_names(robot: gt.Model) -> list[str]:
    """Return the names of the cart joints of the links in `link_names` order, then those of the plate joints."""
    names = link_names(robot)
    return [*names, *(name.removesuffix("a.r") + "b.r" for name in names)]


def link_ends(
    robot: gt.Model, T: np.ndarray, guard: MotionConstraints = NO_GUARD
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return cart and plate joints (rows, n, 3) [m] of the links in `link_names` order at TCP positions (rows, 3), and
    the status of each row; guard: of the motion, whose function is compiled anyway."""
    names = joint_names(robot)
    # reuse the function with forces; if it fails, solve for the positions alone
    *columns, status = motion_function(robot, guard).along(T)
    points = columns[3 : 3 + len(names)]
    if np.any(status != Status.OK):
        *points, status = compile_causal(robot, known="T", targets=names or ["q"]).along(T)
    return *joints_of(names, points, len(T)), status


def joints_of(names: Sequence[str], points: Sequence[np.ndarray], rows: int) -> tuple[np.ndarray, np.ndarray]:
    """Return cart and plate joints (rows, n, 3) from the values of `joint_names`."""
    if not names:
        return np.zeros((rows, 0, 3)), np.zeros((rows, 0, 3))
    half = len(names) // 2
    return np.stack(points[:half], axis=1), np.stack(points[half:], axis=1)


def along_guideways(robot: gt.Model, tips: np.ndarray, joints: Sequence[np.ndarray] | np.ndarray) -> np.ndarray:
    """Return the components (..., n) [m] of n links along their guideways, from plate and cart joints (..., n, 3) in
    `link_names` order. If all links meet in one point, tips may be that point."""
    flat = flat_of(robot)
    directions = [flat.bindings[name.removesuffix("rod.a.r") + "v"] for name in link_names(robot)]
    if not directions:
        return np.zeros(0)
    v = np.array(ca.Function("v", [flat.p], [ca.horzcat(*directions)])(flat.p0)).T
    return np.sum((tips - np.asarray(joints)) * v, axis=-1) / np.linalg.norm(v, axis=1)


MIDDLE = np.array([0.5])


def rows_along(f: CausalFunction, curve: Curve) -> tuple[ca.Function, Curve]:
    """Return (x, x', x'', Newton unknowns) -> targets of f, and the curve extended by these unknowns.

    f: a function of one known variable and its derivatives up to the second. curve: s -> that variable and its
    two derivatives, (n, d) each. Positions without a closed form are solved once at each node. The remaining functions
    are explicit, with exact derivatives and no root finder inside the optimisation.

    Raises ArgumentError for a model whose Newton blocks depend on velocities.
    """
    size = f.inputs[0].size
    x = [ca.SX.sym(name, size) for name in ("x", "v", "a")]
    _check(f, curve)
    zs, _ = _unknowns(f, curve, MIDDLE, moving=False)
    z = [ca.SX.sym(f"z{k}", part.shape[1]) for k, part in enumerate(zs)]
    outputs = f.closed.call([*f.arguments_along(*x), *z])
    rows = ca.Function("rows", [*x, *z], outputs[: len(f.outputs)], {"cse": True})

    def extended(s: np.ndarray) -> tuple[np.ndarray, ...]:
        return (*curve(s), *_unknowns(f, curve, s, moving=False)[0])

    return rows, extended


def task_along(
    f: CausalFunction, curve: Curve, margins_from: int, limit: np.ndarray, squares: np.ndarray, **more: Any
) -> PathTask:
    """Return the PathTask of a robot along a path.

    f: as for `rows_along`; its first target is the motor forces, targets from `margins_from` on must be >= 0.
    limit: (m,) of the motor forces. squares: (m,) their weights in the energy. more: fields of PathTask.
    """
    rows, along = rows_along(f, curve)
    inputs = rows.sx_in()
    values = rows.call(inputs)
    bounded = ca.vertcat(values[0], *values[margins_from:])
    extra = bounded.numel() - len(limit)
    return PathTask(
        along,
        ca.Function("rows", inputs, [bounded], {"cse": True}),
        np.concatenate([-limit, np.zeros(extra)]),
        np.concatenate([limit, np.full(extra, np.inf)]),
        np.concatenate([squares, np.zeros(extra)]),
        **more,
    )


def _unknowns(f: CausalFunction, curve: Curve, s: np.ndarray, moving: bool) -> tuple[list[np.ndarray], np.ndarray]:
    """Solve Newton's unknowns at rest, or with the path's derivative as velocity."""
    x, slope, _ = curve(s)
    arguments = f.arguments_along(*((x, slope) if moving else (x,)))
    shaped = [a if signal.shape else a[:, 0] for a, signal in zip(arguments, f.inputs, strict=True)]
    return f.unknowns(*shaped)


def _check(f: CausalFunction, curve: Curve) -> None:
    at_rest, moving = (_unknowns(f, curve, MIDDLE, moving)[0] for moving in (False, True))
    if any(not np.array_equal(a, b, equal_nan=True) for a, b in zip(at_rest, moving, strict=True)):
        raise ArgumentError("has positions that depend on velocities, so it cannot follow a path", "robot")


FORCE_RESERVE = 1e-5  # of the limit: for rounding at rest and curvature between nodes
TIGHTENINGS = 4  # each lowers the limit by the observed excess between nodes, about 0.1 %
PER_INTERVAL = 4  # samples per interval
FOLLOWING = 1e-9  # tolerance of the integrator, relative and absolute
DEGREE = 5  # of the polynomial that interpolates a force within one interval for integration


@dataclass(frozen=True, eq=False)
class PathParametrization:
    """A robot that follows a path within its limits and further margins."""

    problem: MotionProblem
    guard: MotionConstraints
    path: Path

    def trouble(self, samples: int = 401) -> str:
        """Return one sentence on a point that the path cannot pass; empty if there is none."""
        s = np.linspace(0.0, 1.0, samples)
        T = self.path(s)[0]
        joints, tips, status = link_ends(self.problem.robot, T, self.guard)
        along = along_guideways(self.problem.robot, tips, joints)
        bad = np.flatnonzero(status != Status.OK)
        least = self.problem.limits.link_along_guideway
        for k in range(samples):
            place = f"({', '.join(f'{x:.4g}' for x in T[k])}) m, {100 * s[k]:.0f} % of the way"
            if bad.size and k == bad[0]:
                return f"the path leaves the workspace at {place}"
            if np.any(along[k] < least):
                i = int(np.argmin(along[k]))
                link = link_names(self.problem.robot)[i].removesuffix(".rod.a.r")
                return (
                    f"the path reaches the workspace boundary at {place}: the component of {link} along its guideway "
                    f"is {along[k, i]:.3g} m, less than limits.link_along_guideway_m = {least:g}"
                )
        margins = motion_function(self.problem.robot, self.guard).along(T)[-2] if self.guard.margins else None
        broken = None if margins is None else self.guard.broken(margins)
        return f"the path {broken[1]}, {100 * s[broken[0]]:.0f} % of the way" if broken else ""

    def guess(self) -> Trajectory:
        """Return a trapezoidal profile of 1 s along the path."""
        t, s, ds, dds = trapezoid()
        return Trajectory(t, {"s": s, "der(s)": ds, "der(s,2)": dds, "drive": dds})

    def fastest(
        self,
        intervals: int,
        progress: Progress | None = None,
        max_seconds: float | None = None,
        bounded: Literal["middle", "ends"] = "ends",
        reserve: float = 0.0,
    ) -> PathMotion:
        """Return the optimal motion with limits imposed on both sides of every node, or in the middle of intervals."""
        problem, cost = self.problem, self.problem.cost
        f = motion_function(problem.robot, self.guard)
        task = task_along(
            f, self.path, len(f.outputs) - bool(self.guard.margins),
            np.full(3, problem.limits.force * (1 - reserve)), np.full(3, cost.force_unit**-2),
            time=cost.time, energy=cost.energy,
            rest=("velocity" in problem.start.rest, "velocity" in problem.goal.rest),
        )  # fmt: skip
        return solve_path(task, intervals, bounded=bounded, progress=progress, max_seconds=max_seconds)

    def within(self, intervals: int, progress: Progress | None = None, max_seconds: float | None = None) -> PathMotion:
        """Return the optimal motion whose forces keep their limit between the nodes too.

        The limit is lowered by the observed excess.
        """
        reserve = FORCE_RESERVE
        motion = self.fastest(intervals, progress, max_seconds, reserve=reserve)
        for _ in range(TIGHTENINGS):
            peak = float(np.max(np.abs(self.trajectory(motion)["tau"]))) if motion.status.ok else 0.0
            if peak <= self.problem.limits.force:
                break
            reserve += peak / self.problem.limits.force - 1 + FORCE_RESERVE
            motion = self.fastest(intervals, progress, max_seconds, reserve=reserve)
        return motion

    def sample(self, motion: PathMotion, times: np.ndarray) -> Trajectory:
        """Return the motion at instants [s], with inverse kinematics and dynamics."""
        return self.along(times, *motion.at(times))

    def along(self, times: np.ndarray, s: np.ndarray, v: np.ndarray, a: np.ndarray) -> Trajectory:
        """Return the motion at instants [s] for a path coordinate and its two derivatives."""
        x, slope, bend = self.path(s)
        T, dT = x, slope * v[:, None]
        ddT = bend * v[:, None] ** 2 + slope * a[:, None]
        return sampled(self.problem.robot, times, T, dT, ddT, self.guard).with_values({"s": s})

    def trajectory(self, motion: PathMotion) -> Trajectory:
        """Return the motion at its nodes and between them; at a node the value just after it."""
        fractions = np.arange(PER_INTERVAL) / PER_INTERVAL
        times = (motion.t[:-1, None] + fractions * np.diff(motion.t)[:, None]).reshape(-1)
        end = np.nextafter(motion.final_time, 0.0)  # just before the end: the last interval's force
        return self.sample(motion, np.unique(np.append(times, end)))

    def integrated_end(self, motion: PathMotion) -> np.ndarray:
        """Return the final TCP position [m] if only the forces act, from an error-controlled integrator."""
        nodes = (1 - np.cos(np.pi * (2 * np.arange(DEGREE + 1) + 1) / (2 * DEGREE + 2))) / 2
        steps = np.diff(motion.t)
        times = motion.t[:-1, None] + nodes * steps[:, None]
        tau = self.sample(motion, times.reshape(-1))["tau"].reshape(len(steps), DEGREE + 1, 3)
        power = np.linalg.inv(np.vander(nodes, increasing=True))
        c = np.einsum("pn,knm->kpm", power, tau)
        import scipy  # local import: free motions start faster without it

        forward = FollowedBranch(compile_causal(self.problem.robot, known="tau", targets="der(T,2)", prefer="T"))
        y = np.concatenate([self.path(np.zeros(1))[0][0], self.path(np.zeros(1))[1][0] * np.sqrt(motion.b[0])])
        for begin, step, polynomial in zip(motion.t, steps, c, strict=False):

            def arguments(
                t: float, y: np.ndarray, begin: float = begin, step: float = step, polynomial: np.ndarray = polynomial
            ) -> list[np.ndarray]:
                tau = ((t - begin) / step) ** np.arange(DEGREE + 1) @ polynomial
                values = {("T", 0): y[:3], ("T", 1): y[3:], ("tau", 0): tau}
                return [values[_base(signal.name), signal.pairs[0][1]] for signal in forward.f.inputs]

            def rates(t: float, y: np.ndarray, arguments: Callable[..., Any] = arguments) -> np.ndarray:
                return np.concatenate([y[3:], forward(*arguments(t, y))])

            span = begin, begin + step
            run = scipy.integrate.solve_ivp(
                rates, span, y, method="DOP853", rtol=FOLLOWING, atol=FOLLOWING, first_step=step
            )
            y = run.y[:, -1]
            forward.kept(*arguments(span[1], y))
            if not run.success:
                return np.full(3, np.nan)
        return y[:3] if np.all(forward.statuses() == Status.OK) else np.full(3, np.nan)


def _base(name: str) -> str:
    return name.removeprefix("der(").partition(",")[0].rstrip(")")


class NotReached(Exception):
    """A motion leaves the robot's workspace at `samples` instants."""

    def __init__(self, samples: int) -> None:
        super().__init__(f"the motion leaves the robot's reach at {samples} instants: use more mesh.elements")
        self.samples = samples


def sampled(
    robot: Model, times: np.ndarray, T: np.ndarray, dT: np.ndarray, ddT: np.ndarray, guard: MotionConstraints
) -> Trajectory:
    """Return a TCP motion with carts, forces, links and margins by inverse kinematics and dynamics.

    Raises NotReached if the robot cannot reach an instant.
    """
    p, f = guard.prefix, motion_function(robot, guard)
    *columns, status = f.along(T, dT, ddT)
    if np.any(status != Status.OK):
        raise NotReached(int(np.count_nonzero(status)))
    values = {signal.name: value for signal, value in zip(f.outputs, columns, strict=True)}
    result = {"T": T, "der(T)": dT, "der(T,2)": ddT, "tau": values[f"{p}tau"], "q": values[f"{p}q"],
              "der(q)": values[f"der({p}q)"]}  # fmt: skip
    units = {"T": "m", "der(T)": "m/s", "der(T,2)": "m/s2", "tau": "N", "q": "m", "der(q)": "m/s"}
    if names := joint_names(robot):
        joints, tips = joints_of(names, [values[f"{p}{name}"] for name in names], len(T))
        result["along_guideway"] = along_guideways(robot, tips, joints)
        units["along_guideway"] = "m"
    if "margin" in values:
        result["margin"] = values["margin"]
    return Trajectory(times, result, units)
