"""Monitor IPOPT while it runs: progress, limits, the best iterate, and stagnation."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

Progress = Callable[[int, float, float], bool]
FEASIBLE = 1e-6  # scaled rows with a smaller violation count as feasible
NEARER = 0.5  # an earlier iterate of a failed run is preferred if its violation is at most this share of the last one's
# an iterate is progress if, compared with every earlier one, its violation is below CLOSER times that one's or its
# objective is lower by CHEAPER, relative
CLOSER, CHEAPER = 0.9, 1e-4
# multipliers this large relative to the objective belong to rows that are nearly dependent at the iterate. Delayed
# pivots then make a step as expensive as many others, and rounding of multiplier times derivative (1e-6) exceeds the
# tolerance (1e-8)
RUNAWAY = 1e10
WEIGHT = 10  # an iteration with such multipliers counts as this many without progress


@dataclass(eq=False)
class Program:
    """An NLP as IPOPT needs it: functions, derivatives by nlpsol's names, and bounds."""

    functions: dict[str, ca.Function]
    nlp: Any  # a function, or the expressions of one by their names
    lbx: np.ndarray
    ubx: np.ndarray
    lbg: np.ndarray
    ubg: np.ndarray

    def violation(self, g: np.ndarray) -> float:
        """Return the largest violation of the rows' bounds; infinite if a row is NaN."""
        worst = float(np.max(np.maximum(self.lbg - g, g - self.ubg), initial=0.0))
        return np.inf if np.isnan(worst) else worst


@dataclass(frozen=True, eq=False)
class Multipliers:
    """Multipliers of constraint rows and of bounds, in IPOPT's signs, for a warm start."""

    rows: np.ndarray
    bounds: np.ndarray


@dataclass(frozen=True, eq=False)
class Iterate:
    """An iterate with its number and the largest violation of its rows."""

    number: int
    x: np.ndarray
    g: np.ndarray
    objective: float
    multipliers: Multipliers
    violation: float


class Patience:
    """Detects stagnation with a filter: an iterate is progress if no earlier one dominates it.

    The filter uses violation and objective together, since an interior-point method trades one for the other. `since`
    counts iterations without progress; feasible iterates do not count, since only optimality is missing. An iterate
    with a multiplier above `runaway` is never progress and counts WEIGHT times, since its step is expensive.
    """

    def __init__(self, runaway: float = np.inf) -> None:
        self.runaway = runaway
        self.filter: list[tuple[float, float]] = []  # (violation, objective) of undominated iterates
        self.since = 0

    def __call__(self, objective: float, violation: float, multiplier: float = 0.0) -> int:
        """Add an iterate with its largest row multiplier; return `since`."""
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
    """IPOPT's iteration callback: reports progress, stops at limits and keeps the best iterate."""

    def __init__(
        self,
        nlp: Program,
        progress: Progress | None,
        stop_at: float | None,
        patience: int | None = None,
        done: int = 0,
        runaway: float = np.inf,
    ) -> None:
        """stop_at: in time.monotonic(). patience: iterations without progress before stopping. done: iterations of
        previous runs. runaway: see `Patience`."""
        ca.Callback.__init__(self)
        self.progress = progress
        self.stop_at = stop_at
        self.patience = patience
        self.gains = Patience(runaway)
        self.done = self.count = done
        self.stopped = ""
        self.stalled = ""
        self.raised: BaseException | None = None
        # violation, objective, number and IPOPT outputs of the best iterate
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
        """Read the iterate in IPOPT's memory, which the next iterate overwrites."""
        np.frombuffer(res[0])[0] = self._stops({n: np.frombuffer(m) for n, m in zip(self.names, arg, strict=True) if m})
        return 0

    def _stops(self, outputs: dict[str, np.ndarray]) -> bool:
        count, self.count = self.count, self.count + 1
        timed_out = self.stop_at is not None and time.monotonic() > self.stop_at
        stop_requested = False
        g, f = outputs.get("g", np.zeros(0)), float(outputs["f"][0])
        violation = self.program.violation(g)
        better = self._best is None or rank(violation, f) < rank(*self._best[:2])
        if count > self.done and better and np.isfinite([violation, f]).all():  # the guess is not a candidate
            self._best = violation, f, count, {name: values.copy() for name, values in outputs.items()}
        if self.progress is not None:
            try:
                stop_requested = bool(self.progress(count, f, violation))
            except BaseException as error:  # CasADi would swallow it: raised again after IPOPT has returned
                self.raised = error
                return True
        if timed_out or stop_requested:
            self.stopped = "time limit reached" if timed_out else "stopped by the caller"
            return True
        multiplier = float(np.max(np.abs(outputs["lam_g"]), initial=0.0)) if "lam_g" in outputs else 0.0
        if self.patience is not None and self.gains(f, violation, multiplier) >= self.patience:
            self.stalled = f"no progress in {self.patience} iterations"
            return True
        return False

    def better_than(self, g: np.ndarray, f: float) -> Iterate | None:
        """Return the best iterate if it is clearly better than the last one (rows g, objective f), else None."""
        last, best = self.program.violation(g), self._best
        if best is None or rank(*best[:2]) >= rank(last, f):
            return None
        return self.best if last <= FEASIBLE or best[0] <= NEARER * last else None

    @property
    def best(self) -> Iterate | None:
        """The iterate with the smallest violation; among feasible iterates, the one with the smallest objective."""
        if self._best is None:
            return None
        violation, f, count, outputs = self._best
        x, g, rows, bounds = (outputs.get(n, np.zeros(0)) for n in ("x", "g", "lam_g", "lam_x"))
        # IPOPT moves only its last iterate back within the relaxed bounds
        x = np.clip(x, self.program.lbx, self.program.ubx)
        return Iterate(count, x, g, f, Multipliers(rows, bounds), violation)


def rank(violation: float, objective: float) -> tuple[float, float]:
    """Return the sort key of an iterate: violation, then objective among feasible ones."""
    return max(violation, FEASIBLE), objective
