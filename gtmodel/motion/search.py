"""The search for an optimal motion: which problems are tried one after the other, from which guess."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, cast

import numpy as np

from .._lazy import hint
from ..lang import Optimization
from ..optimize import Mesh, Solution, SolverOptions, solve as collocate
from ..optimize.judgement.resimulate import Resimulation, resimulate
from ..optimize.multistart import ReachedOptima
from ..results import SolveStatus, Trajectory, Work
from .constraints import NO_GUARD, MotionConstraints
from .options import MotionProblem
from .task import FurtherStart, motion

if TYPE_CHECKING:
    from .paths import Path
else:
    Path = hint("gtmodel.motion.paths", "Path")

# iterations without progress after which an attempt has lost its way, and another one is the better bet: of 200 drawn
# attempts that ended in an optimum one waited longer, those that ended in none mostly never came back
PATIENCE = 60
REPEATED = 4  # so many starts without a new optimum, of every kind at first, end the search for others
RESERVE = 200  # iterations that further starts leave to the exported motion; it takes 10 to 70
EXPORT_LOSS = 0.05  # a constant force per element costs less than this; more is a sign of another, worse optimum
TIGHTENINGS = 3
TIGHTENED = 1e-4  # relative, beyond what was seen
CONTINUATION = (0.01, 0.001)  # weights of the energy, in units of the time's, on the way to the problem's own

Control = Literal["polynomial", "constant"]


@dataclass
class MotionSearch:
    """Attempts in turn, until one is solved and keeps its links off the edge of reach.

    First without that bound, which an optimum seldom feels; then with it, and with it and the other barrier strategy;
    on a finer mesh before these with the barrier begun near its end;
    then from the bare line, since the forces of a profile may lie far outside the limits; then along a continuation
    from a heavier weight of the energy. An attempt that gets nowhere makes room for the next. All attempts, those from
    further starts and at the exported motion too, share `solver.max_iterations`, which `iterations` counts, and the
    time limit.

    bounded: whether an attempt without the bound of the links failed, so that none is made again.
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
        """From here on with another mesh, from what was solved; iterations are counted on."""
        self.problem, self.guess = problem, guess

    def optimum(self) -> Solution:
        """The optimum with the control that the problem asks for; where none is found, the best attempt."""
        problem, control = self.problem, self.problem.mesh.control
        tried: list[Solution] = []
        ways = [(True, self.guess, "adaptive"), (True, self.guess, "monotone"), (True, self.bare, "adaptive")]
        if problem.solver.barrier != "auto":
            ways.pop(1)
        if isinstance(self.guess, Solution):  # of a coarser mesh
            ways.insert(0, (self.bounded, self.guess, "low"))
        elif not self.bounded:
            ways.insert(0, (False, self.guess, "adaptive"))
        for guarded, guess, barrier in ways:
            tried.append(self._attempt(self.guarded if guarded else self.plain, control, guess, barrier))
            if self._done(tried[-1]):
                return self._best(tried)
            self.bounded = True
        start: Trajectory | Solution = self.bare
        for weight in CONTINUATION:
            energy = weight * (problem.cost.time or 1.0)
            if energy > problem.cost.energy:
                heavier = replace(problem, cost=replace(problem.cost, energy=energy))
                step = self._attempt(motion(heavier, self.guard, self.path, guarded=True), control, start)
                if self._over(step):
                    return self._best(tried)  # a step is no optimum of the problem itself
                start = step if step.status.converged else start
        return self._best([*tried, self._attempt(self.guarded, control, start)])

    def from_starts(self, starts: Iterable[FurtherStart]) -> list[Solution]:
        """Optima from further starts, links kept off the edge of reach, noted in `reached`.

        Starts that end in none are left out, and those for which there is no time or no iteration left, and all further
        ones after `REPEATED` in a row that only repeat.
        """
        solutions: list[Solution] = []
        for start in starts:
            if self.work.interrupted() or self.left <= RESERVE or self.reached.repeated >= REPEATED:
                break
            control, most = self.problem.mesh.control, self.left - RESERVE
            solution = self._attempt(self.guarded, control, start.guess, start.barrier, most)
            self.started += 1
            self.reached.add(solution.objective if solution.status.converged else None)
            if solution.status.converged:
                solutions.append(solution)
        return solutions

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
        """The optimum among forces that are constant on each element: the best of some attempts."""
        best: Solution | None = None
        ways = [(self.bounded, optimum, "low"), (True, optimum, "auto"), (True, self.guess, "auto")]
        for guarded, guess, barrier in ways:
            solution = self._attempt(self.guarded if guarded else self.plain, "constant", guess, barrier)
            if best is None or _better(solution, best):
                best = solution
            if self._over(solution) or (self._done(solution) and _loss(solution, optimum) <= EXPORT_LOSS):
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
        """One attempt, with a barrier strategy where the problem leaves it open."""
        wanted = control == self.problem.mesh.control
        stage = "optimising" if wanted else "bounding the force between the nodes"
        mesh, solver = self.problem.mesh, self.problem.solver
        self.work.progress("collocation")
        solution = collocate(
            model,
            Mesh(mesh.elements, mesh.points, control=control),
            guess=guess,
            solver=SolverOptions(
                error_bound=None,  # the study judges the motion by its re-simulation
                tolerance=solver.tolerance,
                formulation=solver.formulation,
                barrier=solver.barrier if solver.barrier != "auto" else cast(Any, barrier),
                patience=PATIENCE,
                max_iterations=self.left if most is None else most,
                max_seconds=self.work.seconds_left(),
            ),
            progress=self.work.iterations(stage),
            throw=False,
        )
        self.iterations += solution.iterations
        return solution

    def _over(self, solution: Solution) -> bool:
        """Nothing more can be tried."""
        stopped = solution.status is SolveStatus.INTERRUPTED
        return stopped or self.work.interrupted() or self.left == 0

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
            sentence = (
                "an optimum was found, but it comes nearer to the edge of reach than limits.link_along_guideway_m"
            )
            return replace(tried[-1], status=SolveStatus.FAILED, message=sentence)
        nearest = min(failed, key=lambda s: s.checks["constraint_violation"].value)
        if self.left == 0 and nearest.status is not SolveStatus.ITERATION_LIMIT:
            limit = SolveStatus.ITERATION_LIMIT
            message = f"{limit.message}; the attempt that came nearest: {nearest.message}"
            nearest = replace(nearest, status=limit, message=message)
        return nearest

    def _within(self, solution: Solution) -> bool:
        run = solution.trajectory
        least = self.problem.limits.link_along_guideway
        return "along_guideway" not in run or bool(np.min(run["along_guideway"]) >= least * (1 - 1e-6))


def _loss(solution: Solution, optimum: Solution) -> float:
    return (solution.objective - optimum.objective) / max(abs(optimum.objective), 1e-300)


def _better(a: Solution, b: Solution) -> bool:
    return (a.status.converged, -a.objective) > (b.status.converged, -b.objective)
