"""Solve an Optimization: transcribe, hand over to IPOPT, read the solution back by name."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

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
# elements; on coarser meshes making the merged form takes as long as it spares, and of the time-optimal motions of
# bench_optimize.py IPOPT then takes more iterations on 50 elements (80 for 70, 71 for 54)
MERGED_FROM = 100


@dataclass(frozen=True)
class SolverOptions:
    """How `solve` is to solve.

    Args:
        tolerance: IPOPT's overall tolerance on the scaled problem.
        max_iterations: limit; reached means status iteration_limit with the iterate nearest to its constraints.
        max_seconds: wall-clock limit [s]; reached means status interrupted with the iterate nearest to its constraints.
        formulation: "inverse": controls as functions of the motion, for fully actuated models; "explicit": explicit
            rates; "torn": unknowns without a closed form are kept, with their equations as constraints; "dae": nothing
            is eliminated. "auto" chooses; see optimize.formulation.problem.build.
        prefer: names to keep as states.
        hessian: "exact", or "lbfgs" from gradients alone.
        barrier: how IPOPT lowers its barrier, "adaptive" or "monotone": where one fails, the other may solve in a tenth
            of the iterations. "auto" tries the adaptive one and, where it fails or gets nowhere, the monotone one from
            the same guess; the message says so, and `max_iterations` and `max_seconds` hold for both together. "low"
            begins near the end, for a guess near the optimum, such as that of a coarser mesh.
        patience: iterations without progress, in violation or objective, after which a try fails; one with multipliers
            beyond 1e10 counts as ten. None: no try fails so, but for the first of "auto", after 150.
        solver: "ipopt"; or "fatrop", where states alone link the elements (no free constants, a horizon that is given),
            without progress and time limit.
        error_bound: of the check `discretisation_error` of each solution: the largest estimated error of a state at a
            mesh edge or collocation point, as a part of the state's range (entries of a vector share theirs). A
            solution above it has status check_failed. The same bound holds for `integral_error`: what the mesh misses
            of the integrals in the objective, as a part of the integral of their absolute value. None only reports.
        compile: evaluate the elements by machine code instead of CasADi's virtual machine: the same optimum, and a
            second or two of the C compiler at the first solve, which `seconds["compile"]` shows. The library is kept
            in $GTMODEL_CACHE, by default ~/.cache/gtmodel. For problems that are solved again and again.

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
                "tolerance and max_seconds are numbers and max_iterations is a whole one; found "
                f"{self.tolerance!r}, {self.max_seconds!r} and {self.max_iterations!r}"
            )
        if not 0 < self.tolerance < 1:
            raise ModelError(f"the solver's tolerance is between 0 and 1; found {self.tolerance:g}")
        if self.max_iterations < 0 or (self.max_seconds is not None and not self.max_seconds >= 0):
            raise ModelError(
                f"max_iterations and max_seconds are not negative; found {self.max_iterations} and {self.max_seconds}"
            )
        bound = self.error_bound
        if bound is not None and (not isinstance(bound, (int, float, np.number)) or not bound > 0):
            raise ModelError(f"error_bound is a positive number, or None; found {bound!r}")
        if isinstance(self.prefer, str):
            raise ModelError(f"prefer takes a list of names; found '{self.prefer}'")
        if self.patience is not None and not (isinstance(self.patience, (int, np.integer)) and self.patience > 0):
            raise ModelError(f"patience is a positive number of iterations, or None; found {self.patience!r}")
        known = (("formulation", FORMULATIONS), ("hessian", HESSIANS), ("barrier", BARRIERS), ("solver", SOLVERS))
        for name, words in known:
            if getattr(self, name) not in words:
                raise ModelError(f"{name} is one of {', '.join(words)}; found '{getattr(self, name)}'")
        if self.solver == "fatrop" and (self.hessian != "exact" or self.max_seconds is not None or self.compile):
            raise ModelError("fatrop takes the exact hessian, no max_seconds and no compile; use solver 'ipopt'")
        if self.solver == "fatrop" and (self.barrier != "auto" or self.patience is not None):
            raise ModelError("fatrop has neither barrier strategies nor patience; use solver 'ipopt'")


class NotSolved(RuntimeError):
    """Raised by solve() when the problem was not solved; the message says why, and `.solution` holds the best iterate.

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

    Each solution estimates by how much its states miss the model's on this mesh. Above the options' `error_bound` its
    status is check_failed, which does not raise: the solution is whole, but not the model's; take a finer mesh, or
    `gt.refine`.

    Args:
        model: an Optimization with values for its parameters.
        mesh: elements, points, scheme and control; default 50 x 3 Radau.
        guess: a trajectory with names of states and controls, or an earlier solution.
        scaling: a trajectory, or an earlier solution, whose largest magnitudes take the place of the nominals of the
            variables that it holds, in the solver and wherever "in nominals" is said; constants of a solution too.
        branches: sign +1 or -1 by the name of a declared branch, +1 by default; a solution that leaves it at any
            point has status failed.
        solver: tolerance, limits and methods, see `SolverOptions`.
        progress: called with (iteration, objective, constraint violation); returning True stops the solve,
            keeping the iterate (status interrupted).
        method: "shooting" integrates the equations with CVODES on each element instead (explicit form, Radau points,
            L-BFGS): slower, but without collocation's error.
        throw: raise NotSolved for a problem that was not solved; False: return the best iterate, with its status.

    Raises ModelError for a wrong problem, NotSolved (with the best iterate) unless throw is False, and CompilerMissing
    where machine code is wanted and cannot be made.

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
            f"gt.solve takes a configured Optimization; found {type(model).__name__}; linked phases are solved by "
            "gt.solve_phases"
        )
    mesh = given_mesh(mesh)
    options = solver or SolverOptions()
    if method not in METHODS:
        raise ValueError(f"method is one of {', '.join(METHODS)}; found '{method}'")
    shooting = method == "shooting"
    form = "explicit" if shooting and options.formulation == "auto" else options.formulation
    problem = build(model, form, options.prefer, branches, sizes=scaled_by(scaling))
    nlp = make_nlp(problem, mesh, options.compile and not shooting)
    check_equalities(problem, nlp.element)
    x0 = initial_guess(nlp, guess)
    if shooting:
        if options.solver != "ipopt":
            raise ModelError(f"{problem.flat.title}: shooting takes solver 'ipopt' only; found '{options.solver}'")
        return _answer(nlp, run_shooting(nlp, x0, options, progress), options, throw, exact=True)
    return solve_nlp(nlp, x0, options, progress, throw)


def scaled_by(scaling: Trajectory | Solution | None) -> tuple[tuple[str, float], ...]:
    """Sizes by name, for build(). Raises ModelError for what is neither."""
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
    one = merged(nlp) if nlp.mesh.elements >= MERGED_FROM else None
    if one is None:
        return _answer(nlp, run_ipopt(nlp, x0, options, progress, warm, scale), options, throw, scale)
    x0, warm = one.start(x0, warm)
    return _answer(nlp, one.turned(run_ipopt(one, x0, options, progress, warm, scale)), options, throw, scale)


def _answer(
    nlp: Nlp, run: SolverRun, options: SolverOptions, throw: bool, scale: float = 1.0, exact: bool = False
) -> Solution:
    """The solution by name, with a sentence on how it ended. Raises NotSolved."""
    run = replace(run, indifferent=nlp.problem.indifferent)
    status, said = run.status, ended(run, nlp)
    if status.ok and (elsewhere := astray(nlp, run.x)):
        status, said = SolveStatus.FAILED, elsewhere
    if nlp.compile_seconds is not None:
        run = replace(run, seconds={**run.seconds, "compile": nlp.compile_seconds})
    solution = replace(read_solution(nlp, run.at_best(), status, str(said)), where=said.where)
    began = time.perf_counter()
    solution = judged(solution, options.error_bound, exact, scale)
    if throw and not status.ok:  # a failed check raises nothing: the whole solution is there
        raise NotSolved(solution)
    return replace(solution, seconds={**solution.seconds, "check": time.perf_counter() - began})
