"""Checks of an identification, and suspicions about its log: exchanged effort columns, friction that adds energy."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from gtmodel.inference import correlation_time
from gtmodel.measurements.inspection.misread_columns import (
    Compared,
    OtherReading,
    compared,
    exchanges,
    in_order,
    reversals,
)
from gtmodel.results.suspicion import Suspicion

from ..inference import FALSE_ALARM, binomial_band, negligible
from ..measurements.inspection.data_tests import Data, tested
from ..results import Check, at_least, at_most
from ..results.estimate import half_width
from ..results.suspicion import accepted_checks, suspicion_checks
from .delay import MATTERS
from .inertia import Identification, Validation
from .recordings import Recordings, Request
from .repeated_fits import Repeated
from .rows import Rows, recorded

Array = np.ndarray
Exchanged = Compared

ROUND_OFF = 1e-9  # relative to the efforts: smaller residuals are zero


def columns_compared(
    names: Sequence[str], efforts: Array, squares_of: Callable[[Array], float], degrees_of_freedom: float
) -> Compared | None:
    """Compare columns of efforts (n, m) with all other orders and with one of them reversed; None for a single column.

    `squares_of` gives the residual sum of squares of efforts; `degrees_of_freedom` are those of the residuals.
    """
    if len(names) < 2 or degrees_of_freedom < 1:
        return None

    def rms(reading: OtherReading) -> float:
        return float(np.sqrt(max(squares_of(reading(efforts)), 0.0) / degrees_of_freedom))

    least = ROUND_OFF * float(np.sqrt(np.mean(efforts**2)))
    as_given = rms(in_order(names, range(len(names))))
    readings = [*exchanges(names), *reversals(names)]
    return compared(as_given, readings, rms, degrees_of_freedom, least=least)


def leaves(comparison: Compared, unit: str = "") -> Suspicion:
    """How the columns should be read, as a suspicion."""
    as_given, best = (f"{rms:.3g}{unit and f' {unit}'}" for rms in (comparison.given, comparison.left))
    return comparison.suspicion(f"as given the model leaves {as_given} rms of the efforts unexplained, and", best)


def exchanged_efforts(identification: Identification) -> Compared | None:
    """Test whether another order or sign of the effort columns fits far better; None for a single column.

    For every order and sign, the parameters that were free in the identification are estimated again.

    >>> class Stage(gt.Model):  # two axes with viscous friction
    ...     m, d = gt.parameter([2.0, 6.0], unit="kg"), gt.parameter([5.0, 20.0], unit="kg/s")
    ...     q, tau = gt.variable(2, unit="m"), gt.variable(2, unit="N")
    ...     def equations(self):
    ...         v = gt.der(self.q)
    ...         yield self.tau == self.m * gt.der(v) + self.d * v
    >>> time = 0.004 * np.arange(2000)
    >>> q = gt.identify.multisine(time, np.zeros(2), np.full(2, 0.2), np.array([0.5, 1.1]), seed=1)
    >>> log = gt.identify.LogSimulator(Stage(), q).draw(1, gt.identify.Sensors(effort_noise=0.5))
    >>> exchanged = {"q": log["q"], "tau": log["tau"][:, ::-1]}
    >>> s = gt.identify.study(Stage(), gt.Trajectory(time, exchanged, {"q": "m", "tau": "N"}), ["m", "d"])
    >>> order = gt.identify.exchanged_efforts(s.fit)
    >>> order.passed, order.reading.looks, round(order.given, 1), order.reading.when
    (False, 'the columns tau[0], tau[1] look exchanged', 13.4, 'when read as tau[1], tau[0]')
    """
    rows, e = identification.rows, identification.estimate
    n, m = rows.effort.shape
    free = [rows.names.index(name) for name in e.names]
    known = rows.y0 + rows.Y @ np.array([identification.fixed.get(name, 0.0) for name in rows.names])
    Y = rows.Y[:, :, free].reshape(n * m, -1)
    Q, R = np.linalg.qr(Y / np.maximum(np.linalg.norm(Y, axis=0), np.finfo(float).tiny))
    Q = Q[:, np.abs(np.diag(R)) > ROUND_OFF]

    def squares_of(efforts: Array) -> float:
        b = (efforts - known).reshape(-1)
        return float(np.sum((b - Q @ (Q.T @ b)) ** 2))

    return columns_compared(rows.targets, rows.effort, squares_of, n * m - Q.shape[1])


TINY = np.finfo(float).tiny
BALANCE = 1e-3  # of the absolute work: largest energy imbalance of a log
DEVIATIONS = 4.0  # or as many standard deviations of the work, from noise and parameter errors
ONE_SIGN = 0.98  # of a column's absolute work: friction, up to what the filter rounds off at reversals


@dataclass(frozen=True)
class MechanicalWork:
    """Work over the rows [J], positive if the drives supply it.

    `friction` (m,) is the work that friction takes, by target, in the fit without bounds, and `friction_noise` (m,) its
    standard deviation. `left` is the work of the residuals; `noise` is its standard deviation, from the noise of the
    rows and the parameter errors. `to_and_fro` is the integral of the absolute measured power.
    """

    friction: Array
    friction_noise: Array
    left: float
    to_and_fro: float
    noise: float

    @property
    def drives(self) -> Array:
        """Targets whose friction would supply energy, beyond its noise (m,)."""
        return np.asarray(self.friction < -DEVIATIONS * self.friction_noise)

    @property
    def balance(self) -> float:
        """Absolute value of `left` over the absolute work."""
        return abs(self.left) / self.to_and_fro

    @property
    def bound(self) -> float:
        """Largest allowed `balance`: a thousandth, or what the noise explains."""
        return max(BALANCE, DEVIATIONS * self.noise / self.to_and_fro)

    @property
    def balanced(self) -> bool:
        """Whether the energy balance closes within its bound."""
        return self.balance <= self.bound

    def driving(self, targets: tuple[str, ...]) -> list[str]:
        """Sentences on friction that would drive."""
        return [
            f"{t}: friction would drive instead of brake, its work is {w:.3g} J; check the sign of this effort and of "
            "its position, and the order of the columns"
            for t, w, drives in zip(targets, self.friction, self.drives, strict=True)
            if drives
        ]

    def unbalanced(self) -> list[str]:
        """Sentence on the work of the residuals beyond the noise."""
        if self.balanced:
            return []
        return [
            f"{self.left:.3g} J of {self.to_and_fro:.3g} J absolute work are unexplained, more than the noise allows: "
            "the model lacks an effect, or the efforts are delayed"
        ]


def work_of(identification: Identification, rows: Rows | None = None) -> MechanicalWork | None:
    """Return the work of an identified model over the rows of the fit, or over other rows.

    None if the targets do not act along the known coordinates: their product is then not a power.

    >>> class Axis(gt.Model):  # a cart with viscous and Coulomb friction
    ...     m, d, c = gt.parameter(2.0, unit="kg"), gt.parameter(5.0, unit="kg/s"), gt.parameter(3.0, unit="N")
    ...     q, tau = gt.variable(unit="m"), gt.variable(unit="N")
    ...     def equations(self):
    ...         v = gt.der(self.q)
    ...         yield self.tau == self.m * gt.der(v) + self.d * v + self.c * gt.sign(v)
    >>> time = 0.004 * np.arange(2000)
    >>> q = gt.identify.multisine(time, np.zeros(1), np.array([0.2]), np.array([0.5, 1.1]), seed=1)[:, 0]
    >>> log = gt.identify.LogSimulator(Axis(), q).draw(1, gt.identify.Sensors(effort_noise=0.5))
    >>> regressor = gt.identify.Regressor(Axis(), ["m", "d", "c"])
    >>> rows = gt.identify.rows_of(gt.measurements.session_of(log), regressor)
    >>> work = gt.identify.work_of(gt.identify.identify(rows))
    >>> work.friction.round(), round(work.to_and_fro), work.balanced  # friction takes 13 J of 15 J to and fro
    (array([13.]), 15, True)
    """
    rows = identification.rows if rows is None else rows
    v = rows.velocity
    if v.shape != rows.effort.shape:
        return None
    free = identification.unbounded
    share = rows.interval * rows.Y * v[:, :, None]
    sums, sizes = share.sum(axis=0), np.abs(share).sum(axis=0)
    free_columns = [rows.names.index(n) for n in free.names]
    brakes = (sums >= ONE_SIGN * sizes) & ~np.isin(rows.names, rows.signed)
    braking = np.where(brakes, sums, 0.0)[:, free_columns]
    everything = sums[:, free_columns].sum(axis=0)
    residual_power = (rows.effort - identification.modelled(rows)) * v
    by_noise = correlation_time(identification.residuals) * np.sum((identification.noise * v) ** 2) * rows.interval**2
    # parameter errors add to the residuals of other rows, not to those of the fit
    by_parameters = 0.0 if rows is identification.rows else float(everything @ free.covariance @ everything)
    return MechanicalWork(
        braking @ free.values,
        np.sqrt(np.einsum("mi,ij,mj->m", braking, free.covariance, braking)),
        float(residual_power.sum() * rows.interval),
        float(np.abs(rows.effort * v).sum() * rows.interval),
        float(np.sqrt(by_noise + by_parameters)),
    )


@dataclass(frozen=True)
class BeyondBound:
    """How far the data push a parameter beyond its bound, zero.

    `name` is the parameter whose unbounded estimate is most standard deviations below zero, by `deviations` of them;
    `value` is that estimate, `unit` its unit. If all true values are at zero or above, `deviations` exceeds `bound`
    with a probability of FALSE_ALARM at most.
    """

    name: str
    value: float
    unit: str
    deviations: float
    bound: float

    @property
    def passed(self) -> bool:
        return self.deviations <= self.bound

    @property
    def message(self) -> str:
        return (
            f"{self.name} is held at 0, but the data say {self.value:.3g} {self.unit}, {self.deviations:.3g} standard "
            "deviations below it: check the sign of effort and position, the frame (is gravity the other way round?) "
            "and the order of the channels; if it may be negative, leave it out of nonnegative"
        )


def beyond_bound(identification: Identification) -> BeyondBound | None:
    """Test whether the data push a parameter beyond its bound; None if no parameter is held at zero.

    The test is one-sided, Student's t of the fit without bounds, at the level FALSE_ALARM shared by all parameters
    (Bonferroni): it is least favourable if all true values are zero.

    >>> class Cart(gt.Model):  # gravity along the slope, which the model takes as downhill
    ...     m, f = gt.parameter(2.0, unit="kg"), gt.parameter(5.0, unit="N")
    ...     q, tau = gt.variable(unit="m"), gt.variable(unit="N")
    ...     def equations(self):
    ...         yield self.tau == self.m * gt.der(gt.der(self.q)) + self.f
    >>> time = 0.004 * np.arange(2000)
    >>> q = gt.identify.multisine(time, np.zeros(1), np.array([0.2]), np.array([0.5, 1.1]), seed=1)[:, 0]
    >>> log = gt.identify.LogSimulator(Cart(f=-5.0), q).draw(1, gt.identify.Sensors(effort_noise=0.5))
    >>> s = gt.identify.study(Cart(), log, ["m", "f"])
    >>> s.status.name, s.checks["deviations_beyond_bound"].passed, s.at_bound
    ('CHECK_FAILED', False, ['f'])
    """
    e, free = identification.estimate, identification.unbounded
    if not e.held:
        return None
    std, tests = dict(zip(free.names, free.std, strict=True)), len(free.names)
    pushed = {n: -free.value(n) / max(std[n], TINY) for n in e.held if n in std}
    name = max(pushed, key=lambda n: pushed[n])
    rows = identification.rows
    return BeyondBound(
        name, free.value(name), rows.units[rows.names.index(name)], pushed[name],
        half_width(1 - 2 * FALSE_ALARM / tests, free.degrees_of_freedom),
    )  # fmt: skip


@dataclass(frozen=True)
class HalfCutoff:
    """Comparison of a fit with that at half its cut-off frequency, which sees less noise of the position.

    `name` is the free parameter that moves most, by `moves` of its standard deviations, relative to `bound`: one, or
    what chance explains with a probability of FALSE_ALARM, shared by all parameters. `advised` is a cut-off [Hz] to
    set instead.
    """

    name: str
    moves: float
    bound: float
    cutoff: float
    advised: float

    @property
    def passed(self) -> bool:
        return self.moves <= self.bound

    @property
    def message(self) -> str:
        return (
            f"at half the cut-off of {self.cutoff:.3g} Hz, {self.name} would move by {self.moves:.3g} standard "
            "deviations: noise or jitter of the position biases it, or the model lacks an effect; set cutoff_Hz of the "
            f"filter to {self.advised:.2g} (in Python, cutoff)"
        )


def half_cutoff(identification: Identification, half: Identification, advised: float) -> HalfCutoff | None:
    """Compare a fit with that at half its cut-off, as Hausman 1978 (Econometrica 46) compares two estimators.

    The larger of the two variances stands for that of the difference, which is smaller. None if the fits have no
    parameter in common. `advised` is the cut-off of the advice [Hz].
    """
    e, other, signed = identification.estimate, half.estimate, identification.rows.signed
    names = [n for n in e.names if n in other.names and n not in signed]
    if not names:
        return None
    std, wide = (np.array([x.std[x.names.index(n)] for n in names]) for x in (e, other))
    change = np.abs([other.value(n) - e.value(n) for n in names])
    most = half_width(1 - FALSE_ALARM / len(names), other.degrees_of_freedom)
    with np.errstate(divide="ignore", invalid="ignore"):
        moves = np.where(std > 0, change / std, 0.0)
        bounds = np.maximum(MATTERS, most * np.where(std > 0, np.maximum(wide / std, 1.0), 0.0))
    worst = int(np.argmax(moves / bounds))
    return HalfCutoff(names[worst], float(moves[worst]), float(bounds[worst]), identification.rows.cutoff_Hz, advised)


LOOK = "the notes say what to look at"
READ = f"{LOOK}; if the data are right, name the alarm in accept"
UNEXPLAINED = 0.5  # rms of the residuals over rms of the effort: above, the model does not belong to the log
FAR = 300.0  # times the nominal value: a unit off by a factor of 1000, not a payload
# times the nominal values, of the median parameter: nominal values err either way, a unit off by 10 or 57 moves most of
# the parameters together
TYPICAL, ENOUGH = 5.0, 4  # ENOUGH: parameters of a median
SATURATED = 0.02  # of the samples at the largest or smallest reading: noise alone does not stay there
PILED = 5.0  # times as many samples as at the next reading: a coarse reading of a smooth peak has up to 2.5


def judged(
    request: Request,
    data: Recordings,
    identification: Identification,
    validation: Validation | None,
    repeated: Repeated | None,
    half: HalfCutoff | None,
) -> tuple[dict[str, Check], list[str]]:
    """Checks by name, and notes on suspected errors of the log: signs, units, order of columns, saturation."""
    rows, notes = identification.rows, list[str]()
    checks = {"undetermined": at_most(float(identification.identifiability.redundant), 0.0, LOOK)}
    # omitted parameters bias the others, so that the truth is no reference
    complete = all(t.passed for t in identification.left_out)
    if data.truth and complete:
        e = identification.estimate
        errors = [abs(e.value(n) - data.truth[n]) / s for n, s in zip(e.names, e.std, strict=True) if n in data.truth]
        checks["error_in_standard_deviations"] = at_most(
            float(max(errors, default=0.0)), half_width(1 - FALSE_ALARM / max(len(errors), 1), e.degrees_of_freedom)
        )
    if validation is not None:
        held_out = max(validation.judged, key=lambda h: h.ratio / h.bound)
        checks["held_out_over_fitted_noise"] = held_out.check(LOOK)
    shares = np.sqrt(np.mean(identification.residuals**2, axis=0) / np.mean(rows.effort**2, axis=0))
    checks["unexplained_share"] = at_most(float(np.max(shares)), UNEXPLAINED, READ)
    notes += [
        f"{t}: {100 * share:.3g} % of its rms is unexplained; check sign, order and units of the columns"
        for t, share in zip(rows.targets, shares, strict=True)
        if share > UNEXPLAINED
    ]
    order = exchanged_efforts(identification)
    if order is not None and not order.passed:
        notes.append(leaves(order).sentence)
    work = work_of(identification)
    if work is not None:
        if np.any(work.friction):  # some friction is free
            # relative to the noise: a drive without friction takes no work on average
            worst = int(np.argmin(work.friction / np.maximum(work.friction_noise, TINY)))
            least = -DEVIATIONS * float(work.friction_noise[worst])
            checks["work_of_friction_J"] = at_least(float(work.friction[worst]), min(least, 0.0), READ)
        balance = work if validation is None else work_of(identification, validation.rows) or work
        checks["energy_balance"] = Check(balance.balance, balance.bound, LOOK, judged=balance.balanced)
        notes += work.driving(rows.targets) + balance.unbalanced()
    delay = identification.delay
    if delay is not None:
        checks["delay_moves_a_parameter"] = Check(delay.moves, delay.bound, READ, judged=delay.passed)
    if half is not None:
        checks["cutoff_moves_a_parameter"] = at_most(half.moves, half.bound, half.message)
    if order is not None:
        checks["exchanged_columns"] = Check(order.ratio, order.bound, READ, judged=order.passed)
    beyond = beyond_bound(identification)
    if beyond is not None:
        checks["deviations_beyond_bound"] = at_most(beyond.deviations, beyond.bound, beyond.message)
    far = _far_off(identification, request.regressor.base)
    checks["parameters_far_off"] = at_most(float(len(far)), 0.0, READ)
    saturated = _piled(data, request.how.targets)
    checks["saturated_share"] = at_most(max((share for share, _ in saturated), default=0.0), SATURATED, READ)
    notes += [*far, *(sentence for share, sentence in saturated if share > SATURATED)]
    if identification.left_out:
        group = min(identification.left_out, key=lambda t: t.p * t.tests)
        least = FALSE_ALARM / group.tests
        checks["nothing_left_out"] = at_least(group.p, least, "free the parameters named by the residual test")
    if repeated is not None and not repeated.runs.interrupted:
        coverage = repeated.coverage
        low, high = binomial_band(coverage.runs, coverage.level, 1 - FALSE_ALARM / len(coverage.names))
        outside = int(np.count_nonzero((coverage.hits < low) | (coverage.hits > high))) + len(coverage.biased)
        checks["parameters_outside_the_binomial_band"] = at_most(float(outside), 0.0)
    residuals = Data(residuals=identification.residuals / identification.noise)
    more, sentences = suspicion_checks(tested(recorded(data.fitted, request.names), residuals), request.how.accept)
    checks, notes = checks | more, [*notes, *sentences]
    checks, accepted = accepted_checks(checks, request.how.accept)
    return checks, [*notes, *accepted]


def _far_off(identification: Identification, base: Sequence[str]) -> list[str]:
    """A sentence if a parameter, all of them, or their median is off by the factor of a wrong unit of position, time or
    effort.

    Those of `base` are sums and differences, which may be small. A nominal value of one counts for the median as
    unknown.
    """
    rows, e = identification.rows, identification.estimate
    sized = np.where(negligible(rows.nominal, rows.units), 0.0, rows.nominal)
    nominal = dict(zip(rows.names, sized, strict=True))
    inner = [n for n in e.names if n not in base and n not in rows.signed]
    nonzero = [n for n in inner if nominal[n] and e.interval(n)[0] * e.interval(n)[1] > 0]
    ratios = {n: abs(e.value(n) / nominal[n]) for n in nonzero}
    far = [n for n in nonzero if ratios[n] > FAR] or (nonzero if nonzero and max(ratios.values()) < 1 / FAR else [])
    if not far:
        stated = [ratios[n] for n in nonzero if nominal[n] != 1.0]
        median = float(np.median(stated)) if len(stated) >= ENOUGH else 1.0
        if 1 / TYPICAL <= median <= TYPICAL:
            return []
        return [
            f"the median parameter is {median:.3g} times its nominal value; check the units of time, position and "
            "efforts, and the nominal values"
        ]
    return [f"{far[0]} is {ratios[far[0]]:.3g} times its nominal value; check the units of time, position and efforts"]


def _piled(data: Recordings, targets: str) -> list[tuple[float, str]]:
    """Share of samples at the largest or smallest reading, with a sentence, if readings pile up there."""
    readings = []
    for session in data.fitted:
        unit = session.trajectory.unit(targets)
        effort = session.trajectory[targets].reshape(len(session.trajectory), -1)
        for k, column in enumerate(effort.T):
            name = targets if effort.shape[1] == 1 else f"{targets}[{k}]"
            levels, counts = np.unique(column, return_counts=True)
            if len(levels) < 2:
                continue
            for end, extreme, neighbour in (("largest", -1, -2), ("smallest", 0, 1)):
                if counts[extreme] > PILED * counts[neighbour]:
                    share = float(counts[extreme] / len(column))
                    sentence = (
                        f"{name} of {session.name} is at its {end} value, {levels[extreme]:.5g} {unit}, in "
                        f"{100 * share:.2g} % of the samples; if the sensor saturates there, the estimates are wrong"
                    )
                    readings.append((share, sentence))
    return readings
