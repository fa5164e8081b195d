"""Base class of the filters (start, advance, correct, run over a log), and the error-state Kalman filter."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from ..results.refusal import ArgumentError
from ..results.trajectory import Trajectory
from .belief import (
    Belief,
    InitialState,
    Innovation,
    Moment,
    Readings,
    all_finite,
    instants,
    readings_of,
    size_of_runs,
)
from .filtered import Filtered, Replay, RunRecord
from .spread import Spread, spread_of
from .system import System
from .transition import Advance, carried

BETWEEN = 256  # instants between two calls of `progress`


class Filter(ABC):
    """Base class of the filters: `advance` and `correct` update a `Belief`, `run` processes a log.

    A belief may hold several runs as rows, so Monte Carlo uses the same code as a single run.
    """

    repeatable = False  # whether `ErrorState` of the same system gives the likelihood of a log under other noise

    def __init__(self, system: System) -> None:
        self.system = system

    @abstractmethod
    def advance(self, belief: Any, time: float, u0: np.ndarray, u1: np.ndarray) -> tuple[Any, Any]:
        """Return the belief at a later time, the known inputs linear from u0 to u1, and the step that led there."""

    def advanced(
        self, belief: Any, time: float, u0: np.ndarray, u1: np.ndarray, bends: Sequence[tuple[float, np.ndarray]]
    ) -> tuple[Any, Any]:
        """As `advance`, with known inputs whose slope changes at these times; the step is one from start to end."""
        if not bends:
            return self.advance(belief, time, u0, u1)
        step: Any = None
        for k, (t, u) in enumerate([*bends, (time, u1)]):
            belief, part = self.advance(belief, t, u0, u)
            step, u0 = part if k == 0 or part is None else step.then(part), u
        return belief, step

    @abstractmethod
    def correct(self, belief: Any, names: tuple[str, ...], z: np.ndarray, u: np.ndarray) -> tuple[Any, Innovation]:
        """Return the belief after readings z (m, numbers) of these sensors at its time, and the innovation."""

    def begin(self, start: InitialState, time: float, runs: int = 1) -> Any:
        """Return the initial belief."""
        return start.belief(self.system, time, runs)

    def summary(self, belief: Any) -> Belief:
        """Return mean and covariance of a belief."""
        return belief

    def details(self, belief: Any) -> Mapping[str, np.ndarray]:
        """Return further results of a belief: fields of `Filtered`, each with m rows."""
        return {}

    def run(
        self,
        log: Mapping[str, Any],
        start: InitialState,
        *,
        inputs: Trajectory | None = None,
        truth: Mapping[str, Any] | None = None,
        keep: bool | None = None,
        progress: Callable[[float], bool] | None = None,
    ) -> Filtered:
        """Filter a log from its first reading to its last.

        Args:
            log: sensor -> `Readings`, or a trajectory with a signal of that name. Stamps may be uneven and rates may
                differ; each reading is used at the time it was taken, its stamp minus the sensor's delay.
            start: mean and deviation at the first instant.
            inputs: known inputs of the process over the whole time, linear between the rows of the trajectory.
            truth: state -> true values at the instants, (K, size) or (m, K, size), if known: for `nees`.
            keep: whether to keep the covariances of all instants, for smoothing; only for a single run if left out.
            progress: called from time to time with the fraction done; if it returns True, the run ends early.

        Returns a `Filtered`. If a number is no longer finite, the run ends with a status that says so.
        """
        system = self.system
        readings = readings_of(system, log)
        plan = instants(system, readings)
        runs = size_of_runs([*readings.values()])
        if system.dynamics.inputs and inputs is None:
            names = ", ".join(system.dynamics.inputs)
            raise ArgumentError(f"the process has known inputs; give a trajectory of {names}", "inputs")
        if not isinstance(start, InitialState):
            raise ArgumentError(f"expected an InitialState; found {type(start).__name__}", "start")
        belief = self.begin(start, plan[0].time, runs)
        first = self.summary(belief).time
        if first > plan[0].time:
            sentence = f"the filter starts at {first:g} s, after the first reading of {plan[0].time:g} s"
            raise ArgumentError(sentence, "start.time")
        record = RunRecord(system, len(plan), runs, runs == 1 if keep is None else keep, truth)
        if self.repeatable:
            record.replay = Replay(log, start, inputs)
        u, last = system.inputs_at(inputs, first), first
        values = values_of(readings, plan, runs)
        for k, instant in enumerate(plan):
            if progress is not None and k % BETWEEN == 0 and progress(k / len(plan)):
                return record.ended("stopped")
            u_next = system.inputs_at(inputs, instant.time)
            bends = system.bends(inputs, last, instant.time)
            belief, step = self.advanced(belief, instant.time, u, u_next, bends)
            before = None if record.kept is None else self.summary(belief)
            u, last = u_next, instant.time
            names, z = values[k]
            belief, innovation = self.correct(belief, names, z, u)
            after = self.summary(belief)
            if not all_finite(after.x):
                return record.ended("not finite")
            if (silent := without_value(system, z, innovation)) is not None:
                return record.ended("not finite", silent)
            record.add(instant.time, step, before, after, innovation, self.details(belief))
        return record.ended()


def without_value(system: System, z: np.ndarray, innovation: Innovation) -> str | None:
    """A sensor with a reading for which the model has no finite value, so that the reading could not be used."""
    if innovation.whole:
        return None
    group = system.group(innovation.names)
    for n, (name, (part, columns, along)) in enumerate(zip(innovation.names, group.space.places(), strict=True)):
        present = np.isfinite(z[:, columns])
        if part.kind != "vector":
            present = np.all(present, axis=1, keepdims=True) & np.any(z[:, columns] != 0, axis=1, keepdims=True)
        if np.any(present & ~innovation.used[:, along] & ~innovation.gated[:, n, None]):
            return name
    return None


def values_of(
    readings: Mapping[str, Readings], plan: Sequence[Moment], runs: int
) -> list[tuple[tuple[str, ...], np.ndarray]]:
    """For each instant its sensors in the order of the log, and their readings side by side (m, numbers)."""
    alike: dict[tuple[str, ...], list[int]] = {}
    for k, instant in enumerate(plan):
        alike.setdefault(tuple(instant.rows), []).append(k)
    values: list[Any] = [None] * len(plan)
    for given, places in alike.items():
        names = tuple(name for name in readings if name in given)
        rows = [readings[name].values[..., [plan[k].rows[name] for k in places], :] for name in names]
        rows = [np.broadcast_to(r, (runs, *r.shape[-2:])) for r in rows]
        z = np.ascontiguousarray(np.swapaxes(np.concatenate(rows, axis=2), 0, 1))
        for k, row in zip(places, z, strict=True):
            values[k] = names, row
    return values


class ErrorState(Filter):
    """Error-state Kalman filter: mean on the manifold, covariance in the space of errors.

    For a linear process with linear sensors this is the Kalman filter, with exact steps; otherwise the extended Kalman
    filter, with CasADi's Jacobians of the functions that propagate the mean. The covariance is updated in Joseph's
    form, so it stays positive.

    Args:
        system: process and sensors.
        iterations: number of Gauss-Newton linearisations of the readings of one instant; 1 is the extended filter,
            more linearise again at the corrected mean.

    >>> class Cart(gt.Model):
    ...     x = gt.variable(unit="m")
    ...     v = gt.variable(unit="m/s")
    ...     a = gt.input(unit="m/s2")
    ...     def equations(self):
    ...         yield gt.der(self.x) == self.v
    ...         yield gt.der(self.v) == self.a
    >>> process = gt.filtering.ProcessModel(Cart(), noise={"a": 0.1}, states=["x", "v"])
    >>> system = gt.filtering.System(process, [gt.filtering.Sensor("tape", "x", deviation=0.01)])
    >>> t = 0.1 * np.arange(50)
    >>> log = {"tape": gt.filtering.Readings(t, 0.5 * t)}
    >>> run = gt.filtering.ErrorState(system).run(log, gt.filtering.InitialState({}, {"x": 1.0, "v": 1.0}))
    >>> run["v"][-1].round(3), run.deviation["v"][-1].round(3)
    (np.float64(0.5), np.float64(0.102))
    """

    repeatable = True

    def __init__(self, system: System, *, iterations: int = 1) -> None:
        super().__init__(system)
        if not isinstance(iterations, int) or iterations < 1:
            raise ArgumentError(f"expected a whole number, at least 1; found {iterations!r}", "iterations")
        self.iterations = iterations

    def advance(self, belief: Belief, time: float, u0: np.ndarray, u1: np.ndarray) -> tuple[Belief, Advance]:
        """Return the belief at a later time, and the step that led there."""
        step = self.system.transition(belief.time, time - belief.time, belief.x, u0, u1)
        return Belief(time, step.x, carried(step.F, belief.P, step.Q)), step

    def correct(
        self, belief: Belief, names: tuple[str, ...], z: np.ndarray, u: np.ndarray
    ) -> tuple[Belief, Innovation]:
        """Return the belief after readings z (m, numbers) of these sensors, side by side, and the innovation."""
        residual, H, S, PH = self.seen(belief, names, z, u)
        spread = spread_of(self.system, names, residual, S, PH)
        solved = spread.solved()
        return self.corrected(belief, names, z, u, spread, solved.K, H), spread.innovation(names, solved)

    def seen(self, belief: Belief, names: tuple[str, ...], z: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return residuals (m, k) of these readings, their Jacobian H, their covariance H P H' without noise, and the
        cross-covariance P H' with the error of the state."""
        residual, H = self.system.reading(names)(belief.time, belief.x, u, z)
        if len(H) == 1:
            PH = np.dot(belief.P[0], H[0].T)
            return residual, H, np.dot(H[0], PH)[None], PH[None]
        PH = belief.P @ H.mT
        return residual, H, H @ PH, PH

    def corrected(
        self,
        belief: Belief,
        names: tuple[str, ...],
        z: np.ndarray,
        u: np.ndarray,
        spread: Spread,
        K: np.ndarray,
        H: np.ndarray,
    ) -> Belief:
        """Return the belief after readings with this gain."""
        system, space = self.system, self.system.space
        d = np.dot(K[0], spread.residual[0])[None] if len(K) == 1 else (K @ spread.residual[..., None])[..., 0]
        for _ in range(self.iterations - 1):
            x = space.plus(belief.x, d)
            residual, H, S, PH = self.seen(Belief(belief.time, x, belief.P), names, z, u)
            residual = residual - (H @ space.minus(belief.x, x)[..., None])[..., 0]
            again = spread_of(system, names, residual, S, PH, spread.choice)
            K = again.solved().K
            d = (K @ again.residual[..., None])[..., 0]
        P = joseph(belief.P, K, H if spread.whole else np.where(spread.used[..., None], H, 0.0), spread.R)
        if system.curved_errors:
            J = space.carried(belief.x, d)
            P = J @ P @ J.mT
        return Belief(belief.time, space.plus(belief.x, d), P)


@lru_cache(maxsize=32)
def _identity(n: int) -> np.ndarray:
    one = np.eye(n)
    one.flags.writeable = False
    return one


def joseph(P: np.ndarray, K: np.ndarray, H: np.ndarray, R: np.ndarray) -> np.ndarray:
    """Covariance (m, n, n) after a correction with any gain K: a sum of two positive semidefinite matrices."""
    if len(P) == 1:
        K, H = K[0], H[0]
        A = _identity(len(K)) - np.dot(K, H)
        return (np.dot(np.dot(A, P[0]), A.T) + np.dot(K * R, K.T))[None]
    A = _identity(K.shape[1]) - K @ H
    return A @ P @ A.mT + (K * R[:, None, :]) @ K.mT


def kalman(system: System, **options: Any) -> ErrorState:
    """Return the Kalman filter of a linear system. Raises ArgumentError if process or sensors are not linear.

    >>> parts = [gt.filtering.StatePart("x", unit="m")]
    >>> process = gt.filtering.DiscreteProcess(parts, 0.1, lambda s: {"x": s.x}, [1e-4])
    >>> system = gt.filtering.System(process, [gt.filtering.Sensor("tape", "x", deviation=0.01)])
    >>> type(gt.filtering.kalman(system)).__name__
    'ErrorState'
    """
    if not system.linear:
        raise ArgumentError("the Kalman filter needs a linear process and linear sensors; use ErrorState", "filter")
    return ErrorState(system, **options)
