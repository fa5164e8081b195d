"""Delayed first-order model of a controlled actuator from step responses (Dressler 2012, eq. (6.11)), and its study
with limits, table, plots and files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy
import tomli_w

from gtmodel.inference import nonlinear_fit, whiteness
from gtmodel.inference.nonlinear import by_differences, central
from gtmodel.measurements.inspection.data_tests import Data, tested
from gtmodel.results import Estimate
from gtmodel.results.estimate import half_width
from gtmodel.results.suspicion import alarms

from .._lazy import hint
from ..linear.response import late_lag
from ..results import ArgumentError, Check, Row, SolveStatus, at_most
from .options import LONGEST, StepResponse, Steps
from .record import Record, go_on
from .vibration_result import VibrationStudy, by_chance, commented, entitled, interval

if TYPE_CHECKING:
    from control import TransferFunction
else:
    TransferFunction = hint("control", "TransferFunction")

AFTER = 10  # samples that must follow a step and its delay
SURE = 0.01  # level of the likelihood-ratio test between the delay and its neighbours
SETTLED = 0.05  # of a step: allowed remainder at the end of a recording
NEVER = 3 - 2 * np.sqrt(2)  # for smaller poles the gain does not fall by 3 dB below the Nyquist frequency


@dataclass(frozen=True, eq=False)
class StepModel:
    """y = b q^-delay / (1 - a q^-1) u about the rest position of each recording.

    `estimate` names "a", "b"; `gain` = b / (1 - a) and `bandwidth_Hz` (-3 dB; None if beyond the Nyquist frequency);
    `interval(name)` gives confidence limits of all four. `residual_by_delay`: rms for each tested delay; `delay_sure`:
    the neighbouring delays are rejected at 1 %. `fitted` (N,) for each recording; `notes`: coloured residuals, effects
    that the model lacks.
    """

    a: float
    b: float
    delay: int
    delay_sure: bool
    estimate: Estimate
    gain: float
    bandwidth_Hz: float | None
    residual_by_delay: dict[int, float]
    fitted: tuple[np.ndarray, ...]
    sample_time: float
    notes: tuple[str, ...]
    synthetic: str | None

    def interval(self, name: str, level: float = 0.95) -> tuple[float, float]:
        """Confidence interval of "a", "b", "gain" or "bandwidth_Hz"; infinite for a bandwidth interval that reaches the
        Nyquist frequency. Raises ArgumentError for another name, and if there is no bandwidth."""
        if name == "gain":
            return _through(self.estimate, lambda x: x[1] / (1 - x[0]), level)[1]
        if name == "bandwidth_Hz":
            if self.bandwidth_Hz is None:
                raise ArgumentError("the bandwidth is beyond the Nyquist frequency and has no interval", "name")
            ends = _through(self.estimate, lambda x: bandwidth(float(x[0]), self.sample_time) or np.nan, level)[1]
            return ends if np.all(np.isfinite(ends)) else (-np.inf, np.inf)
        return self.estimate.interval(name, level)

    @property
    def system(self) -> TransferFunction:
        """control.TransferFunction in z, with the delay as poles at zero."""
        from .._control import control

        n = self.delay
        # b z^-n / (1 - a z^-1) = b z / (z^n (z - a)); without a delay b z / (z - a)
        if n == 0:
            return control.TransferFunction([self.b, 0.0], [1.0, -self.a], self.sample_time)
        return control.TransferFunction([self.b], [1.0, -self.a, *[0.0] * (n - 1)], self.sample_time)


def identify_step(
    records: Record | Sequence[Record],
    *,
    delay: int | None = None,
    longest: int = LONGEST,
    interrupted: Callable[[], bool] = lambda: False,
) -> StepModel:
    """Fit a, b and the delay by output error to one or several recordings of one input and one output.

    Args:
        delay: in samples; if left out, the delay of least residual from 0 to `longest`.
        interrupted: called before each delay; True ends the fit with FitStopped.

    Every recording starts at rest with its first input; its rest position is eliminated. The covariance assumes white
    noise and a known delay. Raises ArgumentError for several inputs or outputs, unequal sample times, an input that
    does not move, a delay longer than the data, copied data, and no convergence.

    >>> record = gt.vibration.step_record(
    ...     0.9647, 0.03527, 5, 1e-3, samples=400, before=25, sample_time=0.004, noise=5e-6, seed=1
    ... )
    >>> model = gt.vibration.identify_step(record)
    >>> model.delay, round(model.bandwidth_Hz, 2)
    (5, 1.43)
    """
    recordings = [records] if isinstance(records, Record) else list(records)
    _check(recordings, delay, longest)
    delays = range(0, longest + 1) if delay is None else sorted({max(delay - 1, 0), delay, delay + 1})
    scans = {}
    for d in delays:
        go_on(interrupted)
        scans[d] = _scan(recordings, d)
    best = min(scans, key=lambda d: scans[d][1]) if delay is None else delay
    count = sum(len(r) for r in recordings)
    floor = np.finfo(float).eps ** 2 * sum(float(r.y.var()) for r in recordings) * len(recordings)
    near = [scans[d][1] for d in (best - 1, best + 1) if d in scans]
    ratio = count * np.log((min(near) + floor) / (scans[best][1] + floor)) if near else np.inf
    at_end = delay is None and best == longest
    sure = bool(ratio > half_width(1 - SURE) ** 2) and not at_end

    def misfit(x: np.ndarray) -> np.ndarray:
        if abs(x[0]) >= 1:
            raise ValueError("diverges")
        return np.concatenate([_without_mean(x[1] * _unit(r, x[0], best) - r.y[:, 0]) for r in recordings])

    a0 = scans[best][0]
    fit = nonlinear_fit(by_differences(misfit, count), [a0, _gain(recordings, a0, best)], ("a", "b"))
    if fit.estimate is None:
        raise ArgumentError(
            f"the step-response fit did not converge: {fit.message}; check that it is a first-order step response"
        )
    e, (a, b) = fit.estimate, (float(x) for x in fit.x)
    T = recordings[0].sample_time
    gain, band = b / (1 - a), bandwidth(a, T)
    white = [whiteness(x) for x in np.split(misfit(fit.x), np.cumsum([len(r) for r in recordings])[:-1])]
    notes = [next((w.message for w in white if not w.passed), white[0].message)]
    above = "" if band is None else f" above {band:.3g} Hz"
    notes.append(
        "a first-order model has no resonance and no coupling: the thesis found (6.11) too slow for motions other than "
        f"its steps; do not use it{above} or to bound an ILC error"
    )
    if at_end:
        notes.append(
            f"the delay is the longest one tested, {longest} samples; the true delay may be longer: raise the limit"
        )
    elif not sure:
        notes.append(f"a delay of {best} samples cannot be distinguished from its neighbours at {100 * SURE:g} %")
    after = max(len(r) - best - int(np.flatnonzero(r.u[:, 0] != r.u[0, 0])[0]) for r in recordings)
    if a**after > SETTLED:
        notes.append(
            f"the recordings end {100 * a**after:.0f} % of the step before rest: gain and bandwidth are extrapolated; "
            "record longer"
        )
    fitted = tuple(
        b * _unit(r, a, best) + float(np.mean(r.y[:, 0] - b * _unit(r, a, best))) for r in recordings
    )  # fmt: skip
    rms = {d: float(np.sqrt(s[1] / count)) for d, s in scans.items()}
    note = "; ".join(dict.fromkeys(r.synthetic for r in recordings if r.synthetic)) or None
    return StepModel(
        a, b, best, sure, e, gain, band, rms, fitted, T, tuple(notes), note
    )  # fmt: skip


def bandwidth(a: float, sample_time: float) -> float | None:
    """Return the frequency [Hz] at which 1 / (1 - a q^-1) has fallen by 3 dB; None if beyond the Nyquist frequency.

    >>> round(gt.vibration.bandwidth(0.9647, sample_time=0.004), 3)
    1.43
    >>> gt.vibration.bandwidth(0.1, sample_time=0.004) is None
    True
    """
    if not NEVER <= a < 1:
        return None
    # (1 - a)^2 + 4 a sin^2(w T / 2) = 2 (1 - a)^2; cos(w T) would lose a slow pole to round-off
    return float(np.arcsin(min((1 - a) / (2 * np.sqrt(a)), 1.0)) / (np.pi * sample_time))


def _check(records: Sequence[Record], delay: int | None, longest: int) -> None:
    if not records:
        raise ArgumentError("there is no recording; expected at least one")
    periods = [r.sample_time for r in records]
    if np.ptp(periods) > 1e-6 * periods[0]:
        times = ", ".join(f"{1e3 * period:.6g}" for period in periods)
        raise ArgumentError(f"the recordings have the sample times {times} ms; expected equal ones: resample them")
    longest_delay = longest if delay is None else delay
    if longest_delay < 0:
        raise ArgumentError(f"the delay is {longest_delay} samples; expected 0 or more")
    for n, r in enumerate(records):
        if r.u.shape[1] != 1 or r.y.shape[1] != 1:
            raise ArgumentError(
                f"recording {n + 1} has {r.u.shape[1]} inputs and {r.y.shape[1]} outputs; expected one each"
            )
        changes = np.flatnonzero(r.u[:, 0] != r.u[0, 0])
        if not changes.size:
            raise ArgumentError(f"the input of recording {n + 1} does not move; expected a step after some rest")
        remaining = len(r) - int(changes[0])
        if longest_delay + AFTER > remaining:
            raise ArgumentError(
                f"a delay of {longest_delay} samples is longer than the data: {remaining} samples follow the step of "
                f"recording {n + 1}, expected at least {longest_delay + AFTER}; record longer, or lower the delay"
            )

    columns = {"u": np.concatenate([r.u for r in records]), "y": np.concatenate([r.y for r in records])}
    recordings = [(f"recording {n}", r.time) for n, r in enumerate(records, 1)]
    for suspicion in alarms(tested(Data(columns, list(columns), recordings=recordings))):
        raise ArgumentError(suspicion.sentence)


def _unit(r: Record, a: float, delay: int) -> np.ndarray:
    """Response (N,) from rest for b = 1."""
    u = r.u[:, 0] - r.u[0, 0]
    return late_lag(u, a, 1.0, delay)


def _without_mean(x: np.ndarray) -> np.ndarray:
    return x - x.mean()


def _gain(recordings: Sequence[Record], a: float, delay: int) -> float:
    """The least-squares b for a given a."""
    F = np.concatenate([_without_mean(_unit(r, a, delay)) for r in recordings])
    y = np.concatenate([_without_mean(r.y[:, 0]) for r in recordings])
    return float(F @ y / max(F @ F, 1e-300))


def _scan(recordings: Sequence[Record], delay: int) -> tuple[float, float]:
    """The best a for a delay, and its sum of squares; a from 0 to a time constant of ten recordings."""

    def loss(logarithm: float) -> float:
        a = 1 - np.exp(logarithm)
        b = _gain(recordings, a, delay)
        return sum(float(np.sum(_without_mean(b * _unit(r, a, delay) - r.y[:, 0]) ** 2)) for r in recordings)

    slow = np.log(0.1 / max(len(r) for r in recordings))
    grid = np.linspace(slow, -1e-9, 15)
    best = int(np.argmin([loss(x) for x in grid]))
    ends = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
    least: Any = scipy.optimize.minimize_scalar(loss, bounds=ends, method="bounded", options={"xatol": 1e-8})
    return 1 - float(np.exp(least.x)), float(least.fun)


def _through(e: Estimate, function, level: float) -> tuple[float, tuple[float, float]]:
    """A function of (a, b) and its confidence interval, by linearisation."""
    value = float(function(e.values))
    slope = central(lambda x: np.array([function(x)]), e.values)[0]
    half = half_width(level, e.degrees_of_freedom) * float(np.sqrt(slope @ e.covariance @ slope))
    return value, (value - half, value + half)


WITHIN = 0.01  # largest relative error of 1 - a and b for synthetic steps, unless their noise explains more


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class StepStudy(VibrationStudy):
    """Step responses of all recordings together; `model` is the fit."""

    model: StepModel | None = None

    def interval(self, name: str, level: float = 0.95) -> tuple[float, float]:
        """Confidence interval of "a", "b", "gain" or "bandwidth_Hz". Raises ArgumentError."""
        return super().interval(name, level) if self.model is None else self.model.interval(name, level)

    def _model_rows(self) -> list[Row]:
        m = self.model
        if m is None:
            return []
        e = m.estimate
        band = "beyond the Nyquist frequency" if m.bandwidth_Hz is None else f"{m.bandwidth_Hz:.4g}"
        return [
            Row("a", f"{m.a:.6g}{interval(e.interval('a'), '.6g')}"),
            Row("b", f"{m.b:.6g}{interval(e.interval('b'), '.6g')}"),
            Row(
                "delay", f"{m.delay}" + ("" if m.delay_sure else " (not distinguished from its neighbours)"), "samples"
            ),
            Row("delay", 1e3 * m.delay * m.sample_time, "ms"),
            Row("gain b / (1 - a)", f"{m.gain:.5g}{interval(m.interval('gain'))}"),
            Row("bandwidth", f"{band}{interval(_bandwidth_ends(m), '.4g')}", "Hz"),
            Row("residual, rms", 1e6 * e.noise, "um"),
        ]


def step_study(
    records: Sequence[Record], options: StepResponse, truth: Steps | None, title: str, interrupted: Callable[[], bool]
) -> StepStudy:
    """Fit all recordings together. Raises ArgumentError, FitStopped."""
    m = identify_step(
        records, delay=options.delay_samples, longest=options.longest_samples, interrupted=interrupted
    )  # fmt: skip
    e = m.estimate
    parameters = {"a": m.a, "b": m.b, "delay_samples": m.delay, "sample_time_s": m.sample_time}
    return StepStudy(
        status=SolveStatus.SOLVED,
        message=f"{len(records)} recording{'s'[: len(records) > 1]}, delay {m.delay} sample{'s'[: m.delay != 1]}",
        title=title,
        checks={} if truth is None else _checks(m, truth),
        figures={"step": partial(_figure, records, m, entitled(title or "step response", m.synthetic))},
        files={"parameters.toml": commented(tomli_w.dumps(parameters), m.synthetic)},
        machine_files=("parameters.toml",),
        model=m,
        notes=m.notes,
        estimate=e,
        residual=[e.noise],
        intervals={"a": list(e.interval("a")), "b": list(e.interval("b"))},
        stable=True,
        a=m.a,
        b=m.b,
        delay_samples=m.delay,
        delay_sure=m.delay_sure,
        gain=[m.gain, *m.interval("gain")],
        bandwidth=None if m.bandwidth_Hz is None else [m.bandwidth_Hz, *(_bandwidth_ends(m) or (None, None))],
        synthetic=m.synthetic,
    )


def _bandwidth_ends(m: StepModel) -> tuple[float, float] | None:
    """The interval, if it ends below the Nyquist frequency."""
    ends = None if m.bandwidth_Hz is None else m.interval("bandwidth_Hz")
    return ends if ends is not None and np.all(np.isfinite(ends)) else None


def _checks(m: StepModel, true: Steps) -> dict[str, Check]:
    chance = by_chance(m.estimate, ["a", "b"])
    errors = [(abs((1 - m.a) / (1 - true.a) - 1), max(WITHIN, float(chance[0]) / abs(1 - true.a)))]
    if true.b:
        errors.append((abs(m.b / true.b - 1), max(WITHIN, float(chance[1]) / abs(true.b))))
    error, bound = max(errors, key=lambda pair: pair[0] / pair[1])
    late = abs(m.delay - true.delay_samples)
    # if neighbouring delays explain the steps as well, the true delay may be one of them
    return {"coefficient_error": at_most(error, bound), "delay_error": at_most(late, 0 if m.delay_sure else 1)}


def _figure(records: Sequence[Record], m: StepModel, title: str) -> Any:
    from ..plot.vibration import step_figure

    runs = [(r.time, r.u[:, 0], r.y[:, 0], f) for r, f in zip(records, m.fitted, strict=True)]
    return step_figure(runs, m.residual_by_delay, m.delay, title=title)
