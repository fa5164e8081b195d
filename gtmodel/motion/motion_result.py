"""The result on one mesh: the collocation optimum, the exported motion, and the checks of both."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..optimize import Solution
from ..optimize.judgement.resimulate import Resimulation, resimulate
from ..results import Check, Trajectory, at_most
from ..results.check import failed_of
from .constraints import MARGIN_TOLERANCE
from .finer_mesh import FINER, finer_mesh, refined
from .options import MotionProblem
from .path_parametrization import NotReached, sampled
from .planning import MotionPlan
from .reference import between_rows
from .search import MotionSearch

# far above the published accuracy of these robots, a fraction of a millimetre
END_ERROR_BOUND_M = 5e-3
NO_EXPORT = "the optimum was found, but not the exportable motion"
FORCE_TOLERANCE = 1e-9  # relative tolerance of the force limit, which the exported force satisfies at every instant
SATURATED = 0.99  # share of its limit from which a motor is saturated
CROSS_CHECK_TOLERANCE = 1e-3  # relative difference of the final times by collocation and by squared speeds
MOST_INTERVALS = 3200
CROSS_CHECK_INTERVALS = 400  # relative error 5e-7 of the time on a line


@dataclass(frozen=True, kw_only=True)
class Exported:
    """The exported motion, its cost, and the results of re-simulating its force."""

    trajectory: Trajectory
    moving: Callable[[np.ndarray], Trajectory]
    final_time: float
    energy: float
    end_error: float
    peak: float
    defect: float


@dataclass(frozen=True)
class MotionFailure:
    """No exportable motion: the closest solution and the reason."""

    solution: Solution
    message: str


@dataclass(frozen=True, kw_only=True)
class MotionOutcome:
    """The result on one mesh. optima: costs of the distinct optima, best first. second: final time along the path by
    squared speeds [s]."""

    plan: MotionPlan
    solution: Solution
    tried: Resimulation
    exported: Exported
    second: float | None
    optima: list[float]
    checks: dict[str, Check]

    @property
    def peak(self) -> float:
        """Largest force of the optimum between its collocation points [N]."""
        if not self.plan.restricted:
            return _peak(self.tried)
        assert self.tried.trajectory is not None
        return float(np.max(np.abs(self.tried.trajectory["robot.tau"])))

    @property
    def saturation(self) -> list[float]:
        """Share of time in which each motor is at its limit."""
        tau, weights = at_points(self.solution)
        limit = self.plan.problem.limits.force
        return (weights @ (np.abs(tau) >= SATURATED * limit) / weights.sum()).tolist()


def on_this_mesh(
    plan: MotionPlan, search: MotionSearch, solution: Solution, optima: list[float]
) -> MotionOutcome | MotionFailure:
    """Re-simulate the optimum and compute the exported motion."""
    try:
        return _outcome(plan, search, solution, optima)
    except NotReached as missed:
        return MotionFailure(solution, f"{NO_EXPORT}: {missed}; {solution.message}")


def _outcome(
    plan: MotionPlan, search: MotionSearch, solution: Solution, optima: list[float]
) -> MotionOutcome | MotionFailure:
    resimulation = resimulate(solution)
    if resimulation.trajectory is None:
        message = f"the optimum cannot be re-simulated: {resimulation.message}; {solution.message}"
        return MotionFailure(solution, message)
    second = None
    if plan.path is not None and not plan.smooth:
        motion, second = plan.followed(search.work), plan.cross_check(CROSS_CHECK_INTERVALS)
        search.iterations += motion.iterations
        if not motion.status.converged:
            message = f"{NO_EXPORT}: {motion.message}; {solution.message}"
            return MotionFailure(solution, message)
        exported = _followed(plan, motion)
    else:
        constant, run = search.exportable_tried(solution, resimulation)
        if not constant.status.converged:
            return MotionFailure(constant, f"{NO_EXPORT}: {constant.message}")
        if run.trajectory is None:
            message = f"the exported motion cannot be re-simulated: {run.message}; {constant.message}"
            return MotionFailure(constant, message)
        exported = _resimulated(plan, constant, run)
    checks = _checks(plan, solution, resimulation, exported, second)
    return MotionOutcome(
        plan=plan, solution=solution, tried=resimulation, exported=exported, second=second, optima=optima, checks=checks
    )


def on_finer_meshes(outcome: MotionOutcome, search: MotionSearch) -> tuple[MotionOutcome, str]:
    """Refine the mesh; return the outcome and why refinement ended early. The search keeps counting iterations."""

    def again(before: MotionOutcome, problem: MotionProblem) -> MotionOutcome | str:
        search.go_on(problem, before.solution)
        solution = search.optimum()
        on = f"on {problem.mesh.elements} elements"
        if not solution.status.converged:
            return f"{on}: {solution.message}"
        after = on_this_mesh(replace(before.plan, problem=problem), search, solution, before.optima)
        return f"{on}: {after.message}" if isinstance(after, MotionFailure) else after

    return refined(outcome, _finer, again, search.work.interrupted)


def _finer(outcome: MotionOutcome) -> MotionProblem | None:
    """Return the problem on a finer mesh or with more path intervals if a check failed; None if neither can help."""
    problem, checks = outcome.plan.problem, outcome.checks
    followed = outcome.second is not None
    mended = [name for name in checks if name != "constraint_violation" and not (followed and "exported" in name)]
    mesh = finer_mesh(problem.mesh, checks, mended)
    finer = None if mesh is None else replace(problem, mesh=mesh)
    if followed and problem.path is not None and any("exported" in name for name in failed_of(checks)):
        intervals = min(2 * problem.path.intervals, MOST_INTERVALS)
        if intervals > problem.path.intervals:
            return replace(finer or problem, path=replace(problem.path, intervals=intervals))
    return finer


def short_names(trajectory: Trajectory, title: str) -> Trajectory:
    """Remove the prefix from the robot's names: robot.T becomes T."""
    values, units = {}, {}
    for name in trajectory.names:
        short = name.replace("robot.", "")
        values[short], units[short] = trajectory[name], trajectory.unit(name)
    return Trajectory(trajectory.time, values, units, title=title)


def energy_of(solution: Solution, unit: Any) -> float:
    """Return sum int (F / unit)^2 dt [s] by collocation quadrature; unit: one for all motors, or one for each."""
    tau, weights = at_points(solution)
    return float(np.sum(weights[:, None] * (tau / unit) ** 2))


def at_points(solution: Solution) -> tuple[np.ndarray, np.ndarray]:
    """Return forces at all collocation points and their quadrature weights [s]."""
    mesh = solution.nlp.mesh
    weights = np.outer(mesh.h, mesh.table.weights).reshape(-1) * solution.final_time
    return solution.trajectory["robot.tau"][1 : 1 + len(weights)], weights


def _resimulated(plan: MotionPlan, exported: Solution, run: Resimulation) -> Exported:
    assert run.trajectory is not None
    trajectory = short_names(run.trajectory, "")
    if plan.path is not None:
        s, v, a = (trajectory[name] for name in ("s", "der(s)", "der(s,2)"))
        margins = {"margin": trajectory["margin"]} if "margin" in trajectory else {}
        trajectory = plan.follower.along(trajectory.time, s, v, a).with_values(margins)  # margins may need the jerk
    else:
        T, v, a = (trajectory[name] for name in ("T", "der(T)", "der(T,2)"))
        carts = sampled(plan.robot, trajectory.time, T, v, a, plan.guard)["der(q)"]
        trajectory = trajectory.with_values({"der(q)": carts}, {"der(q)": "m/s"})
    peak = float(np.max(np.abs(trajectory["tau"])))
    if not plan.restricted:
        peak = max(peak, _peak(run))
    return Exported(
        trajectory=trajectory,
        moving=between_rows(plan.robot, plan.guard, plan.problem.order, trajectory, exported),
        final_time=exported.final_time,
        energy=energy_of(exported, plan.problem.cost.force_unit),
        end_error=_distance(trajectory["T"][-1], plan.goal),
        peak=peak,
        defect=run.defect,
    )


def _followed(plan: MotionPlan, motion: Any) -> Exported:
    follower = plan.follower
    trajectory = follower.trajectory(motion)
    end = follower.integrated_end(motion)
    return Exported(
        trajectory=trajectory,
        moving=lambda times: follower.sample(motion, times),
        final_time=motion.final_time,
        energy=motion.energy,
        end_error=_distance(end, plan.goal),
        peak=float(np.max(np.abs(trajectory["tau"]))),
        defect=_distance(end, trajectory["T"][-1]),
    )


def _distance(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.linalg.norm(a - b))


def _peak(run: Resimulation) -> float:
    return max(map(abs, sum((r for name, r in run.control_range.items() if "tau" in name), ())))


def _checks(
    plan: MotionPlan, solution: Solution, resimulation: Resimulation, exported: Exported, second: float | None
) -> dict[str, Check]:
    assert resimulation.trajectory is not None
    problem = plan.problem
    end_error = _distance(resimulation.trajectory["robot.T"][-1], plan.goal)
    checks: dict[str, Check] = {
        "constraint_violation": solution.checks["constraint_violation"],
        "end_error_m": at_most(end_error, END_ERROR_BOUND_M, FINER),
        "exported_end_error_m": at_most(exported.end_error, END_ERROR_BOUND_M, FINER),
        "exported_peak_force_N": at_most(exported.peak, problem.limits.force * (1 + FORCE_TOLERANCE), FINER),
    }
    if margins := margins_of(plan, exported):
        checks["exported_excess"] = at_most(max(0.0, -min(margins.values())), MARGIN_TOLERANCE, FINER)
    if second is not None and problem.cost.energy == 0.0:
        checks["cross_check_difference"] = at_most(abs(second / solution.final_time - 1), CROSS_CHECK_TOLERANCE, FINER)
    return checks


def margins_of(plan: MotionPlan, exported: Exported) -> dict[str, float]:
    """Return the smallest margin to each further limit along the exported motion."""
    return plan.guard.least(exported.trajectory["margin"]) if plan.guard.margins else {}
