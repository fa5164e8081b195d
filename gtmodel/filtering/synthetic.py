"""Synthetic readings of a known motion, or of motions drawn from the process noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..results.refusal import ArgumentError
from ..results.trajectory import Trajectory
from .belief import InitialState, Readings
from .manifold import Manifold
from .system import System


class Drawn(NamedTuple):
    """Synthetic runs: the instants (K,) [s], the true states (m, K, size) by name, and the log for a filter."""

    time: np.ndarray
    truth: dict[str, np.ndarray]
    log: dict[str, Readings]


def synthetic_readings(
    system: System,
    time: np.ndarray,
    states: np.ndarray,
    *,
    seed: int,
    runs: int = 1,
    faults: Mapping[str, Any] | None = None,
    inputs: Trajectory | None = None,
) -> dict[str, Readings]:
    """Return synthetic readings of true states (K, size) or (m, K, size) at times (K,) [s].

    Each sensor reads at multiples of its period, or at each time if it has no period, with its declared delay and
    noise; the random generator of sensor k starts from (seed, k). faults: sensor -> a number or (size,) to add to each
    of its readings, in the unit of the reading.

    >>> path, body = gt.filtering.TrackedPath(), gt.filtering.TranslatingBody()
    >>> process = gt.filtering.ProcessModel(body, noise={"jerk": 0.1}, states=["p", "v", "a"])
    >>> system = gt.filtering.System(process, [gt.filtering.Sensor("tracker", "p", deviation=6.4e-6)])
    >>> motion = path.motion(0.001 * np.arange(100))
    >>> states = np.concatenate([motion.p, motion.v, motion.a], axis=1)
    >>> log = gt.filtering.synthetic_readings(system, motion.time, states, seed=1)
    >>> float(np.abs(log["tracker"].values - motion.p).max().round(6))
    2e-05
    """
    states = np.asarray(states, float)
    states = states[None] if states.ndim == 2 else states
    runs = max(runs, len(states))
    u = np.array([system.inputs_at(inputs, t) for t in time])
    log = {}
    for k, (name, sensor) in enumerate(system.sensors.items()):
        rng = np.random.default_rng([seed, k])
        rows = _rows(np.asarray(time, float), sensor.period, name)
        part = system.readings[name]
        values = np.array([system.read((name,), float(time[row]), states[:, row], u[row]) for row in rows])
        values = np.broadcast_to(np.swapaxes(values, 0, 1), (runs, len(rows), part.size))
        noise = rng.normal(size=(runs, len(rows), part.dimension)) * system.deviations[name]
        if name in system.mixing:
            noise = noise @ system.mixing[name].T
        with_noise = Manifold([part]).plus(values, noise) + np.asarray((faults or {}).get(name, 0.0))
        log[name] = Readings(np.asarray(time)[rows] + sensor.lag, with_noise if runs > 1 else with_noise[0])
    return log


def draw(
    system: System,
    initial: InitialState,
    time: Sequence[float] | np.ndarray,
    *,
    seed: int,
    runs: int = 1,
    inputs: Trajectory | None = None,
) -> Drawn:
    """Draw motions from the process noise of a system, and synthetic readings of them.

    The true state starts at `initial` plus a random error of its deviation, and follows the process with its noise. A
    correct filter is consistent on such runs. time: the instants (K,) [s], in order; `initial.time` may be earlier.
    Estimated constants are drawn too. Raises ArgumentError for instants out of order.

    >>> parts = [gt.filtering.StatePart("x", unit="m")]
    >>> process = gt.filtering.DiscreteProcess(parts, 0.1, lambda s: {"x": s.x}, [1e-4])
    >>> system = gt.filtering.System(process, [gt.filtering.Sensor("tape", "x", deviation=0.01)])
    >>> runs = gt.filtering.draw(system, gt.filtering.InitialState({}, {"x": 1.0}), 0.1 * np.arange(20), seed=1, runs=5)
    >>> runs.truth["x"].shape, runs.log["tape"].values.shape
    ((5, 20), (5, 20, 1))
    """
    times = np.asarray(time, float)
    if times.ndim != 1 or not len(times) or np.any(np.diff(times) <= 0):
        raise ArgumentError("expected instants (K,) in order", "time")
    rng = np.random.default_rng([seed, len(system.sensors)])
    belief = initial.belief(system, times[0], runs)
    if belief.time > times[0]:
        raise ArgumentError(f"the start at {belief.time:g} s is after the first instant, {times[0]:g} s", "time")
    n = system.space.dimension
    error = rng.normal(size=(runs, n))
    if np.any(belief.P[0] != np.diag(np.diag(belief.P[0]))):
        error = error @ root_of(belief.P[:1])[0].T
    else:
        error = error * np.sqrt(np.einsum("mii->mi", belief.P))
    x = system.space.plus(belief.x, error)
    states = np.empty((runs, len(times), system.space.size))
    before, u = belief.time, system.inputs_at(inputs, belief.time)
    for k, t in enumerate(times):
        if t > before:
            u_next, step = system.inputs_at(inputs, t), None
            for end, u_end in [*system.bends(inputs, before, t), (float(t), u_next)]:
                part = system.transition(before, end - before, x if step is None else step.x, u, u_end)
                step, before, u = part if step is None else step.then(part), end, u_end
            assert step is not None
            d = (root_of(np.broadcast_to(step.Q, (runs, n, n))) @ rng.normal(size=(runs, n))[..., None])[..., 0]
            x = system.space.plus(step.x, d)
        states[:, k] = x
    log = synthetic_readings(system, times, states, seed=seed, runs=runs, inputs=inputs)
    return Drawn(times, system.space.values(states), log)


def root_of(Q: np.ndarray) -> np.ndarray:
    """A root L of covariances (m, n, n), L L' = Q, also if they are singular or have entries that differ by 1e18.

    It uses the symmetric root of the correlations, which does not depend on signs and order of the eigenvectors: these
    differ between processors.
    """
    scale = np.sqrt(np.einsum("mii->mi", Q))
    safe = np.where(scale > 0, scale, 1.0)
    values, vectors = np.linalg.eigh(Q / safe[:, :, None] / safe[:, None, :])
    return scale[:, :, None] * ((vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]) @ vectors.swapaxes(1, 2))


def _rows(time: np.ndarray, period: float | None, name: str) -> np.ndarray:
    """Rows at which a sensor reads. Raises ArgumentError if the times skip an instant at which it is due."""
    if period is None:
        return np.arange(len(time))
    due = np.round((time - time[0]) / period)
    near = np.abs(time - time[0] - due * period) < 1e-6 * period
    rows = np.flatnonzero(near)
    steps = np.diff(time)
    for k in np.flatnonzero(np.diff(due[rows]) > 1):
        first, last = rows[k], rows[k + 1]
        if steps[first:last].max() < period * (1 - 1e-6):
            raise ArgumentError(
                f"'{name}' reads every {period:g} s, but no time between {time[first]:g} s and {time[last]:g} s is "
                "a multiple of its period; give times whose step divides the period",
                "time",
            )
    return rows
