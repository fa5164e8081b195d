"""The search for an optimal motion: which problems are tried one after the other, from which guess."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal, cast

import numpy as np

from gtmodel.lang import Model, Optimization
from gtmodel.motion.guard import Guard
from gtmodel.motion.paths import Path
from gtmodel.motion.task import MotionTask, motion
from gtmodel.optimize import Mesh, Solution, SolverOptions
from gtmodel.optimize import solve as collocate
from gtmodel.optimize.judgement.resimulate import Resimulation, resimulate
from gtmodel.problem_files.base import Context
from gtmodel.results import SolveStatus, Trajectory

from .trajectory_keys import TrajectoryProblem

# iterations without progress after which an attempt has lost its way, and another one is the better bet: of 200 drawn
# attempts that ended in an optimum one waited longer, those that ended in none mostly never came back
PATIENCE = 60
RESERVE = 200  # iterations that further starts leave to the exported motion; it takes 10 to 70
EXPORT_LOSS = 0.05  # a constant force per element costs less than this; more tells of another, worse optimum
TIGHTENINGS = 3
TIGHTENED = 1e-4  # relative, beyond what was seen
CONTINUATION = (0.01, 0.001)  # weights of the energy, in units of the time's, on the way to the problem's own

Control = Literal["polynomial", "constant"]


def order_of(problem: TrajectoryProblem) -> int | None:
    """The derivative of the motion that is the control; None: the forces are.

    A constant force on an element holds neither an acceleration nor a speed: friction changes within milliseconds.
    """
    limits = problem.limits
    if limits.tcp_jerk_m_s3 is not None:
        return 3
    rates = (limits.tcp_velocity_m_s, limits.cart_velocity_m_s,
             limits.tcp_acceleration_m_s2, limits.cart_acceleration_m_s2)  # fmt: skip
    return 2 if problem.path is not None or any(limit is not None for limit in rates) else None


def task_of(
    problem: TrajectoryProblem,
    guarded: bool = False,
    energy: float | None = None,
    guard: Guard | None = None,
    path: Path | None = None,
) -> MotionTask:
    """The task that a problem file describes, with or without the bound that keeps links off the edge of reach."""
    return MotionTask(
        start=np.array(problem.start.tcp_m),
        goal=np.array(problem.goal.tcp_m),
        start_rest=list(problem.start.rest),
        goal_rest=list(problem.goal.rest),
        force=problem.limits.force_N,
        force_unit=problem.cost.force_unit_N,
        weight_time=problem.cost.time,
        weight_energy=problem.cost.energy if energy is None else energy,
        link_margin=problem.limits.link_along_guideway_m if guarded else None,
        guard=guard or Guard([], {}),
        path=path,
        order=order_of(problem),
    )


def motion_of(problem: TrajectoryProblem, robot: Model, *args: Any, **options: Any) -> Optimization:
    """The motion that a problem file describes; see `task_of`."""
    return motion(robot, task_of(problem, *args, **options))


@dataclass
class Search:
    """Attempts in turn, until one is solved and keeps its links off the edge of reach.

    First without that bound, which an optimum seldom feels; then with it, and with it and the other barrier strategy;
    then from the bare line, since the forces of a profile may lie far outside the limits; then along a continuation
    from a heavier weight of the energy. An attempt that gets nowhere makes room for the next. All attempts, those from
    further starts and at the exported motion too, share `solver.max_iterations`, which `iterations` counts, and the
    time limit.
    """

    problem: TrajectoryProblem
    context: Context
    robot: Model
    guess: Trajectory | Solution
    bare: Trajectory
    guard: Guard = field(default_factory=lambda: Guard([], {}))
    path: Path | None = None
    iterations: int = 0
    started: int = field(default=0, init=False)

    @cached_property
    def plain(self) -> Optimization:
        return self._motion(False)

    @cached_property
    def guarded(self) -> Optimization:
        return self._motion(True)

    def _motion(self, guarded: bool, energy: float | None = None) -> Optimization:
        return motion_of(self.problem, self.robot, guarded, energy, self.guard, self.path)

    def go_on(self, problem: TrajectoryProblem, guess: Solution) -> None:
        """From here on with another mesh, from what was found; iterations are counted on."""
        self.problem, self.guess = problem, guess

    def optimum(self) -> Solution:
        """The optimum with the control that the problem asks for; where none is found, the best attempt."""
        problem, control = self.problem, self.problem.mesh.control
        tried: list[Solution] = []
        ways = [(False, self.guess, "adaptive"), (True, self.guess, "adaptive"), (True, self.guess, "monotone"),
                (True, self.bare, "adaptive")]  # fmt: skip
        if problem.solver.barrier != "auto":
            ways.pop(2)
        for guarded, guess, barrier in ways:
            tried.append(self._attempt(self.guarded if guarded else self.plain, control, guess, barrier))
            if self._done(tried[-1]):
                return self._best(tried)
        start: Trajectory | Solution = self.bare
        for weight in CONTINUATION:
            energy = weight * (problem.cost.time or 1.0)
            if energy > problem.cost.energy:
                step = self._attempt(self._motion(True, energy), control, start)
                if self._over(step):
                    return self._best(tried)  # a step is no optimum of the problem itself
                start = step if step.status.converged else start
        return self._best([*tried, self._attempt(self.guarded, control, start)])

    def from_starts(self, guesses: list[Trajectory]) -> list[Solution]:
        """Optima from further starts, links kept off the edge of reach; those that end in none are left out, and those
        for which there is no time or no iteration left."""
        found: list[Solution] = []
        for guess in guesses:
            if self.context.interrupted() or self.left <= RESERVE:
                break
            solution = self._attempt(self.guarded, self.problem.mesh.control, guess, "adaptive", self.left - RESERVE)
            self.started += 1
            if solution.status.converged:
                found.append(solution)
        return found

    @property
    def left(self) -> int:
        """Iterations left for all that is still to be tried."""
        return max(0, self.problem.solver.max_iterations - self.iterations)

    def exportable_tried(self, optimum: Solution, tried: Resimulation) -> tuple[Solution, Resimulation]:
        """The exported motion and its re-simulation. Where forces are not the control they may pass their limit between
        the points: then once more, with the limit lowered by what was seen."""
        if self.problem.mesh.control == "constant":
            solution, run = optimum, tried
        else:
            solution = self.exportable(optimum)
            run = resimulate(solution) if solution.status.converged else tried
        limit, search = self.problem.limits.force_N, self
        for _ in range(TIGHTENINGS):
            if not solution.status.converged or run.trajectory is None or order_of(self.problem) is None:
                break
            peak = float(np.max(np.abs(run.trajectory["robot.tau"])))
            if peak <= limit:
                break
            lower = search.problem.limits.force_N * (limit / peak) * (1 - TIGHTENED)
            limits = self.problem.limits.model_copy(update={"force_N": lower})
            problem = self.problem.model_copy(update={"limits": limits})
            search = Search(
                problem, self.context, self.robot, self.guess, self.bare, self.guard, self.path, self.iterations
            )
            solution = search.exportable(optimum)
            self.iterations = search.iterations
            run = resimulate(solution) if solution.status.converged else run
        return solution, run

    def exportable(self, optimum: Solution) -> Solution:
        """The optimum among forces that are constant on each element: the best of some attempts."""
        best: Solution | None = None
        for guarded, guess in ((False, optimum), (True, optimum), (True, self.guess)):
            solution = self._attempt(self.guarded if guarded else self.plain, "constant", guess)
            if best is None or _better(solution, best):
                best = solution
            if self._over(solution) or (self._done(solution) and _loss(solution, optimum) <= EXPORT_LOSS):
                break
        assert best is not None
        return best

    def _attempt(
        self,
        model: Optimization,
        control: Control,
        guess: Trajectory | Solution,
        barrier: str = "auto",
        most: int | None = None,
    ) -> Solution:
        """One attempt, with a barrier strategy where the problem leaves it open."""
        wanted = control == self.problem.mesh.control
        stage = "optimising" if wanted else "bounding the force between the nodes"

        def progress(iteration: int, objective: float, violation: float) -> bool:
            self.context.progress(stage, None, {"iteration": iteration, "objective": objective, "violation": violation})
            return self.context.interrupted()

        mesh, solver = self.problem.mesh, self.problem.solver
        solution = collocate(
            model,
            Mesh(mesh.elements, mesh.points, control=control),
            guess=guess,
            solver=SolverOptions(
                error_bound=None,  # the kind judges the motion by its re-simulation
                tolerance=solver.tolerance,
                formulation=solver.formulation,
                barrier=solver.barrier if solver.barrier != "auto" else cast(Any, barrier),
                patience=PATIENCE,
                max_iterations=self.left if most is None else most,
                max_seconds=self.context.seconds_left(),
            ),
            progress=progress,
            throw=False,
        )
        self.iterations += solution.iterations
        return solution

    def _over(self, solution: Solution) -> bool:
        """Nothing more can be tried."""
        stopped = solution.status is SolveStatus.INTERRUPTED
        return stopped or self.context.interrupted() or self.left == 0

    def _done(self, solution: Solution) -> bool:
        """Solved within reach, or nothing more can be tried."""
        return (solution.status.converged and self._within(solution)) or self._over(solution)

    def _best(self, tried: list[Solution]) -> Solution:
        """The last one that is solved within reach; else that nearest to keeping its constraints."""
        good = [s for s in tried if s.status.converged and self._within(s)]
        if good or tried[-1].status is SolveStatus.INTERRUPTED:
            return good[-1] if good else tried[-1]
        failed = [s for s in reversed(tried) if not s.status.converged]
        if not failed:
            told = "an optimum was found, but it comes nearer to the edge of reach than limits.link_along_guideway_m"
            return replace(tried[-1], status=SolveStatus.FAILED, message=told)
        nearest = min(failed, key=lambda s: s.checks["constraint_violation"].value)
        if self.left == 0 and nearest.status is not SolveStatus.ITERATION_LIMIT:
            limit = SolveStatus.ITERATION_LIMIT
            message = f"{limit.sentence}; the attempt that came nearest: {nearest.message}"
            nearest = replace(nearest, status=limit, message=message)
        return nearest

    def _within(self, solution: Solution) -> bool:
        run = solution.trajectory
        least = self.problem.limits.link_along_guideway_m
        return "along_guideway" not in run or bool(np.min(run["along_guideway"]) >= least * (1 - 1e-6))


def _loss(solution: Solution, optimum: Solution) -> float:
    return (solution.objective - optimum.objective) / max(abs(optimum.objective), 1e-300)


def _better(a: Solution, b: Solution) -> bool:
    return (a.status.converged, -a.objective) > (b.status.converged, -b.objective)
