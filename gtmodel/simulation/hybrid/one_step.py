"""Integration by a one-step method: after an event it has its full order at once, a multistep method begins at one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
import scipy

from ...compiler.point_function import PointFunction
from ..reduced import Reduced
from ..step import FINEST, MOST_ROWS, RESTARTED, Stepper

# steps in one call
MOST_STEPS = 2000
# and where somebody looks for events in them: what comes after one is thrown away
WATCHED_STEPS = 24
# so many steps in one interval, on average over a call, are too many for a stiff system, and CVODES goes on with it
MOST_AN_INTERVAL = 60
# step times the largest eigenvalue, as Hairer's DOP853 estimates it: above it stability and not accuracy decides on the
# step, most of the time
STIFF = 3.0


class OneStep:
    """As a `Stepper`, by Dormand and Prince's method of order 8 (DOP853); by CVODES where the system is stiff, and by
    IDAS where Newton unknowns ride along."""

    def __init__(
        self, reduced: Reduced, stepper: Stepper, tolerance: float, bounded: bool, remembers: bool = False
    ) -> None:
        """remembers: `way` is kept."""
        self._stepper, self._remembers = stepper, remembers
        self.way: Way | None = None  # of the last call; None where it was one of CVODES or IDAS
        # of the last call where it came to the end of no interval: how far it came [s], states and energies there
        self.far: tuple[float, np.ndarray, np.ndarray] | None = None
        self.x_scale, self.z_scale = stepper.x_scale, stepper.z_scale
        self._bounded = bounded
        # as a call of CVODES over few intervals, for the same reason: errors of many short pieces add up
        self._tolerance = min(tolerance, max(FINEST, RESTARTED * tolerance))
        self._stiff = reduced.z.numel() > 0
        rates = ca.vertcat(reduced.rates, reduced.powers)
        self._rates = (
            PointFunction(ca.Function("rates", [reduced.x, reduced.t, reduced.p], [ca.densify(rates)]))
            if (not self._stiff)
            else None
        )
        self._last = np.inf  # the step that it would take next [s]

    @property
    def likely(self) -> float:
        """The step that it would take next [s], infinite before the first one."""
        return self._last

    @property
    def most(self) -> int:
        """Intervals in one call."""
        return self._stepper.most if self._stiff else MOST_ROWS

    def __call__(
        self,
        x: np.ndarray,
        z: np.ndarray,
        time: float,
        length: float,
        p: np.ndarray,
        count: int = 1,
        longest: float = np.inf,
        likely: int = 1,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        """As a `Stepper`'s, or fewer of the intervals."""
        self.way = self.far = None
        if not self._stiff:
            made = self._steps(x, time, length, p, count, min(longest, length if self._bounded else np.inf))
            if made is not None or not self._stiff:
                return made
        return self._stepper(x, z, time, length, p, count, longest, 1)

    def _steps(
        self, x: np.ndarray, time: float, length: float, p: np.ndarray, count: int, longest: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        """Fewer intervals where they take many steps. None where it fails; then `_stiff` says whether that is why."""
        rates, scale, n = self._rates, np.append(self.x_scale, [1.0, 1.0]), x.size
        assert rates is not None

        def f(t: float, y: np.ndarray) -> np.ndarray:
            return rates(y[:n] * self.x_scale, time + t, p)[0].reshape(-1) / scale

        end = count * length
        at = length * np.arange(1, count + 1)
        rows = np.empty((count, n + 2))
        begin = np.concatenate([x / self.x_scale, [0.0, 0.0]])
        options: dict[str, Any] = {"rtol": self._tolerance, "atol": self._tolerance, "max_step": longest}
        wanted = self._last
        if np.isfinite(wanted):
            options["first_step"] = min(self._last, end)
        with np.errstate(all="ignore"):
            solver = scipy.integrate.DOP853(f, 0.0, begin, end, **options)
            done, steps, stiff = 0, 0, 0
            ends, between = [0.0], []
            while solver.status == "running":
                solver.step()
                steps += 1
                if solver.status == "failed" or not np.all(np.isfinite(solver.y)):
                    self._came_to(solver, n, ends, between)
                    return None
                last = int(np.searchsorted(at, solver.t, side="right")) if solver.status == "running" else count
                if last > done or self._remembers:
                    dense = solver.dense_output()
                    rows[done:last] = dense(at[done:last]).T
                    done = last
                    ends.append(float(solver.t))
                    between.append(dense)
                if steps > MOST_AN_INTERVAL:
                    stiff += _stiffness(solver) > STIFF
                if steps > MOST_AN_INTERVAL * max(done, 1) + MOST_AN_INTERVAL and 2 * stiff > steps - MOST_AN_INTERVAL:
                    self._stiff = True
                    return None
                if steps > MOST_STEPS or (self._remembers and done and steps >= WATCHED_STEPS):
                    break
            if not done:
                self._came_to(solver, n, ends, between)
                return None
            if solver.status == "finished":
                rows[-1] = solver.y
            rows = rows[:done]
        # a step that the end cut short says nothing about the next one
        self._last = max(float(solver.h_abs), wanted if steps == 1 and np.isfinite(wanted) else 0.0)
        if not np.all(np.isfinite(rows)):
            return None
        self.way = self._way(ends, between)
        return rows[:, :n] * self.x_scale, np.zeros((done, 0)), rows[:, n:]

    def _came_to(self, solver: scipy.integrate.DOP853, n: int, ends: list[float], between: list[Any]) -> None:
        if np.all(np.isfinite(solver.y)):
            self.far = float(solver.t), solver.y[:n] * self.x_scale, solver.y[n:].copy()
            self.way = self._way(ends, between)

    def _way(self, ends: list[float], between: list[Any]) -> Way | None:
        if not self._remembers or not between:
            return None
        return Way(np.array(ends), scipy.integrate.OdeSolution(ends, between), self.x_scale)


def _stiffness(solver: scipy.integrate.DOP853) -> float:
    """The last step times the largest eigenvalue, by the two evaluations at its end."""
    h, slopes = solver.h_previous, solver.K
    change = slopes[-1] - slopes[-2]
    apart = h * (slopes[:-1].T @ solver.B - slopes[: solver.n_stages - 1].T @ solver.A[-1, : solver.n_stages - 1])
    return abs(h) * float(np.linalg.norm(change)) / max(float(np.linalg.norm(apart)), 1e-300)


@dataclass(frozen=True, eq=False)
class Way:
    """The steps of one call: their ends [s], the first one 0, and the states anywhere between them."""

    ends: np.ndarray
    solution: Any
    scale: np.ndarray

    def __call__(self, times: np.ndarray) -> np.ndarray:
        """States (n, states) at times (n,) after the call's begin [s]."""
        return self.solution(times)[: len(self.scale)].T * self.scale
