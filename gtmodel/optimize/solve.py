"""Solve an Optimization: transcribe it, run IPOPT, and read the solution back by name."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from .._pickling import PortableError
from ..lang.model import Model
from ..lang.optimization import Optimization
from ..lang.slips import named
from ..lang.source import ModelError
from ..results.status import SolveStatus
from ..results.trajectory import Trajectory
from .formulation.problem import FORMULATIONS, build
from .formulation.scaling import objective_scale, of_trajectory
from .guess import initial_guess
from .ipopt import BARRIERS, HESSIANS, SolverRun, run_ipopt
from .judgement.checks import astray, check_equalities
from .judgement.diagnosis import ended
from .judgement.discretisation import BOUND, judged
from .mesh import Mesh, given_mesh
from .nlp import Nlp, make_nlp
from .nlp_forms import Staged, merged
from .shooting import run_shooting
from .solution import Solution, read_solution
from .watch import Multipliers, Progress

SOLVERS = ("ipopt", "fatrop")
METHODS = ("collocation", "shooting")
# elements; on coarser meshes building the merged form takes as long as it saves, and for the time-optimal motions in
# bench_optimize.py on 50 elements IPOPT then takes more iterations (80 instead of 70, 71 instead of 54)
MERGED_FROM = 100


@dataclass(frozen=True)
class SolverOptions:
    """Options of `solve`.

    Args:
        tolerance: IPOPT's overall tolerance on the scaled problem.
        max_iterations: limit. If it is reached, the status is iteration_limit and the iterate with the smallest
            violation is returned.
        max_seconds: wall-clock limit [s]. If it is reached, the status is interrupted and the iterate with the smallest
            violation is returned.
        formulation: "inverse": controls as functions of the motion, for fully actuated models; "explicit": explicit
            rates; "torn": unknowns without a closed form are kept, with their equations as constraints; "dae": nothing
            is eliminated. "auto" chooses; see optimize.formulation.problem.build.
        prefer: names to keep as states.
        hessian: "exact", or "lbfgs" (from gradients only).
        barrier: IPOPT's barrier strategy, "adaptive" or "monotone"; if one fails, the other may solve the problem in a
            tenth of the iterations. "auto" tries the adaptive strategy and, if it fails or makes no progress, the
            monotone one from the same guess; the message says so, and both share `max_iterations` and `max_seconds`.
            "low" starts with a small barrier, for a guess near the optimum, such as a solution on a coarser mesh.
        patience: number of iterations without progress in violation or objective after which a try fails; an iteration
            with multipliers above 1e10 counts as ten. None: no limit, except 150 for the first try of "auto".
        solver: "ipopt"; or "fatrop" if only states couple the elements (no free constants, fixed horizon). fatrop has
            neither progress nor a time limit.
        error_bound: bound of the check `discretisation_error`: the largest estimated error of a state at a mesh edge or
            collocation point, relative to the state's range (entries of a vector share one range). A solution above it
            has status check_failed. The same bound applies to `integral_error`: the estimated error of the integrals
            in the objective, relative to the integral of their absolute value. None: report only.
        compile: compile the element functions to machine code: the same optimum, for a second or two of compilation
            at the first solve (`seconds["compile"]`). The library is cached in $GTMODEL_CACHE, by default
            ~/.cache/gtmodel. Worthwhile for problems that are solved repeatedly.

    Raises ModelError, which is a ValueError, for a number out of range or an unknown word.

    >>> gt.SolverOptions(tolerance=1e-10, max_seconds=60.0).barrier
    'auto'
    >>> gt.SolverOptions(solver="snopt")
    Traceback (most recent call last):
        ...
    gtmodel.lang.source.ModelError: solver is one of ipopt, fatrop; found 'snopt'
    """

    tolerance: float = 1e-8
    max_iterations: int = 1000
    max_seconds: float | None = None
    formulation: Literal["auto", "inverse", "explicit", "torn", "dae"] = "auto"
    prefer: tuple[str, ...] = ()
    hessian: Literal["exact", "lbfgs"] = "exact"
    barrier: Literal["auto", "adaptive", "monotone", "low"] = "auto"
    patience: int | None = None
    solver: Literal["ipopt", "fatrop"] = "ipopt"
    compile: bool = False
    error_bound: float | None = BOUND

    def __post_init__(self) -> None:
        numbers = (self.tolerance, self.max_iterations, 0 if self.max_seconds is None else self.max_seconds)
        if not all(isinstance(n, (int, float, np.number)) for n in numbers) or self.max_iterations % 1:
            raise ModelError(
                "tolerance and max_seconds must be numbers and max_iterations an integer; found "
                f"{self.tolerance!r}, {self.max_seconds!r} and {self.max_iterations!r}"
            )
        if not 0 < self.tolerance < 1:
            raise ModelError(f"tolerance must lie between 0 and 1; found {self.tolerance:g}")
        if self.max_iterations < 0 or (self.max_seconds is not None and not self.max_seconds >= 0):
            raise ModelError(
                f"max_iterations and max_seconds must be >= 0; found {self.max_iterations} and {self.max_seconds}"
            )
        bound = self.error_bound
        if bound is not None and (not isinstance(bound, (int, float, np.number)) or not bound > 0):
            raise ModelError(f"error_bound must be a positive number or None; found {bound!r}")
        if isinstance(self.prefer, str):
            raise ModelError(f"prefer takes a list of names; found '{self.prefer}'")
        if self.patience is not None and not (isinstance(self.patience, (int, np.integer)) and self.patience > 0):
            raise ModelError(f"patience must be a positive number of iterations or None; found {self.patience!r}")
        known = (("formulation", FORMULATIONS), ("hessian", HESSIANS), ("barrier", BARRIERS), ("solver", SOLVERS))
        for name, words in known:
            if getattr(self, name) not in words:
                raise ModelError(f"{name} is one of {', '.join(words)}; found '{getattr(self, name)}'")
        if self.solver == "fatrop" and (self.hessian != "exact" or self.max_seconds is not None or self.compile):
            raise ModelError("fatrop supports neither lbfgs nor max_seconds nor compile; use solver 'ipopt'")
        if self.solver == "fatrop" and (self.barrier != "auto" or self.patience is not None):
            raise ModelError("fatrop has neither barrier strategies nor patience; use solver 'ipopt'")


class NotSolved(PortableError, RuntimeError):
    """Raised by solve() if the problem was not solved; the message says why, `.solution` is the best iterate.

    >>> class Unreachable(gt.Optimization):
    ...     x = gt.variable(start=0.0, fixed=True)
    ...     u = gt.input(min=-1.0, max=1.0)
    ...     def equations(self):
    ...         yield gt.der(self.x) == self.u
    ...     def objective(self):
    ...         return gt.integral(self.u**2)
    ...     def constraints(self):
    ...         yield self.x.at(self.final_time) == 5.0  # in 1 s at a rate of at most 1
    >>> try:
    ...     gt.solve(Unreachable(), gt.Mesh(2))
    ... except gt.NotSolved as error:
    ...     print(error.solution.status.value)
    infeasible
    """

    def __init__(self, solution: Any) -> None:
        super().__init__(solution.message)
        self.solution = solution


@named
def solve(
    model: Optimization,
    mesh: Mesh | None = None,
    *,
    guess: Trajectory | Solution | None = None,
    scaling: Trajectory | Solution | None = None,
    branches: Mapping[str, int] | None = None,
    solver: SolverOptions | None = None,
    progress: Progress | None = None,
    method: Literal["collocation", "shooting"] = "collocation",
    throw: bool = True,
) -> Solution:
    """Solve an optimisation by direct collocation, or by multiple shooting as a cross-check.

    Each solution includes an estimate of its discretisation error. If this exceeds the options' `error_bound`, the
    status is check_failed. That does not raise: the solution is complete, but the mesh does not resolve the model; use
    a finer mesh, or `gt.refine`.

    Args:
        model: an Optimization with values for its parameters.
        mesh: elements, points, scheme and control; default 50 x 3 Radau.
        guess: a trajectory with names of states and controls, or an earlier solution.
        scaling: a trajectory or an earlier solution; the largest magnitudes of its variables (and, of a solution, its
            constants) replace their nominals in the solver and in all quantities reported "in nominals".
        branches: sign +1 or -1 by name of a declared branch, +1 by default; a solution that leaves its branch at any
            point has status failed.
        solver: tolerance, limits and methods, see `SolverOptions`.
        progress: called with (iteration, objective, constraint violation); returning True stops the solve and keeps
            the iterate (status interrupted).
        method: "shooting" integrates the equations with CVODES on each element instead (explicit form, Radau points,
            L-BFGS): slower, but without collocation error.
        throw: raise NotSolved if the problem was not solved; False: return the best iterate with its status.

    Raises ModelError for a wrong problem, NotSolved (with the best iterate) unless throw is False, and CompilerMissing
    if compile is set and compilation fails.

    >>> class Move(gt.Optimization):  # 1 m in 1 s from rest to rest, with the least squared acceleration
    ...     x = gt.variable(unit="m", start=0.0, fixed=True)
    ...     v = gt.variable(unit="m/s", start=0.0, fixed=True)
    ...     a = gt.input(unit="m/s2")
    ...     def equations(self):
    ...         yield gt.der(self.x) == self.v
    ...         yield gt.der(self.v) == self.a
    ...     def objective(self):
    ...         return gt.integral(self.a**2)
    ...     def constraints(self):
    ...         yield self.x.at(self.final_time) == 1.0
    ...         yield self.v.at(self.final_time) == 0.0
    >>> solution = gt.solve(Move(), gt.Mesh(5))
    >>> round(solution.objective, 6)  # of a = 6 - 12 t
    12.0
    >>> round(float(solution.trajectory["x"][-1]), 6)
    1.0
    """
    if not isinstance(model, Model) and not isinstance(model, type):
        raise ModelError(
            f"gt.solve takes a configured Optimization; found {type(model).__name__}. Use gt.solve_phases for linked "
            "phases"
        )
    mesh = given_mesh(mesh)
    options = solver or SolverOptions()
    if method not in METHODS:
        raise ValueError(f"method must be one of {', '.join(METHODS)}; found '{method}'")
    shooting = method == "shooting"
    form = "explicit" if shooting and options.formulation == "auto" else options.formulation
    problem = build(model, form, options.prefer, branches, sizes=scaled_by(scaling))
    nlp = make_nlp(problem, mesh, options.compile and not shooting)
    check_equalities(problem, nlp.element)
    x0 = initial_guess(nlp, guess)
    if shooting:
        if options.solver != "ipopt":
            raise ModelError(f"{problem.flat.title}: shooting needs solver 'ipopt'; found '{options.solver}'")
        return _answer(nlp, run_shooting(nlp, x0, options, progress), options, throw, exact=True)
    return solve_nlp(nlp, x0, options, progress, throw)


def scaled_by(scaling: Trajectory | Solution | None) -> tuple[tuple[str, float], ...]:
    """Return sizes by name, for build(). Raises ModelError for another type."""
    if isinstance(scaling, Solution):
        return of_trajectory(scaling.trajectory, scaling.free)
    return of_trajectory(scaling, {})


def solve_nlp(
    nlp: Nlp,
    x0: np.ndarray,
    options: SolverOptions,
    progress: Progress | None = None,
    throw: bool = True,
    warm: Multipliers | None = None,
) -> Solution:
    """Run IPOPT on a transcribed problem from scaled unknowns x0."""
    scale = objective_scale(nlp, x0, nlp.problem.misfits)
    if options.solver == "fatrop":
        staged = Staged(nlp, scale)
        run = run_ipopt(staged, x0, options)
        return _answer(nlp, staged.turned(run), options, throw, scale)
    form = merged(nlp) if nlp.mesh.elements >= MERGED_FROM else None
    if form is None:
        return _answer(nlp, run_ipopt(nlp, x0, options, progress, warm, scale), options, throw, scale)
    x0, warm = form.start(x0, warm)
    return _answer(nlp, form.turned(run_ipopt(form, x0, options, progress, warm, scale)), options, throw, scale)


def _answer(
    nlp: Nlp, run: SolverRun, options: SolverOptions, throw: bool, scale: float = 1.0, exact: bool = False
) -> Solution:
    """Return the solution by name, with a message on how the solve ended. Raises NotSolved."""
    run = replace(run, indifferent=nlp.problem.indifferent)
    status, remark = run.status, ended(run, nlp)
    if status.ok and (elsewhere := astray(nlp, run.x)):
        status, remark = SolveStatus.FAILED, elsewhere
    if nlp.compile_seconds is not None:
        run = replace(run, seconds={**run.seconds, "compile": nlp.compile_seconds})
    solution = replace(read_solution(nlp, run.at_best(), status, str(remark)), where=remark.where)
    began = time.perf_counter()
    solution = judged(solution, options.error_bound, exact, scale)
    if throw and not status.ok:  # a failed check does not raise: the solution is complete
        raise NotSolved(solution)
    return replace(solution, seconds={**solution.seconds, "check": time.perf_counter() - began})
