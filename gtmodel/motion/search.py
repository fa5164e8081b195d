"""The search for an optimal motion: the sequence of attempts and their guesses."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, Literal, cast

import numpy as np

from .._lazy import hint
from ..lang import Optimization
from ..optimize import Blocks, Mesh, Solution, SolverOptions, solve as collocate
from ..optimize.judgement.resimulate import Resimulation, resimulate
from ..optimize.multistart import ReachedOptima
from ..optimize.watch import Progress
from ..results import SolveStatus, Trajectory, Work
from ..workers.mapped import mapped
from .constraints import NO_GUARD, MotionConstraints
from .options import MotionMesh, MotionProblem
from .task import FurtherStart, motion

if TYPE_CHECKING:
    from .paths import Path
else:
    Path = hint("gtmodel.motion.paths", "Path")

# iterations without progress after which an attempt is abandoned: of 200 random attempts that reached an optimum one
# needed more, and most of those that failed never recovered
PATIENCE = 60
REPEATED = 4  # consecutive starts without a new optimum that end the search
RESERVE = 200  # iterations reserved for the exported motion, which takes 10 to 70
EXPORT_LOSS = 0.05  # relative cost of a constant force per element; a larger loss indicates another, worse optimum
TIGHTENINGS = 3
OPTIMISING = "optimising"
TIGHTENED = 1e-4  # relative tightening beyond the observed excess
CONTINUATION = (0.01, 0.001)  # weights of the energy, relative to the time's, before the problem's own

Control = Literal["polynomial", "constant"]


@dataclass
class MotionSearch:
    """Successive attempts until one is solved with its links away from the boundary of the workspace.

    The attempts are: without that bound, which is rarely active; with it; with it and the other barrier strategy; from
    the line without a speed profile, since the forces of a profile may be far outside the limits; along a continuation
    from a larger weight of the energy. On a finer mesh, an attempt with a small initial barrier comes first. An attempt
    without progress is abandoned. All attempts, including further starts and the exported motion, share
    `solver.max_iterations` (counted in `iterations`) and the time limit.

    bounded: whether an attempt without the bound on the links failed; then it is always imposed.
    """

    problem: MotionProblem
    work: Work
    guess: Trajectory | Solution
    bare: Trajectory
    guard: MotionConstraints = NO_GUARD
    path: Path | None = None
    iterations: int = 0
    bounded: bool = False
    started: int = field(default=0, init=False)
    reached: ReachedOptima = field(default_factory=ReachedOptima, init=False)

    @cached_property
    def plain(self) -> Optimization:
        return motion(self.problem, self.guard, self.path)

    @cached_property
    def guarded(self) -> Optimization:
        return motion(self.problem, self.guard, self.path, guarded=True)

    def go_on(self, problem: MotionProblem, guess: Solution) -> None:
        """Continue with another mesh from a solution; iterations keep counting."""
        self.problem, self.guess = problem, guess

    def optimum(self) -> Solution:
        """Return the optimum with the problem's control; if there is none, the best attempt."""
        problem, control = self.problem, self.problem.mesh.control
        solutions: list[Solution] = []
        attempts = [(True, self.guess, "adaptive"), (True, self.guess, "monotone"), (True, self.bare, "adaptive")]
        if problem.solver.barrier != "auto":
            attempts.pop(1)
        if isinstance(self.guess, Solution):  # of a coarser mesh
            attempts.insert(0, (self.bounded, self.guess, "low"))
        elif not self.bounded:
            attempts.insert(0, (False, self.guess, "adaptive"))
        for guarded, guess, barrier in attempts:
            solutions.append(self._attempt(self.guarded if guarded else self.plain, control, guess, barrier))
            if self._finished(solutions[-1]):
                return self._best(solutions)
            self.bounded = True
        start: Trajectory | Solution = self.bare
        for weight in CONTINUATION:
            energy = weight * (problem.cost.time or 1.0)
            if energy > problem.cost.energy:
                heavier = replace(problem, cost=replace(problem.cost, energy=energy))
                step = self._attempt(motion(heavier, self.guard, self.path, guarded=True), control, start)
                if self._over(step):
                    return self._best(solutions)  # a continuation step is not an optimum of the problem
                start = step if step.status.converged else start
        return self._best([*solutions, self._attempt(self.guarded, control, start)])

    def from_starts(self, starts: Iterable[FurtherStart]) -> list[Solution]:
        """Return optima from further starts, with the bound on the links, and record them in `reached`.

        Failed starts are left out. The search ends after `REPEATED` consecutive starts without a new optimum, or when
        time or iterations run out.
        """
        solutions: list[Solution] = []
        control, model = self.problem.mesh.control, self.guarded
        task = partial(_collocated, model, _collocation_mesh(self.problem.mesh, control))

        def over() -> bool:
            return self.left <= RESERVE or self.reached.repeated >= REPEATED

        def items() -> Iterator[tuple[Trajectory, SolverOptions]]:
            for start in starts:
                if self.work.interrupted() or over():
                    break
                yield start.guess, self._options(start.barrier, self.left - RESERVE)

        def here(item: tuple[Trajectory, SolverOptions]) -> Solution:
            self.work.progress("collocation")
            return task(item, progress=self.work.iterations(OPTIMISING))

        for solution in mapped(task, items(), here=here, waiting=self.work.interrupted):
            if over():  # a worker was ahead
                break
            # the same as if this start had begun when the one before was done
            most = self.left - RESERVE
            converged = solution.status.converged and solution.iterations <= most
            self.iterations += min(solution.iterations, most)
            self.started += 1
            self.reached.add(solution.objective if converged else None)
            self.work.progress(f"{self.started} further starts done")
            if converged:
                solutions.append(solution)
        return solutions

    @property
    def left(self) -> int:
        """Remaining iterations."""
        return max(0, self.problem.solver.max_iterations - self.iterations)

    def exportable_tried(self, optimum: Solution, tried: Resimulation) -> tuple[Solution, Resimulation]:
        """Return the exported motion and its re-simulation.

        If forces are not the control they may exceed their limit between the points; the limit is then lowered by the
        observed excess and the motion solved again.
        """
        if self.problem.mesh.control == "constant":
            solution, run = optimum, tried
        else:
            solution = self.exportable(optimum)
            run = resimulate(solution) if solution.status.converged else tried
        limit, search = self.problem.limits.force, self
        for _ in range(TIGHTENINGS):
            if not solution.status.converged or run.trajectory is None or self.problem.order is None:
                break
            peak = float(np.max(np.abs(run.trajectory["robot.tau"])))
            if peak <= limit:
                break
            lower = search.problem.limits.force * (limit / peak) * (1 - TIGHTENED)
            problem = replace(self.problem, limits=replace(self.problem.limits, force=lower))
            search = MotionSearch(
                problem, self.work, self.guess, self.bare, self.guard, self.path, self.iterations, self.bounded
            )
            solution = search.exportable(optimum)
            self.iterations = search.iterations
            run = resimulate(solution) if solution.status.converged else run
        return solution, run

    def exportable(self, optimum: Solution) -> Solution:
        """Return the optimum with forces constant on each element: the best of several attempts."""
        best: Solution | None = None
        attempts = [(self.bounded, optimum, "low"), (True, optimum, "auto"), (True, self.guess, "auto")]
        for guarded, guess, barrier in attempts:
            solution = self._attempt(self.guarded if guarded else self.plain, "constant", guess, barrier)
            if best is None or _better(solution, best):
                best = solution
            if self._over(solution) or (self._finished(solution) and _loss(solution, optimum) <= EXPORT_LOSS):
                break
            self.bounded = True
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
        """Make one attempt; barrier: used if the problem's strategy is "auto"."""
        own_control = control == self.problem.mesh.control
        stage = OPTIMISING if own_control else "optimising with bounds on the force between the nodes"
        self.work.progress("collocation")
        solution = _collocated(
            model, _collocation_mesh(self.problem.mesh, control),
            (guess, self._options(barrier, self.left if most is None else most)), progress=self.work.iterations(stage),
        )  # fmt: skip
        self.iterations += solution.iterations
        return solution

    def _options(self, barrier: str, most: int) -> SolverOptions:
        solver = self.problem.solver
        return SolverOptions(
            error_bound=None,  # the study judges the motion by its re-simulation
            tolerance=solver.tolerance,
            formulation=solver.formulation,
            barrier=solver.barrier if solver.barrier != "auto" else cast(Any, barrier),
            patience=PATIENCE,
            max_iterations=most,
            max_seconds=self.work.seconds_left(),
        )

    def _over(self, solution: Solution) -> bool:
        """Return whether no further attempt is possible."""
        stopped = solution.status is SolveStatus.INTERRUPTED
        return stopped or self.work.interrupted() or self.left == 0

    def _finished(self, solution: Solution) -> bool:
        """Return whether the attempt is solved within reach, or no further attempt is possible."""
        return (solution.status.converged and self._within(solution)) or self._over(solution)

    def _best(self, solutions: list[Solution]) -> Solution:
        """Return the last attempt solved within reach, else the one with the smallest violation."""
        good = [s for s in solutions if s.status.converged and self._within(s)]
        if good or solutions[-1].status is SolveStatus.INTERRUPTED:
            return good[-1] if good else solutions[-1]
        failed = [s for s in reversed(solutions) if not s.status.converged]
        if not failed:
            sentence = (
                "an optimum was found, but it violates limits.link_along_guideway_m at the boundary of the workspace"
            )
            return replace(solutions[-1], status=SolveStatus.FAILED, message=sentence)
        nearest = min(failed, key=lambda s: s.checks["constraint_violation"].value)
        if self.left == 0 and nearest.status is not SolveStatus.ITERATION_LIMIT:
            limit = SolveStatus.ITERATION_LIMIT
            message = f"{limit.message}; the attempt with the smallest violation: {nearest.message}"
            nearest = replace(nearest, status=limit, message=message)
        return nearest

    def _within(self, solution: Solution) -> bool:
        run = solution.trajectory
        least = self.problem.limits.link_along_guideway
        return "along_guideway" not in run or bool(np.min(run["along_guideway"]) >= least * (1 - 1e-6))


def _collocated(
    model: Optimization, mesh: Mesh, item: tuple[Trajectory | Solution, SolverOptions], progress: Progress | None = None
) -> Solution:
    guess, solver = item
    return collocate(model, mesh, guess=guess, solver=solver, progress=progress, throw=False)


def _collocation_mesh(mesh: MotionMesh, control: Control) -> Mesh:
    sizes = {f"robot.tau[{i}]": n for i, n in enumerate(mesh.blocks or ())}
    return Mesh(mesh.elements, mesh.points, control=control, blocks=Blocks(sizes=sizes) if sizes else None)


def _loss(solution: Solution, optimum: Solution) -> float:
    return (solution.objective - optimum.objective) / max(abs(optimum.objective), 1e-300)


def _better(a: Solution, b: Solution) -> bool:
    return (a.status.converged, -a.objective) > (b.status.converged, -b.objective)
