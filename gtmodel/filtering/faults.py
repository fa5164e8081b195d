"""Search for the fault behind inconsistent innovations: each suspect is tested alone against the log."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..inference.chance import chi_squared_chance
from ..results.refusal import ArgumentError
from ..results.suspicion import Suspicion
from ..results.trajectory import Trajectory
from .belief import InitialState, Readings, instants, readings_of
from .error_state import ErrorState, values_of
from .filtered import Filtered
from .process import AnyProcess
from .sensors import ESTIMATE, Sensor
from .system import SAME_INSTANT, System

P_LIMIT = 1e-6  # a suspect with a smaller p-value is named; with a dozen suspects, one false alarm in 1e5 logs
SEEN = 0.5  # share of its prior deviation below which a constant counts as determined by the log
ALIKE = 20.0  # suspects this close in improvement, a likelihood ratio of e^10, cannot be distinguished
LOG_RANGE = 4.0  # a density or deviation is searched from e^-4 to e^4 times the declared one
NOISE = ("deviation", "density")
STEP = 0.1  # of the same logarithm, for the curvature of the log-likelihood
LOOKED = 512  # instants used to find the wrong noise: a factor of three shows within a hundred
COARSE = 0.2  # tolerance of the logarithm of that factor


@dataclass(frozen=True, kw_only=True)
class Suspect(Suspicion):
    """One possible fault, and the evidence for it in the log.

    name: as in "acc.offset", "tracker.delay", "arm", "acc.deviation" (its noise), "jerk.density".
    value, deviation: estimated change (k,) from the declared value and its standard deviation; for noise, the factor
    on the deviation or density. improvement: twice the gain of log-likelihood, chi-squared with k degrees of freedom
    without a fault; p: its p-value. seen: whether the motion in the log shows the fault at all.
    """

    value: np.ndarray
    deviation: np.ndarray
    improvement: float
    seen: bool


def _suspect(name: str, value: np.ndarray, deviation: np.ndarray, improvement: float, seen: bool) -> Suspect:
    factor = "factor " if name.endswith(NOISE) else ""
    evidence = f"{name} explains the log best: {factor}{', '.join(f'{v:.3g}' for v in value)}"
    p = float(chi_squared_chance(improvement, value.size))
    return Suspect(name, evidence, p, value=value, deviation=deviation, improvement=improvement, seen=seen)


@dataclass(frozen=True)
class FaultSearch:
    """Suspects, the likeliest first. named: those that explain the log best, several if they cannot be distinguished.
    unseen: those that this motion does not show. message: both in a sentence."""

    suspects: tuple[Suspect, ...]
    named: tuple[str, ...]
    unseen: tuple[str, ...]
    message: str


def find_faults(
    process: AnyProcess,
    sensors: Sequence[Sensor],
    log: Mapping[str, Any],
    initial: InitialState,
    suspects: Mapping[str, Any],
    *,
    inputs: Trajectory | None = None,
    progress: Callable[[float], bool] | None = None,
) -> FaultSearch:
    """Find the suspects that explain a log best, each one alone.

    suspects: name -> largest plausible size, a number or one per component: "SENSOR.offset", "SENSOR.scale" (change of
        1), "SENSOR.delay" [s], names of parameters of the process; and "SENSOR.deviation", "NOISE.density", whose size
        is not used. Offsets, scales, delays and parameters are estimated from the first-order dependence of the
        innovations on them; for noise the likelihood of the innovations is maximised over one factor.

    All runs in the log are assumed to have the same fault. progress: called with the fraction done; if it returns
    True, the search ends and the message lists the untried suspects. Raises ArgumentError for an unknown name.

    >>> parts = [gt.filtering.StatePart("x", unit="m")]
    >>> process = gt.filtering.DiscreteProcess(parts, 0.1, lambda s: {"x": s.x}, [1e-6])
    >>> sensors = [gt.filtering.Sensor("tape", "x", deviation=0.01), gt.filtering.Sensor("laser", "x", deviation=0.01)]
    >>> initial = gt.filtering.InitialState({}, {"x": 1.0})
    >>> drawn = gt.filtering.draw(gt.filtering.System(process, sensors), initial, 0.1 * np.arange(200), seed=1)
    >>> drawn.log["laser"] = gt.filtering.Readings(drawn.time, drawn.log["laser"].values + 0.02)
    >>> suspects = {"laser.offset": 0.1, "laser.deviation": 1.0}
    >>> faults = gt.filtering.find_faults(process, sensors, drawn.log, initial, suspects)
    >>> faults.named, faults.suspects[0].value.round(2).tolist()
    (('laser.offset',), [0.02])
    """
    system = System(process, sensors)
    for name, sensor in system.sensors.items():
        if sensor.outliers:
            raise ArgumentError(f"'{name}' weighs outliers, which hides faults; give it a gate instead", "sensors")
    constants = [name for name in suspects if name.rpartition(".")[2] not in NOISE]
    rows = _constants(process, sensors, {n: suspects[n] for n in constants}, log, initial, inputs) if constants else []
    noises, untried = [n for n in suspects if n not in constants], []
    for k, name in enumerate(noises):
        if progress is not None and progress(k / len(suspects)):
            untried = noises[k:]
            break
        rows.append(_noise(system, name, log, initial, inputs))
    rows.sort(key=lambda s: -s.improvement)
    unseen = tuple(s.name for s in rows if not s.seen)
    strong = [s for s in rows if s.seen and s.p < P_LIMIT]
    named = tuple(s.name for s in strong if s.improvement >= strong[0].improvement - ALIKE)
    message = _message(rows, named, unseen)
    if untried:
        message += f"; stopped before {', '.join(untried)}"
    return FaultSearch(tuple(rows), named, unseen, message)


def _constants(
    process: AnyProcess,
    sensors: Sequence[Sensor],
    sizes: Mapping[str, Any],
    log: Mapping[str, Any],
    initial: InitialState,
    inputs: Trajectory | None,
) -> list[Suspect]:
    """Estimate all constants from one run, linearised about the declared values, so that the search does not bias a
    filter without faults (Friedland 1969, IEEE Trans. Autom. Control 14, 359-367)."""
    by_name, estimate, declared, shifted = {s.name: s for s in sensors}, [], {}, dict(log)
    for name in sizes:
        owner, _, what = name.rpartition(".")
        if owner not in by_name:
            estimate.append(name)
            continue
        if what not in ("offset", "scale", "delay"):
            raise ArgumentError(f"expected an offset, scale, delay or deviation of {owner}; found '{what}'", "suspects")
        declared[name] = getattr(by_name[owner], what)
        if what == "delay" and owner in log:  # the stamps keep the declared delay
            shifted[owner], declared[name] = _earlier(owner, log[owner], by_name[owner].lag), 0.0
        by_name[owner] = replace(by_name[owner], **{what: ESTIMATE})  # pyrefly: ignore[bad-argument-type]
    system = System(process, [by_name[s.name] for s in sensors], estimate=estimate)
    space, n = system.space, system.own.dimension
    mean = {name: np.broadcast_to(np.asarray(v, float), (space.part(name)[0].size,)) for name, v in declared.items()}
    start = InitialState({**initial.mean, **mean}, {**initial.deviation, **dict.fromkeys(sizes, 0.0)}, initial.time)
    A, b = _score(system, n, shifted, start, inputs)
    rows = []
    for name, size in sizes.items():
        part, _, along = space.part(name)
        columns = slice(along.start - n, along.stop - n)
        try:
            plausible = np.broadcast_to(np.asarray(size, float), (part.size,))
        except (TypeError, ValueError):
            raise ArgumentError(f"expected a number, or {part.size}; found {size!r}", "suspects") from None
        if not np.all(plausible > 0):
            raise ArgumentError(f"expected a largest plausible size of '{name}' above 0; found {size!r}", "suspects")
        prior = plausible**-2.0
        seen_information, information = A[columns, columns], A[columns, columns] + np.diag(prior)
        spread = np.linalg.inv(information)
        value = spread @ b[columns]
        improvement = float(b[columns] @ value)
        relative = np.linalg.eigvalsh(spread * np.sqrt(np.outer(prior, prior)))
        seen = bool(np.all(np.isfinite(seen_information)) and np.sqrt(relative[0]) < SEEN)
        rows.append(_suspect(name, value, np.sqrt(np.diag(spread)), improvement, seen))
    return rows


def _score(
    system: System, n: int, log: Mapping[str, Any], start: InitialState, inputs: Trajectory | None
) -> tuple[np.ndarray, np.ndarray]:
    """Information matrix and score of the constants after the first n errors, summed over instants and runs."""
    flt = ErrorState(system)
    run = flt.run(log, start, inputs=inputs, keep=True)
    if run.kept is None or not run.status.ok:
        raise ArgumentError(f"the log cannot be filtered: {run.message}", "log")
    readings = readings_of(system, log)
    q = system.space.dimension - n
    A, b = np.zeros((q, q)), np.zeros(q)
    X = np.zeros((run.runs, n, q))  # sensitivity of the estimation error to the constants
    plan = instants(system, readings)[: len(run.kept)]
    values = values_of(readings, plan, run.runs)
    for k, (instant, moment) in enumerate(zip(run.kept, plan, strict=True)):
        F = np.broadcast_to(instant.step.F, (run.runs, n + q, n + q))
        X = F[:, :n, :n] @ X + F[:, :n, n:]
        names, z = values[k]
        white = np.concatenate([run.innovations[name][k] for name in names], axis=1)
        u = system.inputs_at(inputs, moment.time)
        residual, H = system.reading(names)(moment.time, instant.before.x, u, z)
        used = np.isfinite(white)  # neither missing nor beyond a gate
        residual, H = np.where(used, residual, 0.0), np.where(used[..., None], H, 0.0)
        R = np.where(used, system.variances(names), 1.0)
        PH = instant.before.P[:, :n, :n] @ np.swapaxes(H[:, :, :n], 1, 2)
        S = H[:, :, :n] @ PH
        np.einsum("mkk->mk", S)[...] += R
        D = H[:, :, :n] @ X + H[:, :, n:]
        scale = 1 / np.sqrt(np.einsum("mkk->mk", S))
        right = np.concatenate([D, residual[..., None]], axis=2) * scale[..., None]
        weighted = np.linalg.solve(S * scale[:, :, None] * scale[:, None, :], right) * scale[..., None]
        A += np.einsum("mki,mkj->ij", D, weighted[:, :, :q])
        b += np.einsum("mki,mk->i", D, weighted[:, :, q])
        X = X - PH @ weighted[:, :, :q]
    return (A + A.T) / 2, b


def _noise(
    system: System,
    name: str,
    log: Mapping[str, Any],
    initial: InitialState,
    inputs: Trajectory | None,
    tolerance: float = 0.05,
    declared: float | None = None,
) -> Suspect:
    """Maximum-likelihood factor on the deviation of a sensor or on a noise density of the process. `declared` is the
    negative log-likelihood at a factor of 1, if known."""
    owner, _, what = name.rpartition(".")
    if what == "density" and owner not in system.process.noise:
        raise ArgumentError(f"the process has no noise '{owner}'", "suspects")
    if what == "deviation" and owner not in system.sensors:
        raise ArgumentError(f"there is no sensor '{owner}'", "suspects")

    def loss(exponent: float) -> float:
        factor = float(np.exp(exponent))
        if what == "deviation":
            other = system.with_(deviations={owner: system.deviations[owner] * factor})
        else:
            other = system.with_(noise={owner: np.asarray(system.process.noise[owner]) * factor})
        run = ErrorState(other).run(log, initial, inputs=inputs, keep=False)
        return -float(run.log_likelihood.sum()) if run.status.ok else np.inf

    from scipy.optimize import minimize_scalar

    best: Any = minimize_scalar(loss, bounds=(-LOG_RANGE, LOG_RANGE), method="bounded", options={"xatol": tolerance})
    improvement = max(0.0, 2 * ((loss(0.0) if declared is None else declared) - float(best.fun)))
    curvature = (loss(best.x + STEP) - 2 * float(best.fun) + loss(best.x - STEP)) / STEP**2
    factor = float(np.exp(best.x))
    deviation = factor / np.sqrt(curvature) if curvature > 0 else np.inf
    return _suspect(name, np.array([factor]), np.array([deviation]), improvement, curvature > 1.0)


def noise_in_doubt(run: Filtered) -> tuple[Suspect, ...]:
    """Sensor deviations and process noise that alone explain the innovations of a run best, the likeliest first;
    several if the log cannot distinguish them. A coarse search on `LOOKED` instants, counted over all runs.

    Empty if no factor helps, or if the run cannot be repeated.
    """
    if run.replay is None or not len(run.time):
        return ()
    count = min(len(run.time), LOOKED)
    end, runs = run.time[count - 1], LOOKED // count
    log = {}
    for name, recorded in run.replay.log.items():
        readings = _earlier(name, recorded, 0.0)
        rows = int(np.searchsorted(readings.time, end + run.system.sensors[name].lag + SAME_INSTANT))
        if rows:
            values = readings.values[..., :rows, :]
            log[name] = Readings(readings.time[:rows], values[:runs] if values.ndim == 3 else values)
    noise = [n for n, value in run.system.process.noise.items() if np.any(np.asarray(value, float))]
    names = [*(f"{n}.deviation" for n in log), *(f"{n}.density" for n in noise)]
    start, inputs = run.replay.start, run.replay.inputs
    again = ErrorState(run.system).run(log, start, inputs=inputs, keep=False)
    declared = -float(again.log_likelihood.sum()) if again.status.ok else np.inf
    suspects = [_noise(run.system, n, log, start, inputs, COARSE, declared) for n in names]
    strong = sorted((s for s in suspects if s.p < P_LIMIT), key=lambda s: -s.improvement)
    return tuple(s for s in strong if s.improvement >= strong[0].improvement - ALIKE)


def _earlier(name: str, source: Any, lag: float) -> Any:
    if isinstance(source, Trajectory):
        source = Readings(source.time, source[name if name in source.names else source.names[0]])
    return Readings(source.time - lag, source.values)


def _message(rows: Sequence[Suspect], named: tuple[str, ...], unseen: tuple[str, ...]) -> str:
    by_name = {s.name: s for s in rows}
    if named:
        message = by_name[named[0]].evidence
        if len(named) > 1:
            message += f"; {', '.join(named[1:])} cannot be distinguished from it on this log"
    else:
        message = "none of the suspects explains the log better than chance"
    return message + (f"; this motion does not show {', '.join(unseen)}" if unseen else "")
