"""What is seen of IPOPT while it runs: progress, limits, the best iterate, and whether it still gets anywhere."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

Progress = Callable[[int, float, float], bool]
FEASIBLE = 1e-6  # violations of scaled rows below this are none
NEARER = 0.5  # of the violation: an earlier iterate of a failed run is kept if it is so much nearer to its constraints
# an iterate is progress where no earlier one is within this of both its violation and its objective, or better
CLOSER, CHEAPER = 0.9, 1e-4
# multipliers beyond this, beside the objective, belong to rows that nearly depend on each other where the iterate is:
# pivots are put off there, so that a step costs many others, and products of the multipliers with derivatives round off
# by 1e-6, which is more than the 1e-8 that ends a run
RUNAWAY = 1e10
WEIGHT = 10  # so many iterations without progress is one with such multipliers


@dataclass(eq=False)
class Program:
    """What IPOPT needs of an NLP: derivatives by nlpsol's names, and bounds."""

    functions: dict[str, ca.Function]
    nlp: Any  # a function, or the expressions of one by their names
    lbx: np.ndarray
    ubx: np.ndarray
    lbg: np.ndarray
    ubg: np.ndarray

    def violation(self, g: np.ndarray) -> float:
        """Largest excess of a row over its bounds; infinite where a row is no number."""
        worst = float(np.max(np.maximum(self.lbg - g, g - self.ubg), initial=0.0))
        return np.inf if np.isnan(worst) else worst


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


class Patience:
    """Whether a run still gets anywhere: an iterate counts that no earlier one beats in violation and objective.

    Both at once, since iterates of an interior-point method trade one for the other on their way. `since` is the number
    of iterations without one that counts; those that keep their rows are not lost, what they lack is optimality alone.
    An iterate with a multiplier beyond `runaway` counts as none, and weighs more: its step is as dear as many.
    """

    def __init__(self, runaway: float = np.inf) -> None:
        self.runaway = runaway
        self.filter: list[tuple[float, float]] = []  # of iterates that none beats
        self.since = 0

    def __call__(self, objective: float, violation: float, multiplier: float = 0.0) -> int:
        """Take in an iterate, with the largest of its rows' multipliers; returns `since`."""
        if violation > FEASIBLE and multiplier > self.runaway * max(1.0, abs(objective)):
            self.since += WEIGHT
            return self.since
        v = max(violation, FEASIBLE) if np.isfinite(violation) else np.inf
        f = objective if np.isfinite(objective) else np.inf
        beaten = not np.isfinite(v + f) or any(
            v > (CLOSER * a if a > FEASIBLE else 0.0) and f > b - CHEAPER * abs(b) for a, b in self.filter
        )
        self.since = (self.since + (v > FEASIBLE)) if beaten else 0
        if not beaten:
            self.filter = [(a, b) for a, b in self.filter if a < v or b < f] + [(v, f)]
        return self.since


class IterationWatch(ca.Callback):
    """IPOPT's iteration callback: progress, time limit, a stop that keeps the best iterate."""

    def __init__(
        self,
        nlp: Program,
        progress: Progress | None,
        stop_at: float | None,
        patience: int | None = None,
        done: int = 0,
        runaway: float = np.inf,
    ) -> None:
        """stop_at: by time.monotonic(). patience: iterations without progress before it stops. done: by runs before.
        runaway: see `Patience`."""
        ca.Callback.__init__(self)
        self.progress = progress
        self.stop_at = stop_at
        self.patience = patience
        self.gains = Patience(runaway)
        self.done = self.count = done
        self.stopped = ""
        self.stalled = ""
        self.raised: BaseException | None = None
        # violation, objective, number, outputs of IPOPT of the best
        self._best: tuple[float, float, int, dict[str, np.ndarray]] | None = None
        self.program = nlp
        self.names = ca.nlpsol_out()
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
        nx, ng = len(self.program.lbx), len(self.program.lbg)
        size = {"f": 1, "x": nx, "lam_x": nx, "g": ng, "lam_g": ng}.get(ca.nlpsol_out(i), 0)
        return ca.Sparsity.dense(size, 1)

    def has_eval_buffer(self) -> bool:
        return True

    def eval_buffer(self, arg: Sequence[memoryview | None], res: Sequence[memoryview]) -> int:
        """In IPOPT's own memory, which is used again at the next iterate."""
        np.frombuffer(res[0])[0] = self._stops({n: np.frombuffer(m) for n, m in zip(self.names, arg, strict=True) if m})
        return 0

    def _stops(self, outputs: dict[str, np.ndarray]) -> bool:
        count, self.count = self.count, self.count + 1
        late = self.stop_at is not None and time.monotonic() > self.stop_at
        asked = False
        g, f = outputs.get("g", np.zeros(0)), float(outputs["f"][0])
        violation = self.program.violation(g)
        better = self._best is None or rank(violation, f) < rank(*self._best[:2])
        if count > self.done and better and np.isfinite([violation, f]).all():  # the guess itself is no answer
            self._best = violation, f, count, {name: values.copy() for name, values in outputs.items()}
        if self.progress is not None:
            try:
                asked = bool(self.progress(count, f, violation))
            except BaseException as error:  # CasADi would print it and go on: it is raised when IPOPT has returned
                self.raised = error
                return True
        if late or asked:
            self.stopped = "its time was over" if late else "it was asked to stop"
            return True
        multiplier = float(np.max(np.abs(outputs["lam_g"]), initial=0.0)) if "lam_g" in outputs else 0.0
        if self.patience is not None and self.gains(f, violation, multiplier) >= self.patience:
            self.stalled = f"no progress in {self.patience} iterations"
            return True
        return False

    def better_than(self, g: np.ndarray, f: float) -> Iterate | None:
        """The best iterate where it is clearly better than the last one, given by its rows and objective."""
        last, best = self.program.violation(g), self._best
        if best is None or rank(*best[:2]) >= rank(last, f):
            return None
        return self.best if last <= FEASIBLE or best[0] <= NEARER * last else None

    @property
    def best(self) -> Iterate | None:
        """The iterate nearest to its constraints, and of those that keep them the one of the least objective."""
        if self._best is None:
            return None
        violation, f, count, outputs = self._best
        x, g, rows, bounds = (outputs.get(n, np.zeros(0)) for n in ("x", "g", "lam_g", "lam_x"))
        # IPOPT brings only its last iterate back to the bounds that it relaxed
        x = np.clip(x, self.program.lbx, self.program.ubx)
        return Iterate(count, x, g, f, Multipliers(rows, bounds), violation)


def rank(violation: float, objective: float) -> tuple[float, float]:
    """By violation, and among those that keep their rows by the objective."""
    return max(violation, FEASIBLE), objective
