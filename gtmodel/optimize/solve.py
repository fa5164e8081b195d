"""Solve an Optimization: transcribe, hand over to IPOPT, read the solution back by name."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import casadi as ca
import numpy as np

from ..lang.optimization import Optimization
from ..results.status import SolveStatus
from ..results.trajectory import Trajectory
from .assembly import wrong_branch
from .equalities import check_equalities
from .guess import initial_guess
from .mesh import Mesh
from .nlp import Nlp, make_nlp
from .problem import FORMULATIONS, build
from .solution import Solution, read_solution

Progress = Callable[[int, float, float], bool]
HESSIANS = {"exact": "exact", "lbfgs": "limited-memory"}


@dataclass(frozen=True)
class SolverOptions:
    """How to solve.

    Args:
        tolerance: IPOPT's overall tolerance on the scaled problem.
        max_iterations: limit; reached means status iteration_limit with the best iterate.
        max_seconds: wall-clock limit; reached means status interrupted with the best iterate.
        formulation: "auto", "inverse", "explicit", "torn" or "dae" (see optimize.problem.build).
        prefer: names to keep as states.
        hessian: "exact", or "lbfgs" from gradients alone.

    Raises ValueError for a number out of range or an unknown word.
    """

    tolerance: float = 1e-8
    max_iterations: int = 1000
    max_seconds: float | None = None
    formulation: Literal["auto", "inverse", "explicit", "torn", "dae"] = "auto"
    prefer: tuple[str, ...] = ()
    hessian: Literal["exact", "lbfgs"] = "exact"

    def __post_init__(self) -> None:
        if not 0 < self.tolerance < 1:
            raise ValueError(f"tolerance is between 0 and 1; found {self.tolerance:g}")
        if self.max_iterations < 0 or (self.max_seconds is not None and not self.max_seconds >= 0):
            raise ValueError(
                f"max_iterations and max_seconds are not negative; found {self.max_iterations} and {self.max_seconds}"
            )
        for name, words in (("formulation", FORMULATIONS), ("hessian", HESSIANS)):
            if getattr(self, name) not in words:
                raise ValueError(f"{name} is one of {', '.join(words)}; found '{getattr(self, name)}'")


class NotSolved(RuntimeError):
    """Raised by solve() when the problem was not solved; `.solution` holds the best iterate."""

    def __init__(self, solution: Solution) -> None:
        super().__init__(solution.message)
        self.solution = solution


def solve(
    model: Optimization,
    mesh: Mesh | None = None,
    *,
    guess: Trajectory | Solution | None = None,
    branches: Mapping[str, int] | None = None,
    solver: SolverOptions | None = None,
    progress: Progress | None = None,
    throw: bool = True,
) -> Solution:
    """Solve an optimisation by direct collocation.

    Args:
        model: an Optimization with values for its parameters.
        mesh: elements, points, scheme and control; default 50 x 3 Radau.
        guess: a trajectory with names of states and controls, or an earlier solution.
        branches: sign +1 or -1 by the name of a declared branch, +1 by default; a solution that leaves it at any
            point has status failed.
        progress: called with (iteration, objective, constraint violation); returning True stops the solve,
            keeping the iterate (status interrupted).

    Raises ModelError for a wrong problem and NotSolved (with the best iterate) unless throw is False.
    """
    mesh = mesh or Mesh()
    options = solver or SolverOptions()
    problem = build(model, options.formulation, options.prefer, branches)
    nlp = make_nlp(problem, mesh)
    check_equalities(problem, nlp.element)
    return solve_nlp(nlp, initial_guess(nlp, guess), options, progress, throw)


def solve_nlp(
    nlp: Nlp, x0: np.ndarray, options: SolverOptions, progress: Progress | None = None, throw: bool = True
) -> Solution:
    """Run IPOPT on a transcribed problem from scaled unknowns x0."""
    watch = _Watch(nlp, progress, options.max_seconds)
    ipopt: dict[str, Any] = {
        "tol": options.tolerance,
        "max_iter": options.max_iterations,
        "mu_strategy": "adaptive",
        "print_level": 0,
        "sb": "yes",
        "hessian_approximation": HESSIANS[options.hessian],
        "honor_original_bounds": "yes",  # IPOPT relaxes bounds by 1e-8 while it works
        "mumps_pivot_order": 0,  # AMD: 18 % per iteration on these banded systems
    }
    settings = {
        "ipopt": ipopt,
        "print_time": False,
        "no_nlp_grad": True,
        "error_on_fail": False,
        "iteration_callback": watch,
        "show_eval_warnings": False,
        **nlp.functions,
    }
    start = time.perf_counter()
    run = ca.nlpsol("solver", "ipopt", nlp.nlp, settings)
    setup = time.perf_counter() - start
    result = run(x0=x0, lbx=nlp.lbx, ubx=nlp.ubx, lbg=nlp.lbg, ubg=nlp.ubg)
    stats = run.stats()
    status, word = _status(str(stats["return_status"]), watch)
    x = np.asarray(result["x"]).reshape(-1)
    g = np.asarray(result["g"]).reshape(-1)
    message = _message(status, word, nlp, g)
    if status.ok and (astray := wrong_branch(nlp, x)):
        status, message = SolveStatus.FAILED, astray
    solution = read_solution(
        nlp,
        x,
        g,
        lam_g=np.asarray(result["lam_g"]).reshape(-1),
        status=status,
        message=message,
        objective=float(result["f"]),
        iterations=int(stats["iter_count"]),
        seconds={"setup": setup, "solve": time.perf_counter() - start - setup},
    )
    if throw and not status.ok:
        raise NotSolved(solution)
    return solution


class _Watch(ca.Callback):
    """IPOPT's iteration callback: progress, time limit, a stop that keeps the iterate."""

    def __init__(self, nlp: Nlp, progress: Progress | None, max_seconds: float | None) -> None:
        ca.Callback.__init__(self)
        self.progress = progress
        self.stop_at = None if max_seconds is None else time.monotonic() + max_seconds
        self.count = 0
        self.stopped = ""
        self.nx, self.ng = nlp.size, len(nlp.lbg)
        self.lbg, self.ubg = nlp.lbg, nlp.ubg
        self.construct("watch", {})

    def get_n_in(self) -> int:
        return ca.nlpsol_n_out()

    def get_n_out(self) -> int:
        return 1

    def get_name_in(self, i: int) -> str:
        return ca.nlpsol_out(i)

    def get_name_out(self, i: int) -> str:
        return "ret"

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        size = {"f": 1, "x": self.nx, "lam_x": self.nx, "g": self.ng, "lam_g": self.ng}.get(ca.nlpsol_out(i), 0)
        return ca.Sparsity.dense(size, 1)

    def eval(self, arg: Sequence[ca.DM]) -> list[float]:
        count, self.count = self.count, self.count + 1
        late = self.stop_at is not None and time.monotonic() > self.stop_at
        asked = False
        if self.progress is not None:
            g = np.asarray(arg[ca.nlpsol_out().index("g")]).reshape(-1)
            violation = max(0.0, float(np.max(np.maximum(self.lbg - g, g - self.ubg), initial=0.0)))
            asked = bool(self.progress(count, float(arg[ca.nlpsol_out().index("f")]), violation))
        if late or asked:
            self.stopped = "its time was over" if late else "it was asked to stop"
            return [1]
        return [0]


def _status(word: str, watch: _Watch) -> tuple[SolveStatus, str]:
    if watch.stopped:
        return SolveStatus.INTERRUPTED, watch.stopped
    table = {
        "Solve_Succeeded": SolveStatus.SOLVED,
        "Solved_To_Acceptable_Level": SolveStatus.SOLVED,
        "Infeasible_Problem_Detected": SolveStatus.INFEASIBLE,
        "Restoration_Failed": SolveStatus.INFEASIBLE,
        "Maximum_Iterations_Exceeded": SolveStatus.ITERATION_LIMIT,
        "Maximum_CpuTime_Exceeded": SolveStatus.INTERRUPTED,
        "Invalid_Number_Detected": SolveStatus.NOT_FINITE,
        "Diverging_Iterates": SolveStatus.DIVERGED,
    }
    return table.get(word, SolveStatus.FAILED), word


def _message(status: SolveStatus, word: str, nlp: Nlp, g: np.ndarray) -> str:
    if status.ok:
        return "solved" if word == "Solve_Succeeded" else "solved to the acceptable level only"
    violation = np.maximum(nlp.lbg - g, g - nlp.ubg)
    violation = np.where(np.isfinite(violation), violation, np.inf)
    sentence = f"{status.sentence} ({word if ' ' in word else f'IPOPT: {word}'})"
    worst = np.argsort(-violation, kind="stable")[:3]
    named = [f"{nlp.row_name(int(r))} by {violation[r]:.2g}" for r in worst if violation[r] > 1e-6]
    return sentence + (f"; worst rows: {'; '.join(named)}" if named else "")
