"""Handing an NLP over to IPOPT: options, a second try with the other barrier strategy, and warnings of CasADi that a
solution says better."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from ..results.status import SolveStatus
from .watch import FEASIBLE, NEARER, RUNAWAY, Iterate, IterationWatch, Multipliers, Program, Progress

if TYPE_CHECKING:
    from .solve import SolverOptions

BEGIN, END = "CasADi - ", "]\n"  # CasADi writes a warning piece by piece: date, text, [file:line]


class _Sieve:
    """A stream without the warnings that one thread writes; all else passes."""

    def __init__(self, stream: Any) -> None:
        self._stream, self._thread, self._within = stream, threading.get_ident(), False

    def write(self, text: str) -> int:
        if threading.get_ident() == self._thread:
            self._within = self._within or text.startswith(BEGIN)
            if self._within:
                self._within = not text.endswith(END)
                return len(text)
        return self._stream.write(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


@contextmanager
def without_warnings() -> Iterator[None]:
    """Leaves out what CasADi warns of meanwhile; what others write to stderr passes."""
    with redirect_stderr(_Sieve(sys.stderr)):  # type: ignore[type-var]
        yield


HESSIANS = {"exact": "exact", "lbfgs": "limited-memory"}
STRATEGIES = ("adaptive", "monotone")  # IPOPT's mu_strategy; where one fails the other may need a tenth of iterations
BARRIERS = ("auto", *STRATEGIES, "low")
FATROP = {True: "Solve_Succeeded", False: "fatrop did not converge"}
# a warm start trusts its point: the barrier begins near where it ended. The best of some tried on four problems; a
# larger change of parameters may take more iterations than a cold start
WARM_PUSH, WARM_BARRIER = 1e-3, 1e-6
# a guess near the optimum without multipliers, as that of a coarser mesh: pushed off its bounds no further than the
# barrier asks for
NEAR_PUSH = 1e-6
# iterations without progress after which a first try makes room for the second; converging runs stay below a third
LOST = 150
# from so many unknowns on MUMPS takes the order QAMD, which knows the dense rows of free constants, and asks for twice
# the memory that it expects to need instead of IPOPT's eleven times, whose pages are new to it at every iteration:
# together a third of it; where memory does not suffice IPOPT doubles it
LARGE = 2500
OF_LARGE: dict[str, Any] = {"mumps_pivot_order": 6, "mumps_mem_percent": 100}
# ends after which the other strategy is tried: what stopped the run was neither the caller nor a limit of his
TRIED_AGAIN = (SolveStatus.FAILED, SolveStatus.INFEASIBLE, SolveStatus.DIVERGED, SolveStatus.NOT_FINITE)


@dataclass(frozen=True, eq=False)
class SolverRun:
    """How a run of IPOPT ended: the last iterate, its multipliers, and IPOPT's own word for it.

    best: of a run that failed, an earlier iterate much nearer to its constraints, or one that keeps them for less.
    miss: of a run that solved its problem, the largest violation of a row beside the size of its terms (at least 1).
    barrier: the strategy that it was run with; "" with another solver. iterations: of both tries, where there were two.
    other: how the try with the other strategy ended, as (strategy, word); None where there was none.
    curved: whether the reduced Hessian was positive definite in the last step, so that the answer is a minimum and no
        saddle; None where that was not asked: without a step, or without second derivatives.
    indifferent: whether the objective is a constant, so that there is nothing to minimise.
    """

    x: np.ndarray
    g: np.ndarray
    objective: float
    multipliers: Multipliers
    iterations: int
    status: SolveStatus
    word: str
    seconds: dict[str, float]
    best: Iterate | None = None
    miss: float | None = None
    barrier: str = ""
    other: tuple[str, str] | None = None
    curved: bool | None = None
    indifferent: bool = False

    @property
    def reservation(self) -> str:
        """What is not known of an answer: a stationary point may be a saddle or a maximum. Empty where it is none."""
        if self.indifferent and self.status.ok:
            return "the objective is a constant, and any motion that keeps the constraints is as good"
        if self.curved or not self.status.ok:
            return ""
        if self.curved is None:
            return "first-order conditions hold, whether it is a minimum was not tested"
        return "first-order conditions hold, but it need be no minimum: the reduced Hessian is not positive definite"

    def at_best(self) -> SolverRun:
        """The run with its best iterate in place of the last; what a failure says is about the last."""
        b = self.best
        return self if b is None else replace(self, x=b.x, g=b.g, objective=b.objective, multipliers=b.multipliers)


def run_ipopt(
    program: Program,
    x0: np.ndarray,
    options: SolverOptions,
    progress: Progress | None = None,
    warm: Multipliers | None = None,
    scale: float = 1.0,
) -> SolverRun:
    """Run IPOPT from x0, and from multipliers too where they are given; or fatrop.

    With barrier "auto" a failure is followed by a try with the other strategy, both within one limit of iterations and
    time; a warm start begins with the monotone one, from its multipliers, and the second try is cold. Where neither
    solves the problem the answer is the one that came clearly nearer to its constraints, else the first.

    scale: what IPOPT multiplies the objective by; the answer is without it.
    """
    stop_at = None if options.max_seconds is None else time.monotonic() + options.max_seconds
    order = STRATEGIES[::-1] if warm is not None else STRATEGIES
    strategy = order[0] if options.barrier == "auto" else options.barrier
    patience = options.patience if options.patience is not None or options.barrier != "auto" else LOST
    # multipliers of an infeasible problem run away too, and a run that nobody hurries may prove that it is one
    runaway = np.inf if options.patience is None else RUNAWAY
    watch = IterationWatch(program, progress, stop_at, patience, runaway=runaway)
    first = _once(program, x0, options, strategy, watch, warm, scale)
    left = options.max_iterations - first.iterations
    # at iteration 0 it is the start that is no number, for both alike; fatrop has no such strategies
    again = options.barrier == "auto" and first.barrier and first.status in TRIED_AGAIN
    if not again or first.iterations == 0 or left <= 0:
        return first
    watch = IterationWatch(program, progress, stop_at, options.patience, first.iterations, runaway)
    second = _once(program, x0, options, order[1], watch, None, scale)
    return _either(program, first, second)


def _either(program: Program, first: SolverRun, second: SolverRun) -> SolverRun:
    """The solved one of two tries, or the nearer, with the iterations of both."""
    seconds = {name: first.seconds[name] + second.seconds[name] for name in first.seconds}

    def violation(run: SolverRun) -> float:
        return max(program.violation(run.at_best().g), FEASIBLE)

    nearer = second.status.ok or violation(second) < NEARER * violation(first)
    kept, other = (second, first) if nearer else (first, second)
    if second.status is SolveStatus.INTERRUPTED:
        kept = replace(kept, status=second.status, word=second.word)
    outcome = other.barrier, other.word
    return replace(kept, iterations=first.iterations + second.iterations, seconds=seconds, other=outcome)


def _once(
    program: Program,
    x0: np.ndarray,
    options: SolverOptions,
    strategy: str,
    watch: IterationWatch,
    warm: Multipliers | None,
    scale: float,
) -> SolverRun:
    """One run, with one barrier strategy."""
    ipopt: dict[str, Any] = {
        "tol": options.tolerance,
        "max_iter": options.max_iterations - watch.done,
        "mu_strategy": "monotone" if strategy == "low" else strategy,
        "print_level": 0,
        "sb": "yes",
        "hessian_approximation": HESSIANS[options.hessian],
        "honor_original_bounds": "yes",  # IPOPT relaxes bounds by 1e-8 while it works
        "mumps_pivot_order": 0,  # AMD: 18 % per iteration on these banded systems
        **(OF_LARGE if len(program.lbx) >= LARGE else {}),
    }
    if options.hessian == "lbfgs":
        # one larger factorisation in place of a solve for each of the last steps: half of the time per iteration
        ipopt["limited_memory_aug_solver"] = "extended"
    if scale != 1.0:
        ipopt["obj_scaling_factor"] = scale
    if warm is not None:
        ipopt |= {"warm_start_init_point": "yes", "mu_init": WARM_BARRIER}
        ipopt |= {f"warm_start_{n}": WARM_PUSH for n in (
            "bound_push", "bound_frac", "slack_bound_push", "slack_bound_frac", "mult_bound_push")}  # fmt: skip
    elif strategy == "low":
        ipopt |= {"mu_init": WARM_BARRIER, "bound_push": NEAR_PUSH, "bound_frac": NEAR_PUSH}
    settings = {
        "ipopt": ipopt,
        "print_time": False,
        "no_nlp_grad": True,
        "error_on_fail": False,
        "iteration_callback": watch,
        "show_eval_warnings": False,
        **program.functions,
    }
    plugin = options.solver
    if plugin == "fatrop":
        settings.pop("ipopt")
        settings.pop("iteration_callback")  # fatrop has none
        for name in ("no_nlp_grad", *program.functions):
            settings.pop(name)
        settings |= {
            "cache": {f.name(): f for f in program.functions.values()},
            "structure_detection": "auto",
            "equality": (program.lbg == program.ubg).tolist(),
            "fatrop": {"tol": options.tolerance, "max_iter": options.max_iterations, "print_level": 0},
        }
    start = time.perf_counter()
    given = {} if warm is None else {"lam_g0": warm.rows, "lam_x0": warm.bounds}
    with without_warnings():
        run = ca.nlpsol("solver", plugin, program.nlp, settings)
        setup = time.perf_counter() - start
        result = run(x0=x0, lbx=program.lbx, ubx=program.ubx, lbg=program.lbg, ubg=program.ubg, **given)
    stats = run.stats()
    if watch.raised is not None:
        raise watch.raised
    word = str(stats["return_status"]) if plugin == "ipopt" else FATROP[bool(stats["success"])]
    if plugin == "fatrop" and not stats["success"] and int(stats["iter_count"]) >= options.max_iterations:
        word = "Maximum_Iterations_Exceeded"
    status, word = _status(word, watch)
    if plugin == "fatrop" and status is SolveStatus.ITERATION_LIMIT:
        word = f"fatrop ended after {stats['iter_count']} iterations"
    x, g, rows, bounds = (np.asarray(result[n]).reshape(-1) for n in ("x", "g", "lam_g", "lam_x"))
    f, seconds = float(result["f"]), {"setup": setup, "solve": time.perf_counter() - start - setup}
    miss = None
    if isinstance(program.nlp, ca.Function):
        # what IPOPT tells of its answer was before it brought x back to the bounds that it relaxes
        f, g = (np.asarray(v).reshape(-1) for v in program.nlp(x, []))
        f = float(f[0])
        miss = _miss(program, x, g) if status.ok else None
    if miss is not None and not miss <= FEASIBLE:
        status, word = SolveStatus.FAILED, (
            f"IPOPT's answer misses its rows by {miss:.2g} of their size within the bounds, which it relaxes by 1e-8; "
            "give what is small a nominal, or bounds on both sides"
        )  # fmt: skip
    best = None if status.ok else watch.better_than(g, f)
    used = strategy if plugin == "ipopt" else ""
    curved = _curved(stats) if used and options.hessian == "exact" else None
    count = int(stats["iter_count"])
    return SolverRun(x, g, f, Multipliers(rows, bounds), count, status, word, seconds, best, miss, used, curved=curved)


def _curved(stats: dict[str, Any]) -> bool | None:
    """IPOPT counts the negative eigenvalues of every step's equations and adds to the Hessian until they are as many as
    there are rows: what it added in the last step is zero where the reduced Hessian is positive definite as it is."""
    added = stats.get("iterations", {}).get("regularization_size", [])
    return added[-1] == 0.0 if len(added) > 1 else None


def _miss(program: Program, x: np.ndarray, g: np.ndarray) -> float:
    """Largest violation of a row, divided by the sum of its derivatives times the unknowns where that is above 1."""
    excess = np.maximum(program.lbg - g, g - program.ubg)
    worst = float(np.max(excess, initial=0.0))
    if worst <= FEASIBLE or "jac_g" not in program.functions:
        return worst
    jacobian = ca.fabs(program.functions["jac_g"](x, [])[1])
    size = np.asarray((jacobian @ ca.fabs(ca.DM(x))).full()).reshape(-1)
    return float(np.max(excess / np.maximum(1.0, size), initial=0.0))


def _status(word: str, watch: IterationWatch) -> tuple[SolveStatus, str]:
    if watch.stopped:
        return SolveStatus.INTERRUPTED, watch.stopped
    if watch.stalled:
        return SolveStatus.FAILED, watch.stalled
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
