"""Optimal control study: solve by collocation, then re-simulate the input with an error-controlled integrator."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, Unpack

from .. import view
from ..compiler.toolchain import CompilerMissing
from ..lang import ModelError, Optimization
from ..results import ArgumentError, Check, Trajectory, Work
from ..results.work import WorkOptions, study_function
from .formulation.horizon import declared_name
from .ipopt import TRIED_AGAIN
from .judgement.discretisation import BOUND, discretisation
from .judgement.resimulate import Resimulation, resimulate
from .mesh import Mesh
from .optimization_result import TRIED, OptimizationStudy
from .solution import Solution
from .solve import SolverOptions, solve

# of a row's range, and of the objective: ten times the bound of the mesh's own errors. A control polynomial that jumps
# from one bound to the other overshoots by 30 to 50 % of their distance on any mesh, and no machine follows it
GROSS = 0.1
SEEN = 1e-6  # of a row's range: the bound of the check constraint_violation
MOST_NOTES = 6
LEAST_COST = 1e-6  # an objective below this is zero to the solver's tolerance


@study_function
def optimization_study(
    problem: Optimization,
    mesh: Mesh | None = None,
    *,
    guess: Trajectory | None = None,
    second_guess: Callable[[], Trajectory | None] | None = None,
    solver: SolverOptions | None = None,
    **work_options: Unpack[WorkOptions],
) -> OptimizationStudy:
    """Solve an optimal control problem and, if the solver converged, re-simulate the optimal input.

    Args:
        problem: the Optimization. mesh, guess, solver: as for `solve`.
        second_guess: called if the solver fails from the first guess; returns another guess, or None. A note says so.
        progress, max_seconds, stop: see `gtmodel.results.Work`; the solver's own time limit applies too.

    A study fails a check if, re-simulated, a bound or path constraint is exceeded by more than a tenth of its range, or
    the cost differs by more than a tenth. An interrupted study contains the best iterate. Raises ArgumentError, and
    ModelError for a wrong problem.

    >>> import gtmodel as gt
    >>> from gtmodel import der
    >>> class Rest(gt.Optimization):
    ...     x = gt.variable(start=1.0, fixed=True)
    ...     u = gt.input(min=-1.0, max=1.0)
    ...     final_time = 1.0
    ...     def equations(self):
    ...         yield der(self.x) == self.u
    ...     def objective(self):
    ...         return gt.integral(self.x**2 + self.u**2)
    >>> s = gt.optimize.optimization_study(Rest(), gt.optimize.Mesh(elements=5))
    >>> round(s.objective, 4)  # tanh(1)
    0.7616
    """
    work = Work(**work_options)
    solver = solver or SolverOptions()

    def reported(iteration: int, objective: float, violation: float) -> bool:
        numbers = {"iteration": iteration, "objective": objective, "violation": violation}
        work.progress("optimising", None, numbers)
        return work.interrupted()

    def solved(start: Trajectory | None) -> Solution:
        limits = [x for x in (solver.max_seconds, work.seconds_left()) if x is not None]
        try:
            return solve(
                problem, mesh or Mesh(), guess=start, solver=replace(solver, max_seconds=min(limits, default=None)),
                progress=reported, throw=False,
            )  # fmt: skip
        except CompilerMissing as error:
            raise ArgumentError(str(error), "solver.compile") from None

    notes = list(type(problem)._notes)
    solution = solved(guess)
    if solution.status in TRIED_AGAIN and second_guess is not None and (start := second_guess()) is not None:
        second = solved(start)
        if second.status.converged:
            notes.append(f"solved from the second guess, a simulation; from the first guess: {solution.status.message}")
            solution = second
    run, message = _resimulated(solution) if solution.status.converged else (None, solution.message)
    checks = dict(solution.checks)
    if run is not None:
        more, remarks = _between(solution, run)
        checks |= more
        notes += [*remarks, *_free_starts(solution)]
    return OptimizationStudy(
        status=solution.status,
        message=message,
        title=work.title,
        notes=notes,
        objective=solution.objective,
        iterations=solution.iterations,
        checks=checks,
        trajectory=solution.trajectory,
        solution=solution,
        final_time=solution.final_time,
        where=None if solution.where is None else str(solution.where),
        free=dict(solution.free),
        figures={"states": partial(_figure, solution, work.title or solution.problem.flat.title)},
        scenes={"motion": partial(view.scene, problem, solution.trajectory)} if view.points_of(problem) else {},
        **({} if run is None else _numbers(run)),
    )


def _figure(solution: Solution, title: str) -> Any:
    from ..plot.motion import optimum_figure

    problem = solution.problem
    bounds = {}
    for names, of in ((problem.state_names, problem.x_bounds), (problem.control_names, problem.u_bounds)):
        bounds |= dict(zip(names, zip(of.low.tolist(), of.high.tolist(), strict=True), strict=False))
    controls = {name.partition("[")[0] for name in problem.control_names}
    return optimum_figure(solution.trajectory, sorted(controls), bounds, steps=solution.nlp.mesh.control == "constant",
                          title=title)  # fmt: skip


def _resimulated(solution: Solution) -> tuple[Resimulation | None, str]:
    """Re-simulate the optimal input; return the run (None if it cannot run) and the message."""
    try:
        run = resimulate(solution)
    except ModelError as error:
        return None, f"{solution.message}; not re-simulated: {error}"
    if run.trajectory is None:
        return None, f"{solution.message}; not re-simulated: {run.message}"
    clean = solution.status.ok and not solution.reservation
    return run, f"{solution.message}{' and' if clean else ';'} re-simulated"


def _numbers(run: Resimulation) -> dict[str, Any]:
    numbers: dict[str, Any] = dict(zip(TRIED, (run.defect, run.violation, run.cost_error), strict=True))
    if run.violation_share > SEEN:
        numbers |= {"violated": run.violated, "violated_at": run.violation_time,
                    "violation_unit": run.violation_unit or None}  # fmt: skip
    return numbers


def _between(solution: Solution, run: Resimulation) -> tuple[dict[str, Check], list[str]]:
    """Return the checks of the re-simulated optimum, and sentences about the numbers that pass but show in a plot.

    If the model is unstable along the optimum, the input alone does not determine the motion: what follows from that is
    told and not checked.
    """
    cost = abs(run.cost_error) / max(abs(solution.objective), LEAST_COST)
    unstable = max(cost, run.violation_share) > GROSS and discretisation(solution.nlp, solution.x).shadow
    advice = f"use more elements (mesh.elements is {solution.nlp.mesh.elements})"
    if unstable:
        advice = (
            f"the model is unstable here, and its input alone does not reproduce the motion: add feedback, or {advice}"
        )
    unit = f" {run.violation_unit}" if run.violation_unit else ""
    overshoot = run.violated in solution.problem.control_names
    over = (
        f"'{run.violated}' exceeds its bound by {run.violation:.3g}{unit} at {run.violation_time:.4g} s, between "
        "collocation points; "
    )
    linear = overshoot and solution.nlp.mesh.control == "polynomial"
    over += 'use mesh.control = "linear", which keeps it within its bounds' if linear else advice
    dear = f"the re-simulated cost differs by {100 * cost:.3g} %; {advice}"
    numbers = {
        "excess_between_nodes": (Check(run.violation_share, GROSS, over), overshoot),
        "relative_cost_error": (Check(cost, GROSS, dear), False),
    }
    checks = {name: check for name, (check, exact) in numbers.items() if exact or not unstable}
    return checks, [c.advice for n, (c, _) in numbers.items() if c.value > BOUND and (n not in checks or c.passed)]


def _free_starts(solution: Solution) -> list[str]:
    """Return a sentence about each state whose start neither a bound nor an equation gives."""
    nlp, problem = solution.nlp, solution.problem
    columns = nlp.element.layout.left[: len(problem.state_pairs)]
    first = nlp.element.rows.numel() * nlp.mesh.elements
    equal = {first + n for n, row in enumerate(problem.points) if row.low == row.high}
    met = {j for i, j in zip(*nlp.functions["jac_g"].sparsity_out(1).get_triplet(), strict=True) if i in equal}
    sentences = []
    for column, pair in zip(columns.tolist(), problem.state_pairs, strict=True):
        if nlp.lbx[column] < nlp.ubx[column] and column not in met:
            name, where = declared_name(problem.flat, problem.plan.alias, pair)
            value, unit = solution.x[column] * nlp.element.layout.scale[column], problem.flat.unit_of(*pair)
            chosen = f"{value:.4g}" + ("" if unit in ("?", "1") else f" {unit}")
            sentences.append(f"the initial value of '{name}' is free; the optimiser chose {chosen} ({where})")
    return sentences[:MOST_NOTES]
