"""Handing an NLP over to IPOPT: options, iteration callback, limits, and how it ended."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import casadi as ca
import numpy as np

from ..results.status import SolveStatus
from .quiet import without_warnings

Progress = Callable[[int, float, float], bool]
HESSIANS = {"exact": "exact", "lbfgs": "limited-memory"}
# a warm start trusts its point: the barrier begins near where it ended. The best of some tried on four problems; a
# larger change of parameters may take more iterations than a cold start
FATROP = {True: "Solve_Succeeded", False: "fatrop did not converge"}
WARM_PUSH, WARM_BARRIER = 1e-3, 1e-6
FEASIBLE = 1e-6  # violations of scaled rows below this are none
NEARER = 0.5  # of the violation: an earlier iterate of a failed run is kept if it is so much nearer to its constraints


class Program(Protocol):
    """What IPOPT needs of an NLP: functions by nlpsol's names and bounds."""

    functions: dict[str, ca.Function]
    nlp: Any  # a function, or the expressions of one by their names
    lbx: np.ndarray
    ubx: np.ndarray
    lbg: np.ndarray
    ubg: np.ndarray


class Limits(Protocol):
    """What IPOPT needs of the solver's options."""

    @property
    def tolerance(self) -> float: ...
    @property
    def max_iterations(self) -> int: ...
    @property
    def max_seconds(self) -> float | None: ...
    @property
    def hessian(self) -> str: ...


@dataclass(frozen=True, eq=False)
class Multipliers:
    """Of constraint rows and of bounds, in IPOPT's signs: for a warm start."""

    rows: np.ndarray
    bounds: np.ndarray


@dataclass(frozen=True, eq=False)
class Iterate:
    """A point on the way, by its number, with the largest violation of its rows."""

    number: int
    x: np.ndarray
    g: np.ndarray
    objective: float
    multipliers: Multipliers
    violation: float


@dataclass(frozen=True, eq=False)
class Run:
    """How a run of IPOPT ended: the last iterate, its multipliers, and IPOPT's own word for it.

    best: of a run that failed, an earlier iterate much nearer to its constraints, or one that keeps them for less.
    miss: of a run that solved its problem, the largest violation of a row beside the size of its terms (at least 1).
    curved: whether the reduced Hessian was positive definite in the last step, so that the answer is a minimum and no
        saddle; None where that was not asked: without a step, or without second derivatives.
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
    curved: bool | None = None

    @property
    def reservation(self) -> str:
        """What is not known of an answer: a stationary point may be a saddle or a maximum. Empty where it is none."""
        if self.curved or not self.status.ok:
            return ""
        if self.curved is None:
            return "first-order conditions hold, whether it is a minimum was not tested"
        return "first-order conditions hold, but it need be no minimum: the reduced Hessian is not positive definite"

    def at_best(self) -> Run:
        """The run with its best iterate in place of the last; what a failure says is about the last."""
        b = self.best
        return self if b is None else replace(self, x=b.x, g=b.g, objective=b.objective, multipliers=b.multipliers)


def run_ipopt(
    program: Program,
    x0: np.ndarray,
    options: Limits,
    progress: Progress | None = None,
    warm: Multipliers | None = None,
    scale: float = 1.0,
) -> Run:
    """Run IPOPT from x0, and from multipliers too where they are given; or fatrop.

    scale: what IPOPT multiplies the objective by; the answer is without it.
    """
    watch = _Watch(program, progress, options.max_seconds)
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
    if scale != 1.0:
        ipopt["obj_scaling_factor"] = scale
    if warm is not None:
        ipopt |= {"warm_start_init_point": "yes", "mu_strategy": "monotone", "mu_init": WARM_BARRIER}
        ipopt |= {f"warm_start_{n}": WARM_PUSH for n in (
            "bound_push", "bound_frac", "slack_bound_push", "slack_bound_frac", "mult_bound_push")}  # fmt: skip
    settings = {
        "ipopt": ipopt,
        "print_time": False,
        "no_nlp_grad": True,
        "error_on_fail": False,
        "iteration_callback": watch,
        "show_eval_warnings": False,
        **program.functions,
    }
    plugin = getattr(options, "solver", "ipopt")
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
    curved = _curved(stats) if plugin == "ipopt" and options.hessian == "exact" else None
    return Run(x, g, f, Multipliers(rows, bounds), int(stats["iter_count"]), status, word, seconds, best, miss, curved)


def _curved(stats: dict[str, Any]) -> bool | None:
    """IPOPT counts the negative eigenvalues of every step's equations and adds to the Hessian until they are as many as
    there are rows: what it added in the last step is zero where the reduced Hessian is positive definite as it is."""
    added = stats.get("iterations", {}).get("regularization_size", [])
    return added[-1] == 0.0 if len(added) > 1 else None


def _miss(program: Program, x: np.ndarray, g: np.ndarray) -> float:
    """Largest violation of a row, divided by the sum of its slopes times the unknowns where that is above 1."""
    excess = np.maximum(program.lbg - g, g - program.ubg)
    worst = float(np.max(excess, initial=0.0))
    if worst <= FEASIBLE or "jac_g" not in program.functions:
        return worst
    jacobian = ca.fabs(program.functions["jac_g"](x, [])[1])
    size = np.asarray((jacobian @ ca.fabs(ca.DM(x))).full()).reshape(-1)
    return float(np.max(excess / np.maximum(1.0, size), initial=0.0))


class _Watch(ca.Callback):
    """IPOPT's iteration callback: progress, time limit, a stop that keeps the best iterate."""

    def __init__(self, nlp: Program, progress: Progress | None, max_seconds: float | None) -> None:
        ca.Callback.__init__(self)
        self.progress = progress
        self.stop_at = None if max_seconds is None else time.monotonic() + max_seconds
        self.count = 0
        self.stopped = ""
        self.raised: BaseException | None = None
        self.best: Iterate | None = None
        self.nx, self.ng = len(nlp.lbx), len(nlp.lbg)
        self.lbx, self.ubx, self.lbg, self.ubg = nlp.lbx, nlp.ubx, nlp.lbg, nlp.ubg
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
        outputs = dict(zip(ca.nlpsol_out(), arg, strict=True))
        g, f = np.asarray(outputs["g"]).reshape(-1), float(outputs["f"])
        violation = self.violation(g)
        better = self.best is None or _rank(violation, f) < _rank(self.best.violation, self.best.objective)
        if count > 0 and better and np.isfinite([violation, f]).all():  # the guess itself is no answer
            x, rows, bounds = (np.array(outputs[n]).reshape(-1) for n in ("x", "lam_g", "lam_x"))
            x = np.clip(x, self.lbx, self.ubx)  # IPOPT brings only its last iterate back to the bounds that it relaxed
            self.best = Iterate(count, x, g.copy(), f, Multipliers(rows, bounds), violation)
        if self.progress is not None:
            try:
                asked = bool(self.progress(count, f, violation))
            except BaseException as error:  # CasADi would print it and go on: it is raised when IPOPT has returned
                self.raised = error
                return [1]
        if late or asked:
            self.stopped = "its time was over" if late else "it was asked to stop"
            return [1]
        return [0]

    def violation(self, g: np.ndarray) -> float:
        """Largest excess of a row over its bounds; infinite where a row is no number."""
        worst = float(np.max(np.maximum(self.lbg - g, g - self.ubg), initial=0.0))
        return np.inf if np.isnan(worst) else worst

    def better_than(self, g: np.ndarray, f: float) -> Iterate | None:
        """The best iterate where it is clearly better than the last one, given by its rows and objective."""
        last, best = self.violation(g), self.best
        if best is None or _rank(best.violation, best.objective) >= _rank(last, f):
            return None
        return best if last <= FEASIBLE or best.violation <= NEARER * last else None


def _rank(violation: float, objective: float) -> tuple[float, float]:
    """By violation, and among those that keep their rows by the objective."""
    return max(violation, FEASIBLE), objective


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
