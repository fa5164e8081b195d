"""The optimum's motor forces applied to the F1 with all six axes free."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy

from ...compiler.causal import compile_causal
from ...lang import Model
from ...results import Status, Trajectory
from ..followed_branch import FollowedBranch

Array = np.ndarray
TOLERANCE = 1e-8  # relative and absolute, far below what the sampled forces leave
AXES = 6
INTERRUPTED = "interrupted"


@dataclass(frozen=True)
class FreeRun:
    """Axes (6,) [m, rad] and their velocities at the end, and the largest |q4 + q5| [rad] at any step; or why not."""

    q: Array
    velocity: Array
    uncoupled: float
    message: str = ""


def free_run(
    robot: Model, run: Trajectory, rows_per_element: int, interrupted: Callable[[], bool] = lambda: False
) -> FreeRun:
    """Forward dynamics of all six axes under the forces `tau` of a motion, element by element.

    Nothing holds q4 = -q5 here but the forces. Between its rows a force is a cubic spline, one per element: rows are
    the start and then `rows_per_element` equally spaced ones of each element. The row at an element's left edge belongs
    to the element before it, so that a force may jump there.

    >>> class SixSprings(gt.Model):
    ...     q = gt.variable(6)
    ...     tau = gt.input(6)
    ...
    ...     def equations(self):
    ...         yield gt.der(self.q, 2) == self.tau - self.q - 2 * gt.der(self.q)
    >>> t = np.linspace(0.0, 1.0, 5)
    >>> run = gt.Trajectory(t, {"q": np.zeros((5, 6)), "der(q)": np.zeros((5, 6)), "tau": np.ones((5, 6))}, {})
    >>> gt.motion.axes.free_run(SixSprings(), run, rows_per_element=4).q.round(4)  # 1 - 2 / e
    array([0.2642, 0.2642, 0.2642, 0.2642, 0.2642, 0.2642])
    """
    forward = FollowedBranch(compile_causal(robot, known="tau", targets="der(q,2)", prefer="q"))
    y = np.concatenate([run["q"][0], run["der(q)"][0]])
    worst, times = abs(y[3] + y[4]), list[float]()
    for first in range(0, len(run) - 1, rows_per_element):
        own = slice(first + 1, first + rows_per_element + 1)
        force = scipy.interpolate.CubicSpline(run.time[own], run["tau"][own])
        trouble: list[str] = []

        def rates(
            t: float, y: Array, force: scipy.interpolate.CubicSpline = force, trouble: list[str] = trouble
        ) -> Array:
            a = forward(y[:AXES], y[AXES:], force(t))
            if not np.all(np.isfinite(a)) and not trouble:
                trouble.append(_failed(t, int(forward.f(y[:AXES], y[AXES:], force(t))[-1])))
            return np.concatenate([y[AXES:], a])

        span = (run.time[first], run.time[first + rows_per_element])
        with np.errstate(invalid="ignore"):  # a failed row is nan, and reported below
            done = scipy.integrate.solve_ivp(rates, span, y, method="DOP853", rtol=TOLERANCE, atol=TOLERANCE)
        for t, row in zip(done.t, done.y.T, strict=True):
            forward.kept(row[:AXES], row[AXES:], force(t))
        times += done.t.tolist()
        if interrupted():
            trouble.append(INTERRUPTED)
        if trouble or not done.success:
            return FreeRun(y[:AXES], y[AXES:], np.inf, (trouble or [str(done.message)])[0])
        y = done.y[:, -1]
        worst = max(worst, float(np.max(np.abs(done.y[3] + done.y[4]))))
    statuses = forward.statuses()
    bad = np.flatnonzero(statuses != Status.OK)
    if bad.size:
        return FreeRun(y[:AXES], y[AXES:], np.inf, _failed(times[bad[0]], int(statuses[bad[0]])))
    return FreeRun(y[:AXES], y[AXES:], float(worst))


def _failed(t: float, status: int) -> str:
    return f"the dynamics fail after {t:.4g} s: {Status(int(status)).name.lower()}"
