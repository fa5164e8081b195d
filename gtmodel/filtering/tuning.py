"""Noise of a filter: maximum likelihood from the innovations, and noise that changes with time for smoothing."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..linear.roots import bisected
from ..results.estimate import half_width
from ..results.refusal import ArgumentError
from ..results.trajectory import Trajectory
from .belief import SAME_INSTANT, Belief, InitialState, Readings, instants, readings_of
from .error_state import ErrorState
from .manifold import Manifold
from .system import System, agree_in_shape
from .transition import Advance, carried

TOLERANCE = 0.02  # of the logarithm of a density; far below its confidence interval on any log
STEP = 0.1  # of the logarithm, for the curvature of the likelihood
LOOSE = 1.0  # standard deviation of a logarithm above which it is undetermined: a 95 % interval of a factor of 50
DROP = 1.92  # of the log-likelihood at the ends of a 95 % interval of one parameter: half of chi-squared's 3.84
FARTHEST = 64.0  # of the logarithm, from the best
SHARES = 0.3  # of the largest component of a flat direction: names with less do not count
COARSE = 400  # instants for a first guess: a decade shows within a hundred
GUESS_STEPS = (4.6, 2.3, 1.0)  # of the logarithms: two decades, one, half of one


@dataclass(frozen=True, eq=False)
class Tuned:
    """Maximum-likelihood noise of a log.

    system: with this noise. values: name -> density or deviation, the declared one times its factor. factors: name ->
    factor. intervals: name -> its 95 % interval from the curvature of the likelihood, infinite if the log does not
    determine it. log_likelihood: of the log; improvement: its increase over the declared noise. curvature: second
    derivatives of the negative log-likelihood with respect to the logarithms of the factors (n, n), in the order of
    `values`. undetermined: names that the log does not determine, alone or together. notes: sentences about them.
    """

    system: System
    values: dict[str, Any]
    factors: dict[str, float]
    intervals: dict[str, tuple[float, float]]
    log_likelihood: float
    improvement: float
    curvature: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    undetermined: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def tune(
    system: System,
    log: Mapping[str, Any],
    initial: InitialState,
    names: Sequence[str],
    *,
    inputs: Trajectory | None = None,
    progress: Callable[[float], bool] | None = None,
) -> Tuned:
    """Fit process noise densities and sensor deviations by maximum likelihood of the innovations.

    names: "NOISE.density" and "SENSOR.deviation"; one factor multiplies all components of each. The search is
    Nelder-Mead on the logarithms of the factors. The tuned filter need not be consistent: check it with `consistency`.

    A reading that a gate leaves out counts as one at the edge of its gate, so that a filter cannot become likelier by
    closing its gates. progress: called with the fraction done; if it returns True, the search ends with the best noise
    so far and infinite intervals.

    Raises ArgumentError for a wrong name, and if the likelihood is not finite with the declared noise.

    >>> parts = [gt.filtering.StatePart("x", unit="m")]
    >>> process = gt.filtering.DiscreteProcess(parts, 0.1, lambda s: {"x": s.x}, [1e-4])
    >>> system = gt.filtering.System(process, [gt.filtering.Sensor("tape", "x", deviation=0.01)])
    >>> initial = gt.filtering.InitialState({}, {"x": 1.0})
    >>> drawn = gt.filtering.draw(system, initial, 0.1 * np.arange(200), seed=1)
    >>> doubtful = system.with_(deviations={"tape": 0.05})
    >>> tuned = gt.filtering.tune(doubtful, drawn.log, initial, ["tape.deviation"])
    >>> low, high = tuned.intervals["tape.deviation"]
    >>> low < 0.01 / 0.05 < high
    True
    """
    from scipy.optimize import minimize

    for name in names:
        noises = system.process.noise
        tunable = [*(f"{n}.density" for n in noises), *(f"{n}.deviation" for n in system.sensors)]
        if name not in tunable:
            raise ArgumentError(f"there is no '{name}' to tune; expected one of {', '.join(tunable)}", "names")
    if not names:
        raise ArgumentError("name at least one noise to tune", "names")

    calls, stopped = 0, False

    def loss(exponents: np.ndarray) -> float:
        nonlocal calls, stopped
        calls += 1
        stopped = stopped or (progress is not None and progress(min(0.99, calls / (60 * len(names)))))
        if stopped and calls > 1:
            return 1e300
        run = ErrorState(_scaled(system, names, np.asarray(exponents))).run(log, initial, inputs=inputs, keep=False)
        total = -float(run.log_likelihood.sum())
        return total if run.status.ok and np.isfinite(total) else 1e300

    def ends(_: np.ndarray) -> None:
        if stopped:
            raise StopIteration  # SciPy ends the search

    zero = np.zeros(len(names))
    declared = loss(zero)
    if declared >= 1e300:
        raise ArgumentError("the likelihood of the log is not finite with the declared noise", "system")
    simplex = np.vstack([zero, np.eye(len(names))])
    options = {"xatol": TOLERANCE, "fatol": 1e-3, "initial_simplex": simplex}
    best = minimize(loss, zero, method="Nelder-Mead", options=options, callback=ends)
    if best.fun >= declared:  # stopped before anything else was tried
        best.x, best.fun = zero, declared
    variance = np.full(len(names), np.nan)
    curvature = _curvature(loss, best.x, float(best.fun))
    groups = [] if stopped else [*flat_directions(names, curvature)]
    if not stopped:
        variance = _variances(names, curvature, groups)
    half = np.nan_to_num(half_width(0.95) * np.sqrt(variance), nan=np.inf)
    tuned = _scaled(system, names, best.x)
    values = {n: tuned.process.noise[n[:-8]] if n.endswith(".density") else tuned.deviations[n[:-10]] for n in names}
    factors = {n: float(np.exp(x)) for n, x in zip(names, best.x, strict=True)}
    with np.errstate(over="ignore"):
        intervals = {
            n: (float(np.exp(x - h)), float(np.exp(x + h))) for n, x, h in zip(names, best.x, half, strict=True)
        }
    notes = []
    for group in groups:
        if len(group) != 1:
            intervals |= dict.fromkeys(group, (0.0, np.inf))
            notes.append(
                f"{' and '.join(group)} cannot be told apart: the log determines only a combination of them; give the "
                f"value of {'one' if len(group) == 2 else 'some'} of them"
            )
            continue
        k, value = names.index(group[0]), float(np.max(values[group[0]]))
        low, high = (_bound(loss, best.x, float(best.fun), k, sign) for sign in (-1.0, 1.0))
        intervals[group[0]] = low * factors[group[0]], high * factors[group[0]]
        shown = [f"at least {value * low:.3g}"] if low > 0 else []
        shown += [f"at most {value * high:.3g}"] if np.isfinite(high) else []
        notes.append(
            f"the likelihood is flat in {group[0]}: the log "
            + (f"only shows that it is {' and '.join(shown)}" if shown else "does not show it at all")
            + "; give its value, or a log that shows it"
        )
    undetermined = tuple(dict.fromkeys(name for group in groups for name in group))
    return Tuned(
        tuned, values, factors, intervals, -float(best.fun), declared - float(best.fun), curvature, undetermined,
        tuple(notes),
    )  # fmt: skip


def flat_directions(names: Sequence[str], curvature: np.ndarray) -> tuple[tuple[str, ...], ...]:
    """Return the groups of names that a log does not determine; names of one group cannot be told apart.

    curvature: second derivatives of the negative log-likelihood with respect to the logarithms of the factors (n, n).
    An eigenvector along which the standard deviation of the logarithm exceeds `LOOSE` is a flat direction, and the
    names of its large components are a group.

    >>> from gtmodel.filtering.tuning import flat_directions
    >>> flat_directions(["a.density", "b.density", "c.density"], 50 * np.array([[1, 1, 0], [1, 1, 0], [0, 0, 1.0]]))
    (('a.density', 'b.density'),)
    """
    values, vectors = np.linalg.eigh((curvature + curvature.T) / 2)
    groups = []
    for value, v in zip(values, vectors.T, strict=True):
        if value < LOOSE**-2:
            large = np.abs(v) > SHARES * np.abs(v).max()
            groups.append(tuple(n for n, is_large in zip(names, large, strict=True) if is_large))
    return tuple(dict.fromkeys(groups))


def _variances(names: Sequence[str], curvature: np.ndarray, groups: Sequence[tuple[str, ...]]) -> np.ndarray:
    """Variances of the logarithms of the factors (n,); infinite if the log does not determine a name."""
    try:
        variance = np.diag(np.linalg.inv(curvature)).copy()
    except np.linalg.LinAlgError:
        variance = np.full(len(names), np.nan)
    wrong = ~(variance > 0)
    if wrong.any():
        values, vectors = np.linalg.eigh((curvature + curvature.T) / 2)
        firm = values >= LOOSE**-2
        variance[wrong] = np.sum(vectors[:, firm] ** 2 / values[firm], axis=1)[wrong]
        flat = {name for group in groups for name in group}
        variance[[n in flat and w for n, w in zip(names, wrong, strict=True)]] = np.inf
        variance[~(variance > 0)] = np.inf
    return variance


def _bound(loss: Callable[[np.ndarray], float], best: np.ndarray, least: float, k: int, sign: float) -> float:
    """The factor of noise k, below or above the best, at which the likelihood alone excludes it at 95 %: its logarithm
    is 1.92 below the largest. 0 or infinite if there is none within `FARTHEST`."""

    def excess(e: float) -> float:
        x = best.copy()
        x[k] += sign * e
        return loss(x) - least - DROP

    low, high = 0.0, 1.0
    while excess(high) < 0:
        low, high = high, 2 * high
        if high > FARTHEST:
            return np.inf if sign > 0 else 0.0
    return float(np.exp(sign * bisected(lambda e: excess(e) <= 0, low, high, 6)[1]))


def first_guess(
    system: System,
    log: Mapping[str, Any],
    initial: InitialState,
    names: Sequence[str],
    *,
    inputs: Trajectory | None = None,
) -> System:
    """Return the system with a rough guess of these noises, from nothing but the log.

    A sensor starts from the second differences of its readings. All densities start from the decade with the largest
    likelihood of the first `COARSE` instants; a pattern search on the logarithms follows. Raises ArgumentError if no
    noise gives a finite likelihood, and for a sensor whose readings do not change.
    """
    readings = readings_of(system, log)
    deviations = {}
    for name in (n.removesuffix(".deviation") for n in names if n.endswith(".deviation")):
        if name not in readings:
            raise ArgumentError(f"the log has no readings of '{name}', whose deviation is to be estimated", "log")
        values = readings[name].values[np.isfinite(readings[name].values).all(axis=-1)]
        space = Manifold([system.readings[name]])
        errors = space.minus(values, np.broadcast_to(values[:1], values.shape))
        guess = np.sqrt(np.mean(np.diff(errors, n=2, axis=0) ** 2, axis=0) / 6) if len(values) > 2 else np.zeros(1)
        if not np.all(guess > 0):
            raise ArgumentError(
                f"the readings of '{name}' do not change enough to estimate its deviation; give it", "log"
            )
        deviations[name] = guess
    system = system.with_(deviations=deviations)
    short = shortened(system, readings, COARSE)

    def loss(exponents: np.ndarray) -> float:
        run = ErrorState(_scaled(system, names, exponents)).run(short, initial, inputs=inputs, keep=False)
        total = -float(run.log_likelihood.sum())
        return total if run.status.ok and np.isfinite(total) else 1e300

    noises = np.array([1.0 if n.endswith(".density") else 0.0 for n in names])
    tried = [(loss(e * noises), e) for e in np.log(10) * np.arange(-12, 13, 2)] if noises.any() else [(1e300, 0.0)]
    best = min(tried)[1] * noises
    least = loss(best)
    for step in GUESS_STEPS:
        moved, rounds = True, 0
        while moved and rounds < 8:
            moved, rounds = False, rounds + 1
            for k in range(len(names)):
                for sign in (1, -1):
                    other = best.copy()
                    other[k] += sign * step
                    if (value := loss(other)) < least - 1e-3:
                        best, least, moved = other, value, True
                        break
    if least >= 1e300:
        raise ArgumentError(
            "no noise gives the log a finite likelihood; check the model, the units of the readings and the start",
            "log",
        )
    return _scaled(system, names, best)


def shortened(system: System, readings: Mapping[str, Readings], count: int) -> dict[str, Readings]:
    """Return the readings of the first `count` instants."""
    plan = instants(system, readings)
    if len(plan) <= count:
        return dict(readings)
    end, short = plan[count - 1].time + SAME_INSTANT, {}
    for name, r in readings.items():
        rows = r.time - system.sensors[name].lag <= end
        if rows.any():
            short[name] = Readings(r.time[rows], r.values[..., rows, :])
    return short


def _scaled(system: System, names: Sequence[str], exponents: np.ndarray) -> System:
    """The system with these noises multiplied by the exponentials of these numbers."""
    factors = dict(zip(names, np.exp(exponents), strict=True))
    noise = {n[:-8]: np.asarray(system.process.noise[n[:-8]]) * f for n, f in factors.items() if n.endswith(".density")}
    deviations = {n[:-10]: system.deviations[n[:-10]] * f for n, f in factors.items() if n.endswith(".deviation")}
    return system.with_(noise, deviations)


def _curvature(loss: Callable[[np.ndarray], float], x: np.ndarray, least: float) -> np.ndarray:
    """Second differences of the loss (n, n)."""
    n, H = len(x), np.zeros((len(x), len(x)))
    steps = STEP * np.eye(n)
    for i in range(n):
        H[i, i] = (loss(x + steps[i]) - 2 * least + loss(x - steps[i])) / STEP**2
        for j in range(i):
            corner = loss(x + steps[i] + steps[j]) - loss(x + steps[i] - steps[j])
            other = loss(x - steps[i] + steps[j]) - loss(x - steps[i] - steps[j])
            H[i, j] = H[j, i] = (corner - other) / (4 * STEP**2)
    return H


LEAST_CHANCE = 1e-300  # of a mode that no other mode leads to; avoids a division by zero


class ScheduledNoise(ErrorState):
    """Error-state filter that uses, at each step, one of several systems that differ in noise.

    Interacting models give the probability of each system at each instant, and `likely_modes` the most likely system
    given the whole log. This filter uses these systems, so that `smooth` has a single step between instants.

    Args:
        systems: with the same states and sensors, such as `system.with_(noise={"jerk": 1e6})`.
        time: instants (K,), increasing [s].
        modes: index of the system (K,) of the step that ends at each instant. The first one is used before these
            instants, the last one after them.
        iterations: as in `ErrorState`.

    Raises ArgumentError for systems that differ in states or sensors, and for modes out of range.

    >>> parts = [gt.filtering.StatePart("x", unit="m")]
    >>> tape = gt.filtering.Sensor("tape", "x", deviation=0.01)
    >>> def walk(variance):
    ...     process = gt.filtering.DiscreteProcess(parts, 0.1, lambda s: {"x": s.x}, [variance])
    ...     return gt.filtering.System(process, [tape])
    >>> t = 0.1 * np.arange(40)
    >>> filter = gt.filtering.ScheduledNoise([walk(1e-6), walk(1e-2)], t, (t > 2).astype(int))
    >>> log = {"tape": gt.filtering.Readings(t, np.where(t < 2, 0.0, t - 2))}
    >>> smoothed = gt.filtering.smooth(filter.run(log, gt.filtering.InitialState({}, {"x": 0.1})))
    >>> smoothed.deviation["x"][[15, 30]].round(4).tolist()  # at rest, and moving
    [0.0027, 0.0099]
    """

    repeatable = False

    def __init__(self, systems: Sequence[System], time: Any, modes: Any, *, iterations: int = 1) -> None:
        self.systems = (*systems,)
        if not self.systems:
            raise ArgumentError("expected at least one system; found none", "systems")
        super().__init__(self.systems[0], iterations=iterations)
        agree_in_shape(self.systems)
        self.time, self.modes = np.asarray(time, float), np.asarray(modes)
        if self.time.ndim != 1 or self.modes.shape != self.time.shape or not len(self.time):
            raise ArgumentError(
                f"expected instants (K,) and a mode for each; found {self.time.shape} and {self.modes.shape}", "modes"
            )
        if not np.all(np.diff(self.time) >= 0):
            raise ArgumentError("the instants do not increase", "time")
        if not np.issubdtype(self.modes.dtype, np.integer) or not np.all(
            (self.modes >= 0) & (self.modes < len(self.systems))
        ):
            raise ArgumentError(f"expected indices of systems, 0 to {len(self.systems) - 1}", "modes")

    def advance(self, belief: Belief, time: float, u0: np.ndarray, u1: np.ndarray) -> tuple[Belief, Advance]:
        """Return the belief at a later time, with the system of that time, and the step that led there."""
        k = min(int(np.searchsorted(self.time, time - SAME_INSTANT)), len(self.time) - 1)
        system = self.systems[int(self.modes[k])]
        step = system.transition(belief.time, time - belief.time, belief.x, u0, u1)
        return Belief(time, step.x, carried(step.F, belief.P, step.Q)), step


def likely_modes(probabilities: Any, chances: Any) -> np.ndarray:
    """Return the most likely mode (K,) at each instant, given the whole log.

    Args:
        probabilities: of the modes after the readings of each instant (K, modes), from interacting models.
        chances: transition probabilities between two instants (modes, modes), from row to column.

    Raises ArgumentError for shapes that do not match.

    Source: Kim 1994, Journal of Econometrics 60, 1-22, for the recursion.

    >>> stay = np.array([[0.99, 0.01], [0.01, 0.99]])
    >>> seen = [[0.99, 0.01], [0.7, 0.3], [0.1, 0.9], [0.02, 0.98]]  # the filter needs an instant to see a change
    >>> gt.filtering.likely_modes(seen, stay).tolist()
    [0, 1, 1, 1]
    """
    p, change = np.asarray(probabilities, float), np.asarray(chances, float)
    if p.ndim != 2 or change.shape != (p.shape[1], p.shape[1]):
        raise ArgumentError(
            f"expected (K, modes) and (modes, modes); found {p.shape} and {change.shape}", "probabilities"
        )
    whole = p.copy()
    for k in range(len(p) - 2, -1, -1):
        ahead = np.maximum(p[k] @ change, LEAST_CHANCE)
        whole[k] = p[k] * (change @ (whole[k + 1] / ahead))
        whole[k] /= max(whole[k].sum(), LEAST_CHANCE)
    return np.argmax(whole, axis=1)
