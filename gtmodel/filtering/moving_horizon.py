"""Moving-horizon estimation: least squares over a window of readings, with bounds on states and noise."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ..lang.declare import input as control, variable
from ..lang.expression import Expr
from ..lang.functions import der
from ..lang.interpolation import interpolate
from ..lang.optimization import Optimization, integral, misfit
from ..optimize.mesh import Mesh
from ..optimize.solution import Solution
from ..optimize.solve import SolverOptions, solve
from ..results.refusal import ArgumentError
from ..results.status import SolveStatus
from ..results.trajectory import Trajectory
from .belief import SAME_INSTANT, Belief, InitialState, Moment, Readings, instants, readings_of, size_of_runs
from .error_state import ErrorState
from .manifold import Manifold
from .system import System

TOLERANCE = 1e-12  # of the solver: the last step of a least-squares problem is exact
AT_BOUND = 1e-6  # of the largest size of a bounded quantity: closer to a bound than this, it is at the bound


@dataclass(frozen=True, eq=False)
class HorizonEstimate:
    """Estimate of a single run from a window of readings, inside its bounds.

    time: of the K instants [s]; x: states (K, size). noise: name -> estimated process noise (K, size).
    status, message: of the solver. solution: the full solution with checks, also between the instants; for a run over
    windows, the solution of the last window. at_bound: names of states and noises that reach a bound.

    estimate["p"] is a state by name, (K,) or (K, size).
    """

    system: System
    time: np.ndarray
    x: np.ndarray
    noise: Mapping[str, np.ndarray]
    status: SolveStatus
    message: str
    at_bound: tuple[str, ...]
    solution: Solution | None

    def __getitem__(self, name: str) -> np.ndarray:
        """A state or an estimated constant. Raises ArgumentError for an unknown name."""
        self.system.space.part(name)
        return self.system.space.values(self.x)[name]


class MovingHorizon:
    """Constrained least-squares estimation over a window of readings, as a `gt.Optimization` by collocation.

    White noise is an input of the process. The estimate minimises the sum of three terms: squared residuals of the
    readings over their variances, the integral of noise^2 over its density, and an arrival cost, the squared distance
    from the prior before the window over its covariance. For a linear problem without bounds this is the Kalman
    smoother. It adds bounds on states and noise, such as a gap that is not negative or wear that never decreases.

    Args:
        system: process and sensors, in continuous time, with rates in closed form.
        bounds: name of a state, of an estimated constant or of a noise -> (low, high), numbers or one per component;
            None: unbounded. The bounds apply at all collocation points.
        points: collocation points per element: 5 are exact for three integrators behind white noise.
        elements: elements between two instants.
        solver: solver options; explicit rates and a tolerance of 1e-12 if left out.

    Gates are ignored: all readings count. Raises ArgumentError for wrong names, and for a process in discrete time.

    Source: Rao, Rawlings, Mayne 2003, IEEE Trans. Autom. Control 48, 246-258.

    >>> class Gap(gt.Model):
    ...     x = gt.variable(unit="m")
    ...     v = gt.input(unit="m/s")
    ...     def equations(self):
    ...         yield gt.der(self.x) == self.v
    >>> process = gt.filtering.ProcessModel(Gap(), noise={"v": 1e-4})
    >>> system = gt.filtering.System(process, [gt.filtering.Sensor("tape", "x", deviation=0.01)])
    >>> log = {"tape": gt.filtering.Readings([0.0, 0.1, 0.2], [0.004, -0.012, 0.002])}
    >>> horizon = gt.filtering.MovingHorizon(system, bounds={"x": (0.0, None)})  # bodies do not enter each other
    >>> estimate = horizon.solve(log, gt.filtering.InitialState({}, {"x": 1.0}))
    >>> estimate["x"].round(4).tolist(), estimate.at_bound
    ([0.0004, 0.0, 0.0002], ('x',))
    """

    def __init__(
        self,
        system: System,
        *,
        bounds: Mapping[str, tuple[Any, Any]] | None = None,
        points: int = 5,
        elements: int = 1,
        solver: SolverOptions | None = None,
    ) -> None:
        self.system, d = system, system.dynamics
        if d.step:
            raise ArgumentError("a moving horizon needs a process in continuous time, a ProcessModel", "system")
        if d.symbol is not ca.SX.sym:
            raise ArgumentError(
                "the rates of this process need an iteration; a moving horizon needs rates in closed form", "system"
            )
        for name, sensor in system.sensors.items():
            if sensor.outliers:
                sentence = f"'{name}' has `outliers`, which a moving horizon does not support; omit it, or use a filter"
                raise ArgumentError(sentence, "system")
            if name in system.mixing:
                sentence = f"'{name}' has a full covariance; a moving horizon needs deviations: give these, or a filter"
                raise ArgumentError(sentence, "system")
        for name, number in (("points", points), ("elements", elements)):
            if number < 1:
                raise ArgumentError(f"expected at least 1; found {number}", name)
        if np.any(d.intensity != np.diag(np.diag(d.intensity))):
            sentence = "the process has a full covariance; a moving horizon needs independent noise: use a filter"
            raise ArgumentError(sentence, "system")
        self.points, self.elements = points, elements
        self.solver = solver or SolverOptions(tolerance=TOLERANCE, formulation="explicit")
        ends = np.cumsum([0, *d.noise.values()])
        self._noises = {name: slice(int(a), int(b)) for name, a, b in zip(d.noise, ends[:-1], ends[1:], strict=True)}
        self._drawn = np.flatnonzero(np.diag(d.intensity) > 0)  # a noise of density zero has no effect
        self._low, self._high = _limits(system, self._noises, dict(bounds or {}))

    def solve(
        self, log: Mapping[str, Any], start: InitialState | Belief, *, inputs: Trajectory | None = None
    ) -> HorizonEstimate:
        """Estimate from all readings of a log at once.

        Args:
            log: sensor -> `Readings`, as in `Filter.run`; a single run, at least two instants.
            start: prior at the start, before the readings, for the arrival cost.
            inputs: known inputs of the process; a change of slope between readings also ends an element.

        If the solver fails, the result has its status; nothing is raised. Raises ArgumentError for a log that does not
        fit.
        """
        readings, plan = self._planned(log, inputs)
        belief = start if isinstance(start, Belief) else start.belief(self.system, plan[0].time)
        return self._window(readings, plan, belief, inputs)

    def run(
        self,
        log: Mapping[str, Any],
        start: InitialState,
        window: int,
        *,
        inputs: Trajectory | None = None,
        progress: Callable[[float], bool] | None = None,
    ) -> HorizonEstimate:
        """Estimate at each instant from the readings of the last `window` instants, as in real time.

        The arrival cost of each window is the belief of the error-state filter before it: this includes all older
        readings, but not the bounds. At the first instant the result is the filter's estimate, clipped to the bounds.
        Other arguments and errors as in `solve`. progress: called with the fraction done; if it returns True, the run
        ends.
        """
        if window < 2:
            raise ArgumentError(f"expected at least 2 instants; found {window}", "window")
        readings, plan = self._planned(log, inputs)
        filtered = ErrorState(self.system).run(log, start, inputs=inputs)
        beliefs = filtered.kept or ()
        if len(beliefs) < 2:
            few = "the log holds a single instant; a moving horizon needs at least two"
            raise ArgumentError(few if filtered.status.ok else filtered.message, "log")
        low, high = self._low[: self.system.space.size], self._high[: self.system.space.size]
        x, noise = [np.clip(beliefs[0].after.x[0], low, high)], []
        status, message, touched = SolveStatus.SOLVED, SolveStatus.SOLVED.message, set()
        solution: Solution | None = None
        time = [plan[0].time]
        for k in range(1, len(beliefs)):
            if progress is not None and progress(k / len(beliefs)):
                status, message = SolveStatus.INTERRUPTED, SolveStatus.INTERRUPTED.message
                break
            first = max(0, k - window + 1)
            estimate = self._window(readings, plan[first : k + 1], beliefs[first].before, inputs)
            x.append(estimate.x[-1])
            noise.append({name: v[-1] for name, v in estimate.noise.items()})
            time.append(plan[k].time)
            touched |= set(estimate.at_bound)
            solution = estimate.solution
            if not estimate.status.ok and status.ok:
                status, message = estimate.status, f"the window that ends at {plan[k].time:g} s: {estimate.message}"
        whole = {name: np.array([v[name] for v in [*noise[:1], *noise]]) for name in self._noises}
        at_bound = tuple(n for n in [*[p.name for p in self.system.space.parts], *self._noises] if n in touched)
        return HorizonEstimate(self.system, np.array(time), np.array(x), whole, status, message, at_bound, solution)

    # -- one window --------------------------------------------------------------------------------------

    def _planned(self, log: Mapping[str, Any], inputs: Any) -> tuple[dict[str, Readings], list[Moment]]:
        readings = readings_of(self.system, log)
        if size_of_runs([*readings.values()]) > 1:
            raise ArgumentError("a moving horizon estimates a single run; the log holds several", "log")
        if self.system.dynamics.inputs and inputs is None:
            names = ", ".join(self.system.dynamics.inputs)
            raise ArgumentError(f"the process has known inputs; give a trajectory of {names}", "inputs")
        return readings, instants(self.system, readings)

    def _window(
        self, readings: Mapping[str, Readings], plan: list[Moment], belief: Belief, inputs: Any
    ) -> HorizonEstimate:
        system = self.system
        times = [belief.time, *[m.time for m in plan]]
        bends = [t for t, _ in system.bends(inputs, times[0], times[-1])]
        edges = [times[0]]  # of elements: readings at the same instant share one
        for t in sorted([*times[1:], *bends]):
            if t - edges[-1] > SAME_INSTANT:
                edges.append(t)
        if len(edges) < 2:
            raise ArgumentError("the log holds a single instant; a moving horizon needs at least two", "log")
        for part, rows_k, along in system.space.places():
            fixed = np.diag(belief.P[0])[along] <= 0 if part.kind == "vector" else np.zeros(part.size, bool)
            if np.any(fixed & ((belief.x[0, rows_k] < self._low[rows_k]) | (belief.x[0, rows_k] > self._high[rows_k]))):
                raise ArgumentError(f"the start of '{part.name}' is exact and outside its bounds", "start")
        place = [int(np.argmin(np.abs(np.array(edges) - m.time))) for m in plan]
        u = np.array([system.inputs_at(inputs, t) for t in edges])
        problem = self._problem(readings, plan, [edges[k] for k in place], np.array(edges), u, belief)
        lengths = np.repeat(np.diff(edges), self.elements)
        mesh = Mesh(len(lengths), self.points, lengths=tuple(lengths))
        rows = np.tile(belief.x, (len(edges), 1))
        for k in range(1, len(edges)):
            rows[k] = system.transition(edges[k - 1], edges[k] - edges[k - 1], rows[k - 1 : k], u[k - 1], u[k]).x[0]
        n = system.space.size
        rows = np.clip(rows, self._low[:n], self._high[:n])
        guess = Trajectory(np.array(edges), {f"x{k}": rows[:, k] for k in range(n)})
        solution = solve(problem, mesh, guess=guess, solver=self.solver, throw=False)
        # the ends of elements are points of the mesh
        trajectory = solution.trajectory
        rows_k = np.abs(trajectory.time[:, None] - np.array(edges)[None]).argmin(axis=0)
        values = np.zeros((len(trajectory.time), len(self._low)))  # states, then noises
        for k in [*range(n), *(n + self._drawn)]:
            values[:, k] = trajectory[f"x{k}"]
        return HorizonEstimate(
            system, np.array([m.time for m in plan]), values[rows_k[place], :n],
            {name: values[rows_k[place], n + along.start : n + along.stop] for name, along in self._noises.items()},
            solution.status, solution.message, self._touched(values), solution,
        )  # fmt: skip

    def _touched(self, values: np.ndarray) -> tuple[str, ...]:
        """Names of the states and noises that reach a bound."""
        size = np.abs(values).max(axis=0)
        touched = (np.minimum(values - self._low, self._high - values) <= AT_BOUND * size).any(axis=0)
        n = self.system.space.size
        places = [(part.name, columns) for part, columns, _ in self.system.space.places()]
        places += [(name, slice(n + s.start, n + s.stop)) for name, s in self._noises.items()]
        return tuple(name for name, columns in places if touched[columns].any())

    def _problem(
        self,
        readings: Mapping[str, Readings],
        plan: list[Moment],
        at: list[float],
        edges: np.ndarray,
        u: np.ndarray,
        belief: Belief,
    ) -> Optimization:
        """The window as an optimisation problem with states x and noises w."""
        system, d, drawn = self.system, self.system.dynamics, self._drawn
        n, count = system.space.size, sum(d.noise.values())
        density = np.diag(d.intensity)[drawn]
        mean, certain, root = belief.x[0], *_root(belief.P[0])
        spread = float(np.median(np.diff(edges)))
        low, high = self._low, self._high

        def known(model: Any) -> Any:
            if not d.inputs:
                return ca.SX(0, 1)
            return interpolate(model.time, edges, u).sx

        def column(model: Any, places: Any) -> Any:
            return ca.vertcat(*[getattr(model, f"x{k}").sx for k in places]) if len(places) else ca.SX(0, 1)

        def drives(model: Any) -> Any:
            w = ca.SX.zeros(count, 1)
            for k in drawn:
                w[int(k)] = getattr(model, f"x{n + k}").sx
            return w

        def costs(model: Any) -> list[Any]:
            t, x, u_known, scope = model.time.sx, column(model, range(n)), known(model), model.x0.scope

            def of(values: Any) -> Expr:
                return Expr(ca.SX(values), (values.numel(),), None, scope)

            terms = []
            difference = system.space.minus_symbols(x, ca.DM(mean))[[int(k) for k in np.flatnonzero(~certain)]]
            if root.size:
                far = ca.mtimes(ca.DM(np.linalg.inv(root)), difference)
                terms.append(misfit(of(far), [edges[0]], np.zeros((1, len(root))), sigma=1.0))
            for name, r in readings.items():
                sensor, part = system.sensors[name], system.readings[name]
                value = system.expected(sensor, t, x, u_known)
                rows = [(time, r.values[m.rows[name]]) for time, m in zip(at, plan, strict=True) if name in m.rows]
                terms += _reading_costs(part, value, rows, system.deviations[name], of)
            if drawn.size:
                w = column(model, n + drawn)
                terms.append(integral(Expr(ca.sum1(w**2 / ca.DM(density)), (), None, scope)))
            return terms

        class Window(Optimization):
            start_time = float(edges[0])
            final_time = float(edges[-1])

            def equations(self) -> Any:
                x = column(self, range(n))
                rates = ca.SX(system.rates(self.time.sx, x, known(self), drives(self)))
                for k in range(n):
                    state: Any = getattr(self, f"x{k}")
                    yield der(state) == Expr(rates[k], (), None, state.scope)

            def objective(self) -> Any:
                every = costs(self)
                return sum(every[1:], every[0])

            def constraints(self) -> Any:
                x, scope = column(self, range(n)), self.x0.scope
                difference = system.space.minus_symbols(x, ca.DM(mean))
                for k in np.flatnonzero(certain):
                    yield Expr(difference[int(k)], (), None, scope).at(self.start_time) == 0
                for part, place, _ in system.space.places():
                    if part.kind != "vector":
                        yield Expr(ca.sumsqr(x[place]), (), None, scope).at(self.start_time) == 1

        sizes = np.concatenate([_typical(system.space, belief), np.sqrt(np.diag(d.intensity) / spread)])
        declared: dict[str, Any] = {}
        for k in [*range(n), *(n + drawn)]:
            make = variable if k < n else control
            limits = [v if np.isfinite(v) else None for v in (low[k], high[k])]
            declared[f"x{k}"] = make(nominal=float(sizes[k]), min=limits[0], max=limits[1])
        return type("Window", (Window,), declared)()


def _reading_costs(
    part: Any, value: Any, rows: list[Any], deviation: np.ndarray, of: Callable[[Any], Expr]
) -> list[Any]:
    """Cost terms of the readings of one sensor, without missing numbers."""
    if part.kind != "vector":
        space = Manifold([part])
        finite = [(time, z) for time, z in rows if np.all(np.isfinite(z)) and np.any(z != 0)]
        return [
            misfit(of(space.minus_symbols(ca.DM(z), value)), [time], np.zeros((1, part.dimension)), sigma=deviation)
            for time, z in finite
        ]
    costs = []
    for c in range(part.size):
        finite = [(time, z[c]) for time, z in rows if np.isfinite(z[c])]
        if finite:
            times, values = zip(*finite, strict=True)
            costs.append(misfit(of(value[c]), times, np.array(values)[:, None], sigma=deviation[c]))
    return costs


def _root(P: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which errors are exactly zero, and the Cholesky factor of the covariance of the others. Raises ArgumentError."""
    certain = np.diag(P) <= 0
    rest = P[~certain][:, ~certain]
    scale = np.sqrt(np.diag(rest))
    try:
        return certain, scale[:, None] * np.linalg.cholesky(rest / np.outer(scale, scale))
    except np.linalg.LinAlgError:
        raise ArgumentError(
            "the covariance at the start is singular: states are fully correlated; give each its own deviation", "start"
        ) from None


def _typical(space: Manifold, belief: Belief) -> np.ndarray:
    """Typical sizes of the numbers of the state: the deviation at the start; 1 for quaternions and directions."""
    deviation = np.sqrt(np.diag(belief.P[0]))
    sizes = np.ones(space.size)
    for part, cols, along in space.places():
        if part.kind == "vector":
            sizes[cols] = np.where(deviation[along] > 0, deviation[along], np.maximum(np.abs(belief.x[0, cols]), 1e-3))
    return sizes


def _limits(
    system: System, noises: Mapping[str, slice], bounds: Mapping[str, tuple[Any, Any]]
) -> tuple[np.ndarray, np.ndarray]:
    """Bounds of all states and noises. Raises ArgumentError for an unknown name, and for bounds that cross."""
    n = system.space.size
    places = {part.name: (part.kind, cols) for part, cols, _ in system.space.places()}
    places |= {name: ("vector", slice(n + s.start, n + s.stop)) for name, s in noises.items()}
    total = n + sum(s.stop - s.start for s in noises.values())
    low, high = np.full(total, -np.inf), np.full(total, np.inf)
    for name, pair in bounds.items():
        if name not in places:
            names = ", ".join(f"'{p}'" for p in places)
            raise ArgumentError(f"there is no state or noise '{name}'; expected one of {names}", "bounds")
        kind, cols = places[name]
        if kind != "vector":
            raise ArgumentError(f"'{name}' is a {kind}, whose numbers cannot be bounded", f"bounds.{name}")
        try:
            lower, upper = pair
            low[cols] = -np.inf if lower is None else lower
            high[cols] = np.inf if upper is None else upper
        except (TypeError, ValueError):
            raise ArgumentError(f"expected (low, high), numbers or None; found {pair!r}", f"bounds.{name}") from None
        if not np.all(low[cols] <= high[cols]):
            raise ArgumentError(f"the lower bound is above the upper one: {pair!r}", f"bounds.{name}")
    return low, high
