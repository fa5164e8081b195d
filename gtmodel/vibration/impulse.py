"""Resonances from the decay after a hit: realisation from a Hankel matrix, then damped sines; the study with table,
checks against a synthetic hit, plot and file."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy
import tomli_w

from gtmodel.inference import nonlinear_fit, whiteness
from gtmodel.inference.nonlinear import by_differences
from gtmodel.results import Estimate

from .._lazy import hint
from ..linear.state_space import continuous_poles, frequency_and_damping
from ..results import ArgumentError, Check, Row, SolveStatus, at_least, at_most
from .options import MOST_MODES, Hit, Impulse
from .output_error import REWEIGHTED, settled, weights_of
from .physical_form import NEAR
from .record import Record, block_hankel, columns, go_on
from .vibration_result import VibrationStudy, by_chance, commented, entitled, interval, numbers

if TYPE_CHECKING:
    from control import StateSpace
else:
    StateSpace = hint("control", "StateSpace")

ROWS = 3  # the Hankel matrix has one block row for this many columns
MOST_ROWS = 200  # more cost time and determine nothing more
REST = 10  # the last tenth of the samples gives the rest position from which the realisation starts
OVERLAP = 1.0  # distance over half-power widths: nearer peaks look like one


@dataclass(frozen=True)
class Resonance:
    """One mode: undamped frequency [Hz], damping ratio, amplitude (p,) by output at time 0, and `damped_Hz`, the
    frequency of the peak."""

    frequency_Hz: float
    damping: float
    amplitude: tuple[float, ...]

    @property
    def damped_Hz(self) -> float:
        """Damped frequency [Hz]: the undamped one times sqrt(1 - damping^2)."""
        return self.frequency_Hz * float(np.sqrt(1 - self.damping**2))


@dataclass(frozen=True, eq=False)
class ImpulseModel:
    """Resonances, slowest first, fitted to all samples after the hit.

    `distance` (modes - 1,) between neighbours, over half the sum of their half-power widths; below 1 they overlap.
    `system` is the discrete-time control.StateSpace whose impulse response is the decay; `rest` (p,) is the rest
    position of the outputs. `criterion` is the Bayesian information criterion by number of modes; the least one is
    selected. `estimate` names "f[0]" [Hz], "zeta[0]", ... in the order of the resonances; `residual` (p,) is the rms;
    `notes` report coloured residuals and overlaps.
    """

    resonances: tuple[Resonance, ...]
    distance: np.ndarray
    system: StateSpace
    rest: np.ndarray
    criterion: dict[int, float]
    estimate: Estimate
    residual: np.ndarray
    fitted: np.ndarray
    notes: tuple[str, ...]
    synthetic: str | None

    def interval(self, name: str, level: float = 0.95) -> tuple[float, float]:
        """Confidence interval of "f[0]" [Hz], "zeta[0]" and so on. Raises ArgumentError for another name."""
        return self.estimate.interval(name, level)


def identify_impulse(
    record: Record,
    *,
    modes: int | None = None,
    largest: int = MOST_MODES,
    interrupted: Callable[[], bool] = lambda: False,
) -> ImpulseModel:
    """Fit the resonances of a record that begins after the hit, when no force acts any more.

    Args:
        modes: number of modes; the Bayesian information criterion selects it if left out, up to `largest`.
        interrupted: called before each number of modes; True ends the fit with FitStopped.

    The eigensystem realisation gives start values. Least squares fits damped sines about a rest position (variable
    projection eliminates the amplitudes). The intervals assume white noise of unknown size at each output. Raises
    ArgumentError for too few samples, inputs that are not zero, and records without vibration.

    >>> record = gt.vibration.hammer_record(
    ...     [7.4], [0.03], [[5e-4]], samples=500, sample_time=0.004, noise=1e-6, seed=1
    ... )
    >>> (mode,) = gt.vibration.identify_impulse(record, modes=1).resonances
    >>> round(mode.frequency_Hz, 2), round(mode.damping, 3)
    (7.4, 0.03)
    """
    if np.any(record.u):
        k = int(np.flatnonzero(np.any(record.u != 0, axis=1))[0])
        raise ArgumentError(f"the input at sample {k} is not zero; cut the record so that it begins after the hit")
    numbers_of_modes = range(1, largest + 1) if modes is None else [modes]
    if min(numbers_of_modes, default=0) < 1:
        raise ArgumentError(f"{modes if modes is not None else largest} resonances requested; expected at least 1")
    fits: dict[int, _Sines] = {}
    decay = record.y - record.y[-max(len(record) // REST, 1) :].mean(axis=0)
    realised = realisations(decay, [2 * k for k in numbers_of_modes])
    for _ in numbers_of_modes:
        go_on(interrupted)
        poles = next(realised)[3]
        s = continuous_poles(poles[np.imag(poles) > 0], record.sample_time)
        s = s[(s.real < 0) & (s.imag > 2 * np.pi / (record.sample_time * len(record)))]
        fit = _Sines.fit(record, s) if len(s) else None
        if fit is not None and (len(s) not in fits or fit.criterion < fits[len(s)].criterion):
            fits[len(s)] = fit
    if not fits or (modes is not None and modes not in fits):
        raise ArgumentError(
            f"{'nothing' if not fits else f'only {min(fits)} of {modes} modes'} in the {len(record)} samples decays "
            "and vibrates at least once; begin just after the hit, record longer, or set fewer modes"
        )
    best = min(fits, key=lambda k: fits[k].criterion) if modes is None else modes
    criterion_at_rest = _at_rest(record)
    if fits[best].criterion >= criterion_at_rest:
        raise ArgumentError(
            f"rest and noise explain the {len(record)} samples as well as {best} resonance{'s' * (best > 1)}: "
            "no vibration is visible; begin just after the hit, or hit harder"
        )
    return fits[best].model(record, {k: f.criterion for k, f in sorted(fits.items())})


def realisations(
    y: np.ndarray, orders: Iterable[int], rows: int | None = None
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]]:
    """A (n, n), C (p, n), x0 (n,) and the poles of y[k] = C A^k x0 by the eigensystem realisation, for each order n.

    y (N, p) or (N,). Source: Juang and Pappa 1985. Raises ArgumentError for too few samples.
    """
    y = columns(y, "outputs")
    p = y.shape[1]
    blocks = min(len(y) // ROWS, MOST_ROWS) if rows is None else rows
    factors = None
    for order in orders:
        if blocks < 2 or (blocks - 1) * p < order or len(y) - blocks + 1 < order:
            raise ArgumentError(
                f"{len(y)} samples are too few for the order {order}; expected at least {ROWS * (order // p + 2)}: "
                "record longer, or lower the order"
            )
        U, s, Vt = factors = factors or np.linalg.svd(block_hankel(y, blocks), full_matrices=False)
        G = U[:, :order] * np.sqrt(s[:order])
        A = np.linalg.lstsq(G[:-p], G[p:], rcond=None)[0]
        yield A, G[:p], np.sqrt(s[:order]) * Vt[:order, 0], np.linalg.eigvals(A)


@dataclass(frozen=True, eq=False)
class _Sines:
    """Fitted damped sines about a rest position."""

    x: np.ndarray
    estimate: Estimate
    amplitudes: np.ndarray  # (1 + 2 modes, p): rest, then cosine and sine by mode
    fitted: np.ndarray
    criterion: float

    @classmethod
    def fit(cls, record: Record, s: np.ndarray) -> _Sines | None:
        """Fit from start poles [1/s]; None if the iteration does not converge or leaves decaying sines.

        The weight of each output is its noise in the previous fit: maximum likelihood for unknown noise sizes.
        """
        weights, live = np.ones(record.y.shape[1]), _live(record.y)
        sines = cls._fit(record, s, weights)
        for _ in range(REWEIGHTED):
            if sines is None:
                return None
            before, weights = weights, weights.copy()
            weights[live] = weights_of(record.y[:, live], sines.fitted[:, live])
            if settled(weights, before):
                return sines
            w, zeta = 2 * np.pi * sines.x[::2], sines.x[1::2]
            sines = cls._fit(record, w * (-zeta + 1j * np.sqrt(1 - zeta**2)), weights)
        return sines

    @classmethod
    def _fit(cls, record: Record, s: np.ndarray, weights: np.ndarray) -> _Sines | None:
        """As `fit`, with the residuals of each output times its weight."""
        s = s[np.argsort(np.abs(s))]
        start = np.column_stack(frequency_and_damping(s)).ravel()
        t, live = record.time, _live(record.y)
        y = (record.y * weights)[:, live]

        def misfit(x: np.ndarray) -> np.ndarray:
            if np.any(x[::2] <= 0) or np.any(np.abs(x[1::2]) >= 1):
                raise ValueError("not decaying sines")
            Q, _ = np.linalg.qr(_columns(t, x))
            return (Q @ (Q.T @ y) - y).T.ravel()

        names = [f"{what}[{k}]" for k in range(len(s)) for what in ("f", "zeta")]
        try:
            with np.errstate(all="ignore"):
                residuals = by_differences(misfit, y.size)
                fit = nonlinear_fit(residuals, start, names, scale=np.tile([0.1, 0.01], len(s)), limit=50)
        except (ValueError, np.linalg.LinAlgError):
            return None
        if fit.estimate is None or np.any(fit.x[1::2] <= 0):
            return None
        F = _columns(t, fit.x)
        amplitudes = np.linalg.lstsq(F, record.y, rcond=None)[0]
        fitted = F @ amplitudes
        # amplitudes take degrees of freedom too
        e = fit.estimate
        unknowns = len(fit.x) + amplitudes[:, live].size
        degrees_of_freedom = max(y.size - unknowns, 1)
        factor = e.degrees_of_freedom / degrees_of_freedom
        noise, units = e.noise * float(np.sqrt(factor)), ("Hz", "") * len(s)
        estimate = replace(
            e, covariance=e.covariance * factor, degrees_of_freedom=degrees_of_freedom, noise=noise, units=units
        )
        criterion = _criterion(record.y[:, live], fitted[:, live], unknowns)
        return cls(fit.x, estimate, amplitudes, fitted, criterion)

    def model(self, record: Record, criterion: dict[int, float]) -> ImpulseModel:
        """The result, slowest mode first."""
        from .._control import control

        order = np.argsort(self.x[::2])
        rows = (2 * order[:, None] + [0, 1]).ravel()
        e = replace(
            self.estimate, values=self.estimate.values[rows], covariance=self.estimate.covariance[rows][:, rows]
        )
        resonances, blocks, B, C = [], [], [], []
        for k in order:
            f, zeta = self.x[2 * k], self.x[2 * k + 1]
            cosine, sine = self.amplitudes[1 + 2 * k], self.amplitudes[2 + 2 * k]
            size = tuple(np.hypot(cosine, sine).tolist())
            resonances.append(Resonance(float(f), float(zeta), size))
            w = 2 * np.pi * f
            decay, turn = np.exp(-zeta * w * record.sample_time), w * np.sqrt(1 - zeta**2) * record.sample_time
            blocks.append(decay * np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]))
            B += [1.0, 0.0]
            C += [cosine, sine]
        C = np.array(C).T
        # h[k] = C A^(k-1) B: the decay begins one sample after the impulse
        A = scipy.linalg.block_diag(*blocks)
        system = control.StateSpace(A, np.array(B)[:, None], C, np.zeros((len(C), 1)), record.sample_time)
        half = np.array([r.frequency_Hz * r.damping for r in resonances])
        distance = (
            np.diff([r.frequency_Hz for r in resonances]) / (half[:-1] + half[1:])
            if len(resonances) > 1
            else np.zeros(0)
        )
        error = self.fitted - record.y
        notes = [f"output {k + 1}: {whiteness(error[:, k]).message}" for k in range(error.shape[1])]
        notes += [
            f"the peaks at {a.frequency_Hz:.4g} and {b.frequency_Hz:.4g} Hz overlap ({d:.2g} half-power widths apart)"
            for a, b, d in zip(resonances, resonances[1:], distance, strict=False)
            if d < OVERLAP
        ]
        nyquist = 0.5 / record.sample_time
        notes += [
            f"a mode at {r.damped_Hz:.4g} Hz is near the Nyquist frequency of {nyquist:.4g} Hz: these samples cannot "
            f"distinguish it from one at {2 * nyquist - r.damped_Hz:.4g} Hz"
            for r in resonances
            if r.damped_Hz > NEAR * nyquist
        ]
        return ImpulseModel(
            tuple(resonances), distance, system, self.amplitudes[0], criterion, e,
            np.sqrt(np.mean(error**2, axis=0)), self.fitted, tuple(notes), record.synthetic,
        )  # fmt: skip


def _at_rest(record: Record) -> float:
    """The criterion of a record without vibration: rest positions and noise."""
    y = record.y[:, _live(record.y)]
    return _criterion(y, y.mean(axis=0), y.shape[1])


def _live(y: np.ndarray) -> np.ndarray:
    """(p,) outputs that move; a constant one has no noise, and its samples add no degrees of freedom."""
    return np.ptp(y, axis=0) > 0


def _criterion(y: np.ndarray, fitted: np.ndarray, count: int) -> float:
    """Bayesian information criterion of `count` unknowns, with another noise size at each output."""
    level = np.finfo(float).eps ** 2 * float(np.sum(y**2))
    rss = np.sum((fitted - y) ** 2, axis=0)
    return float(len(y) * np.sum(np.log((rss + level) / len(y)))) + count * float(np.log(y.size))


def _columns(t: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Rest, then cosine and sine of each mode (N, 1 + 2 modes)."""
    shapes = [np.ones(len(t))]
    for f, zeta in x.reshape(-1, 2):
        w = 2 * np.pi * f
        decay, turn = np.exp(-zeta * w * t), w * np.sqrt(1 - zeta**2) * t
        shapes += [decay * np.cos(turn), decay * np.sin(turn)]
    return np.stack(shapes, axis=1)


WITHIN = 0.01  # largest relative error of a frequency for synthetic hits, unless their noise explains more


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ImpulseStudy(VibrationStudy):
    """Resonances of a decay; `model` is the fit."""

    model: ImpulseModel | None = None

    def _model_rows(self) -> list[Row]:
        m = self.model
        if m is None:
            return []
        rows = []
        for n, r in enumerate(m.resonances):
            rows += [
                Row(f"resonance {n + 1}", f"{r.frequency_Hz:.5g}{interval(m.interval(f'f[{n}]'))}", "Hz"),
                Row("damping", f"{r.damping:.4g}{interval(m.interval(f'zeta[{n}]'), '.4g')}"),
                Row("amplitude by output", numbers(1e6 * np.array(r.amplitude), ".4g"), "um"),
            ]
        if len(m.resonances) > 1:
            rows.append(Row("distance of neighbours", numbers(m.distance, ".3g"), "half-power widths"))
        return [*rows, Row("residual, rms", numbers(1e6 * m.residual, ".4g"), "um")]


def impulse_study(
    record: Record, options: Impulse, truth: Hit | None, title: str, interrupted: Callable[[], bool]
) -> ImpulseStudy:
    """Fit the decay. Raises ArgumentError, FitStopped."""
    m = identify_impulse(record, modes=options.modes, largest=options.largest, interrupted=interrupted)
    frequency, damping = [r.frequency_Hz for r in m.resonances], [r.damping for r in m.resonances]
    text = tomli_w.dumps({"frequency_Hz": frequency, "damping": damping})
    return ImpulseStudy(
        status=SolveStatus.SOLVED,
        message=f"{len(m.resonances)} resonance{'s'[: len(m.resonances) != 1]} in {len(record)} samples",
        title=title,
        checks={} if truth is None else _checks(m, truth),
        figures={"impulse": partial(_figure, record, m, entitled(title or "decay", m.synthetic))},
        files={"parameters.toml": commented(text, m.synthetic)},
        machine_files=("parameters.toml",),
        model=m,
        notes=m.notes,
        estimate=m.estimate,
        frequency=frequency,
        frequency_interval=[list(m.interval(f"f[{n}]")) for n in range(len(frequency))],
        damping=damping,
        damping_interval=[list(m.interval(f"zeta[{n}]")) for n in range(len(damping))],
        distance=m.distance,
        residual=m.residual,
        order=2 * len(m.resonances),
        stable=True,
        synthetic=m.synthetic,
    )


def _checks(m: ImpulseModel, hit: Hit) -> dict[str, Check]:
    true = np.sort(hit.frequency)
    fitted = np.array([r.frequency_Hz for r in m.resonances])
    if len(fitted) != len(true):
        bound = at_least if len(fitted) < len(true) else at_most
        return {"modes_found": bound(len(fitted), len(true))}
    errors = np.abs(fitted / true - 1)
    bounds = np.maximum(WITHIN, by_chance(m.estimate, [f"f[{n}]" for n in range(len(true))]) / true)
    worst = int(np.argmax(errors / bounds))
    return {"frequency_error": at_most(float(errors[worst]), float(bounds[worst]))}


def _figure(record: Record, m: ImpulseModel, title: str) -> Any:
    from ..plot.vibration import decay_figure

    return decay_figure(record.time, record.y, m.fitted, m.rest, [r.damped_Hz for r in m.resonances], title=title)
