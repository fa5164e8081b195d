"""Run IPOPT on an NLP: options, a second try with the other barrier strategy, and suppression of CasADi's warnings."""

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

BEGIN, END = "CasADi - ", "]\n"  # CasADi writes a warning in pieces: date, text, [file:line]


class _Sieve:
    """A stream that drops CasADi's warnings from one thread and passes everything else."""

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
    """Suppress CasADi's warnings in this thread; other writes to stderr pass."""
    with redirect_stderr(_Sieve(sys.stderr)):  # type: ignore[type-var]
        yield


HESSIANS = {"exact": "exact", "lbfgs": "limited-memory"}
STRATEGIES = ("adaptive", "monotone")  # IPOPT's mu_strategy
BARRIERS = ("auto", *STRATEGIES, "low")
FATROP = {True: "Solve_Succeeded", False: "fatrop did not converge"}
# a warm start begins the barrier near where it ended. Values tuned on four problems; after a large change of
# parameters a warm start may take more iterations than a cold start
WARM_PUSH, WARM_BARRIER = 1e-3, 1e-6
# for a guess near the optimum without multipliers, such as the optimum on a coarser mesh: IPOPT pushes it only this
# far off its bounds
NEAR_PUSH = 1e-6
# iterations without progress after which the first try is abandoned; converging runs stay below a third of this
LOST = 150
# from this many unknowns, MUMPS uses the ordering QAMD, which handles the dense rows of free constants, and reserves
# twice its estimated memory instead of IPOPT's eleven times: a third of the time. If memory is short, IPOPT doubles it
LARGE = 2500
OF_LARGE: dict[str, Any] = {"mumps_pivot_order": 6, "mumps_mem_percent": 100}
# statuses after which the other strategy is tried: neither the caller nor a limit stopped the run
TRIED_AGAIN = (SolveStatus.FAILED, SolveStatus.INFEASIBLE, SolveStatus.DIVERGED, SolveStatus.NOT_FINITE)


@dataclass(frozen=True, eq=False)
class SolverRun:
    """Result of an IPOPT run: the last iterate, its multipliers, and IPOPT's return status (`word`).

    iterations: sum over both tries if there were two.
    best: after a failed run, an earlier iterate with a much smaller violation, or a feasible one with a lower cost.
    miss: after a successful run, the largest violation of a row relative to the size of its terms (at least 1).
    barrier: the barrier strategy; "" with another solver.
    other: (strategy, word) of the try with the other strategy; None if there was none.
    curved: whether the reduced Hessian was positive definite in the last step, so that the point is a minimum and not
        a saddle; None if unknown: no step, or no second derivatives.
    indifferent: whether the objective is constant.
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
        """What remains open about a solved problem: the stationary point may be no minimum; "" if nothing."""
        if self.indifferent and self.status.ok:
            return "the objective is constant, so every feasible point is optimal"
        if self.curved or not self.status.ok:
            return ""
        if self.curved is None:
            return "first-order conditions hold; second-order conditions were not tested"
        return "first-order conditions hold, but the reduced Hessian is not positive definite: possibly not a minimum"

    def at_best(self) -> SolverRun:
        """Return the run with its best iterate in place of the last one; status and word stay those of the last."""
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
    """Run IPOPT (or fatrop) from x0 and, for a warm start, from multipliers.

    With barrier "auto", a failed run is followed by a try with the other strategy; both share the limits of iterations
    and time. A warm start begins with the monotone strategy; its second try is cold. If both fail, the second result
    is returned if its violation is clearly smaller, else the first.

    scale: factor of the objective inside IPOPT; results are unscaled.
    """
    stop_at = None if options.max_seconds is None else time.monotonic() + options.max_seconds
    order = STRATEGIES[::-1] if warm is not None else STRATEGIES
    strategy = order[0] if options.barrier == "auto" else options.barrier
    patience = options.patience if options.patience is not None or options.barrier != "auto" else LOST
    # multipliers of an infeasible problem diverge too; without a patience limit the run may prove infeasibility
    runaway = np.inf if options.patience is None else RUNAWAY
    watch = IterationWatch(program, progress, stop_at, patience, runaway=runaway)
    first = _once(program, x0, options, strategy, watch, warm, scale)
    remaining = options.max_iterations - first.iterations
    # a failure at iteration 0 means that the start is not finite, for both strategies; fatrop has no strategies
    retry = options.barrier == "auto" and first.barrier and first.status in TRIED_AGAIN
    if not retry or first.iterations == 0 or remaining <= 0:
        return first
    watch = IterationWatch(program, progress, stop_at, options.patience, first.iterations, runaway)
    second = _once(program, x0, options, order[1], watch, None, scale)
    return _either(program, first, second)


def _either(program: Program, first: SolverRun, second: SolverRun) -> SolverRun:
    """Return the solved one of two tries, or the one with the smaller violation, with the iterations of both."""
    seconds = {name: first.seconds[name] + second.seconds[name] for name in first.seconds}

    def violation(run: SolverRun) -> float:
        return max(program.violation(run.at_best().g), FEASIBLE)

    nearer = second.status.ok or violation(second) < NEARER * violation(first)
    best, rejected = (second, first) if nearer else (first, second)
    if second.status is SolveStatus.INTERRUPTED:
        best = replace(best, status=second.status, word=second.word)
    outcome = rejected.barrier, rejected.word
    return replace(best, iterations=first.iterations + second.iterations, seconds=seconds, other=outcome)


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
        "honor_original_bounds": "yes",  # IPOPT relaxes bounds by 1e-8 while iterating
        "mumps_pivot_order": 0,  # AMD: saves 18 % per iteration on these banded systems
        **(OF_LARGE if len(program.lbx) >= LARGE else {}),
    }
    if options.hessian == "lbfgs":
        # one larger factorisation instead of one solve per stored step: half the time per iteration
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
        settings.pop("iteration_callback")  # not supported by fatrop
        for name in ("no_nlp_grad", *program.functions):
            settings.pop(name)
        settings |= {
            "cache": {f.name(): f for f in program.functions.values()},
            "structure_detection": "auto",
            "equality": (program.lbg == program.ubg).tolist(),
            "fatrop": {"tol": options.tolerance, "max_iter": options.max_iterations, "print_level": 0},
        }
    start = time.perf_counter()
    multipliers = {} if warm is None else {"lam_g0": warm.rows, "lam_x0": warm.bounds}
    with without_warnings():
        run = ca.nlpsol("solver", plugin, program.nlp, settings)
        setup = time.perf_counter() - start
        result = run(x0=x0, lbx=program.lbx, ubx=program.ubx, lbg=program.lbg, ubg=program.ubg, **multipliers)
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
        # IPOPT's own values are from before it moved x back within the relaxed bounds
        f, g = (np.asarray(v).reshape(-1) for v in program.nlp(x, []))
        f = float(f[0])
        miss = _miss(program, x, g) if status.ok else None
    if miss is not None and not miss <= FEASIBLE:
        status, word = SolveStatus.FAILED, (
            f"IPOPT's solution, moved back within the bounds that IPOPT relaxes by 1e-8, violates the constraints by "
            f"{miss:.2g} of their size; give small variables a nominal, or bounds on both sides"
        )  # fmt: skip
    best = None if status.ok else watch.better_than(g, f)
    barrier = strategy if plugin == "ipopt" else ""
    curved = _curved(stats) if barrier and options.hessian == "exact" else None
    n = int(stats["iter_count"])
    return SolverRun(x, g, f, Multipliers(rows, bounds), n, status, word, seconds, best, miss, barrier, curved=curved)


def _curved(stats: dict[str, Any]) -> bool | None:
    """Return whether the reduced Hessian was positive definite in the last step.

    IPOPT regularises the Hessian until the KKT matrix has as many negative eigenvalues as there are rows; zero
    regularisation means that the reduced Hessian is positive definite.
    """
    added = stats.get("iterations", {}).get("regularization_size", [])
    return added[-1] == 0.0 if len(added) > 1 else None


def _miss(program: Program, x: np.ndarray, g: np.ndarray) -> float:
    """Return the largest violation of a row, divided by the sum |derivative * unknown| of the row if that exceeds 1."""
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
