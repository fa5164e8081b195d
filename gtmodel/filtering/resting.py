"""A log of the sensors at rest: the noise of each sensor, and the initial state of a filter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from ..inference.chance import chi_squared_bound, chi_squared_chance, chi_squared_ends
from ..inference.residuals import autocorrelation, portmanteau
from ..measurements.rest import motion_at_rest
from ..results.refusal import ArgumentError
from ..results.trajectory import Trajectory
from .belief import InitialState, Readings
from .manifold import Manifold
from .system import System

LEAST = 20  # readings of a sensor at rest: their deviation is then known to a third
MOVES = 1.0  # standard deviations of one reading: a block mean that is further off, beyond its noise, shows a motion
LAGS = 20
COLOURED = 1e-3  # p-value of the Ljung-Box test below which noise at rest is coloured
LEVEL = 0.95
DISAGREES = 1e-4  # p-value below which the mean readings disagree with the model
RANK = 1e-9  # relative singular value below which a direction is undetermined
TOLERANCE = 1e-10  # of the step of Gauss and Newton, relative
STEPS = 100


@dataclass(frozen=True, eq=False)
class RestingLog:
    """Readings of the sensors while all states are constant.

    readings: sensor -> `Readings`. inputs: known inputs of the process meanwhile; their means are used.

    >>> rng = np.random.default_rng(1)  # synthetic: seed 1
    >>> tape = gt.filtering.Readings(0.01 * np.arange(200), 0.3 + 0.02 * rng.standard_normal(200))
    >>> list(gt.filtering.RestingLog({"tape": tape}).readings)
    ['tape']
    """

    readings: Mapping[str, Readings]
    inputs: Trajectory | None = None


class SensorAtRest(NamedTuple):
    """Noise of a sensor at rest.

    mean: of the readings (size,). deviation: of one reading (n,), low and high: its 95 % interval. mean_deviation: of
    the mean (n,), also with coloured noise. notes: sentences on coloured noise.
    """

    mean: np.ndarray
    deviation: np.ndarray
    low: np.ndarray
    high: np.ndarray
    mean_deviation: np.ndarray
    notes: tuple[str, ...]


def sensor_at_rest(system: System, rest: RestingLog, name: str) -> SensorAtRest:
    """Return the noise of a sensor from its readings at rest.

    Raises ArgumentError if there are too few readings, if they do not change, or if they are not at rest: the mean of a
    sixteenth of the log is off the mean of the log by more than its noise plus the deviation of one reading.
    """
    if name not in rest.readings:
        raise ArgumentError(f"there are no resting readings of '{name}'; give them, or its deviation", "rest")
    part, readings = system.readings[name], rest.readings[name]
    rows = np.isfinite(readings.values).all(axis=-1)
    values, time = readings.values[rows], readings.time[rows]
    if len(values) < LEAST:
        raise ArgumentError(f"expected at least {LEAST} readings of '{name}' at rest; found {len(values)}", "rest")
    space = Manifold([part])
    n = len(values)
    mean = space.mean(values[None], np.full(n, 1 / n), values[:1])
    errors = space.minus(values, np.broadcast_to(mean, values.shape))
    slow = errors - errors.mean(axis=0)
    deviation = np.sqrt(np.sum(slow**2, axis=0) / (n - 1))
    if np.any(deviation <= 0):
        raise ArgumentError(
            f"the {n} resting readings of '{name}' do not change, so they hold no noise; give its deviation, such as "
            "its resolution divided by the square root of 12",
            "rest",
        )
    motion, means = motion_at_rest(errors, allowed_deviations=MOVES)
    if motion is not None:
        raise ArgumentError(
            f"the log is not at rest: from {time[motion.begin]:.4g} to {time[motion.end - 1]:.4g} s the mean of "
            f"'{name}' is {motion.difference:+.3g} {part.error_unit} off its mean over the whole rest, "
            f"{abs(motion.difference) / motion.noise:.2g} deviations of one reading; choose a shorter rest",
            "rest",
        )
    notes, effective = [], np.full(len(deviation), float(n - 1))
    for c in range(len(deviation)):
        correlation = autocorrelation(slow[:, c], min(LAGS, n // 5))[1:]
        p = float(chi_squared_chance(portmanteau(correlation, n), len(correlation)))
        if p < COLOURED:
            lag = int(np.argmax(np.abs(correlation)))
            effective[c] = max(2.0, (n - 1) / (1 + 2 * float(np.sum(correlation**2))))
            notes.append(
                f"the noise of '{name}' at rest is coloured (correlation {correlation[lag]:.2g} at lag {lag + 1}); the "
                "filter takes it as white, so its innovations may be coloured too"
            )
    ends = np.array([chi_squared_ends(LEVEL, k) for k in effective]) / effective[:, None]
    slow_mean = np.std(means, axis=0, ddof=1) / np.sqrt(len(means))
    return SensorAtRest(
        mean[0], deviation, deviation / np.sqrt(ends[:, 1]), deviation / np.sqrt(ends[:, 0]),
        np.maximum(deviation / np.sqrt(n), slow_mean), tuple(notes),
    )  # fmt: skip


def start_from_rest(
    system: System, rest: RestingLog, sensors: Mapping[str, SensorAtRest], start: InitialState, gap: float
) -> tuple[InitialState, tuple[str, ...]]:
    """Return the initial state of a filter from a log at rest, with sentences on its limits.

    The states are constant at rest: their rates are zero, with the noise of the process as unknown constants (a brake
    or a hand may hold the machine). The states follow from the mean readings by weighted least squares. A state whose
    deviation `start` names keeps this mean and deviation as one more reading. The deviations come from those of the
    means, plus the noise of the process over `gap`, the time from the rest to the first reading [s]. Correlations
    between states are left out, as in the generated C code.

    Raises ArgumentError if readings and `start` do not determine a state.
    """
    space, d = system.space, system.dynamics
    names = tuple(n for n in system.sensors if n in sensors)
    z = np.concatenate([sensors[n].mean for n in names])[None]
    sigma = np.concatenate([sensors[n].mean_deviation for n in names])
    if system.dynamics.inputs and rest.inputs is None:
        raise ArgumentError(f"the resting log lacks the known inputs, {', '.join(d.inputs)}", "rest")
    u = np.concatenate([np.atleast_1d(np.mean(rest.inputs[n], axis=0)) for n in d.inputs]) if rest.inputs else _NONE
    t = float(next(iter(rest.readings.values())).time[0])
    wanted = space.point({**system.start_constants(), **start.mean}, "start.mean")
    rows, deviations = _priors(system, start)
    balance = _balance(system)
    x, w = wanted[None], np.zeros(sum(d.noise.values()))
    for _ in range(STEPS):
        f, Fx, Fw = balance(t, x[0], u, w)
        r, H = (a[0] for a in system.reading(names)(t, x, u, z))
        free, d_x, d_w = _null_space(f, Fx, Fw)
        J = np.vstack([H / sigma[:, None], np.eye(space.dimension)[rows] / deviations[:, None]])
        right = np.concatenate([r / sigma, space.minus(wanted[None], x)[0][rows] / deviations])
        M = J @ free[: space.dimension]
        y = np.linalg.lstsq(M, right - J @ d_x, rcond=RANK)[0]
        step = d_x + free[: space.dimension] @ y
        x, w = space.plus(x, step[None]), w + d_w + free[space.dimension :] @ y
        if not np.isfinite(x).all():
            break
        if np.all(np.abs(step) <= TOLERANCE * (1 + np.abs(space.minus(x, wanted[None])[0]))):
            break
    else:
        x = np.full_like(x, np.nan)
    if not np.isfinite(x).all():
        sentence = "the states at rest were not found from the mean readings; give start.mean near them"
        raise ArgumentError(sentence, "start")
    free, _, _ = _null_space(*balance(t, x[0], u, w))
    r, H = (a[0] for a in system.reading(names)(t, x, u, z))
    J = np.vstack([H / sigma[:, None], np.eye(space.dimension)[rows] / deviations[:, None]])
    N = free[: space.dimension]
    _, s, V = np.linalg.svd(J @ N, full_matrices=True)
    determined = int(np.sum(s > RANK * max(s.max(initial=0.0), 1e-300)))
    _refuse_undetermined(system, N @ V[determined:].T)
    R = N @ V[:determined].T / s[:determined]
    advance = system.transition(t, gap, x, u, u)
    F, Q = (np.broadcast_to(m, (1, space.dimension, space.dimension))[0] for m in (advance.F, advance.Q))
    P = F @ R @ R.T @ F.T + Q
    residuals = np.concatenate([r / sigma, space.minus(wanted[None], x)[0][rows] / deviations])
    extra = len(residuals) - determined
    notes = [note for n in names for note in sensors[n].notes]
    if extra and float(np.sum(residuals**2)) > chi_squared_bound(DISAGREES, extra):
        labels = [n for n in names for _ in range(system.readings[n].dimension)]
        k = int(np.argmax(np.abs(r / sigma)))
        notes.append(
            f"the mean readings at rest disagree with the model: that of '{labels[k]}' is {r[k]:+.3g} off, "
            f"{abs(r[k] / sigma[k]):.3g} times its deviation; a sensor has an offset, or a parameter is wrong"
        )
    size = space.errors(np.sqrt(np.maximum(np.diag(P), 0.0)))
    return InitialState(space.values(x[0]), size, start.time), tuple(dict.fromkeys(notes))


_NONE = np.zeros(0)


def _priors(system: System, start: InitialState) -> tuple[np.ndarray, np.ndarray]:
    """Indices of the errors whose deviation the start names, and these deviations."""
    space = system.space
    complete = {part.name: start.deviation.get(part.name, 1.0) for part in space.parts}
    unknown = {n: v for n, v in start.deviation.items() if n not in complete}
    P = InitialState(start.mean, {**complete, **unknown}).belief(system, 0.0).P[0]
    named = [along for part, _, along in space.places() if part.name in start.deviation]
    rows = [k for along in named for k in range(along.start, along.stop)]
    deviations = np.sqrt(np.diag(P))[rows]
    if np.any(deviations <= 0):
        raise ArgumentError("expected deviations above zero", "start.deviation")
    return np.array(rows, int), deviations


def _balance(system: System) -> Any:
    """The function (t, x, u, w) -> rates of the states, or their change per step, and its Jacobians with respect to the
    error of x and to w."""
    space, d = system.space, system.dynamics
    t, x = d.symbol("t"), d.symbol("x", space.size)
    u, w = d.symbol("u", sum(d.inputs.values())), d.symbol("w", sum(d.noise.values()))
    f = system.rates(t, x, u, w)
    f = space.minus_symbols(f, x) if d.step else f
    Fx = ca.mtimes(ca.jacobian(f, x), space.from_error(x))
    f_of = ca.Function("balance", [t, x, u, w], [f, Fx, ca.jacobian(f, w)])

    def values(*arguments: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        f, Fx, Fw = (np.asarray(v.full()) for v in f_of.call([ca.DM(a) for a in arguments]))
        return f[:, 0], Fx, Fw

    return values


def _null_space(f: np.ndarray, Fx: np.ndarray, Fw: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Basis (n + nw, k) of the changes of x and w that keep the rates, and the smallest step that makes them zero."""
    C = np.hstack([Fx, Fw])
    size = np.linalg.norm(C, axis=1)
    C, f = C / np.where(size > 0, size, 1.0)[:, None], f / np.where(size > 0, size, 1.0)
    U, s, V = np.linalg.svd(C, full_matrices=True)
    rank = int(np.sum(s > RANK * max(s.max(initial=0.0), 1e-300)))
    step = -V[:rank].T @ ((U[:, :rank].T @ f) / s[:rank])
    n = Fx.shape[1]
    return V[rank:].T, step[:n], step[n:]


def _refuse_undetermined(system: System, directions: np.ndarray) -> None:
    """Raise ArgumentError if a state moves along one of these directions (n, k)."""
    moves = np.max(np.abs(directions), axis=1, initial=0.0)
    names = [p.name for p, _, along in system.space.places() if np.any(moves[along] > 1e-6)]
    if names:
        raise ArgumentError(
            f"the resting readings do not determine {_listed(names)}; give a deviation, and a mean if it is not zero, "
            f"for {'one of them' if len(names) > 1 and directions.shape[1] < len(names) else _listed(names)}",
            "start.deviation",
        )


def _listed(names: Sequence[str]) -> str:
    quoted = [f"'{n}'" for n in names]
    return quoted[0] if len(quoted) == 1 else f"{', '.join(quoted[:-1])} and {quoted[-1]}"
