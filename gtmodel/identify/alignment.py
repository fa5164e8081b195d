"""Delays, scales and offsets of the signals, estimated together with the parameters of the fit and counted in their
intervals."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..lang import ModelError
from ..measurements import ESTIMATE, Corrections, Session
from ..results import TrajectoryError
from ..results.suspicion import EVERY
from .options import Processing
from .regressor import Regressor, among
from .rows import Rows, cutoff_of, rows_of, with_offsets

Array = np.ndarray

MOST_STEPS = 20  # of Gauss-Newton; two to five are usual
SMALL = 0.02  # of the standard deviation of a correction: a step that does not matter
SAME = 1e-4  # of a sample, a scale or the deviation of a signal: likewise
SLOW, COARSE = 0.3, 0.05  # of the step before, and of a sample: if a step is longer, the Jacobian is computed again
STALLED, GAIN = 2, 1e-3  # steps without such a gain in the sum of the logarithms of the residuals' deviations
SCALE_STEP = 0.01  # difference of a scale or, relative to the deviation of its signal, of an offset
NARROWEST = 0.2  # samples: differences over less show no step of friction
RANK = 1e-8


def _undisturbed(share: float) -> bool:
    return False


@dataclass(frozen=True, eq=False)
class CorrectionModel:
    """Signals of some recordings with free corrections, and how the rows of a regressor depend on these.

    The efforts keep their samples; the position and the other inputs move instead. Noise and the steps of Coulomb
    friction are not band limited: interpolation between the samples would round them and bias the friction.
    """

    corrections: Corrections
    regressor: Regressor
    processing: Processing
    known: str
    targets: str

    def sessions(self, values: Array | Sequence[float] = ()) -> tuple[Session, ...]:
        """The corrected recordings."""
        return self.corrections.apply(values, still=self.targets)

    def rows(self, values: Array, how: Processing) -> Rows:
        """All rows at these values, near standstill too: their number must not depend on the corrections."""
        steady = replace(how, position_step=0.0, mask_steps=0.0)
        # the fit itself checks the log
        return rows_of(self.sessions(values), self.regressor, steady, self.known, self.targets, accept=EVERY)

    def columns(self, values: Array, parameters: Array, how: Processing, width: float = 1.0) -> Array:
        """Derivatives (n, m, corrections) of all modelled minus measured efforts by the corrections.

        Differences over `width` samples either side, one by default: the step of Coulomb friction moves from sample to
        sample, which smaller ones would miss.
        """
        corrections, columns = self.corrections, []
        for k, (free, size) in enumerate(zip(corrections.free, corrections.sizes(), strict=True)):
            h = np.zeros(len(values))
            h[k] = width * (size if free.what == "delay" else SCALE_STEP * size)
            ends = [_modelled_minus_measured(self.rows(values + s * h, how), parameters) for s in (1, -1)]
            columns.append((ends[0] - ends[1]) / (2 * h[k]))
        return np.stack(columns, axis=2)

    def estimate(
        self, free: Sequence[str], offsets: bool = False, progress: Callable[[float], bool] = _undisturbed
    ) -> Array:
        """Estimate the corrections together with the parameters `free` by Gauss-Newton steps.

        The Jacobian is computed anew only if the steps do not shrink. `progress` takes the share done and returns
        whether to stop.
        """
        corrections = self.corrections
        x = corrections.start.copy()
        cutoff = self.processing.cutoff
        if cutoff is None:
            cutoff = cutoff_of(self.sessions(x), self.known)
        how = replace(self.processing, cutoff=cutoff)
        most, sizes = corrections.bounds()[1], corrections.sizes()
        columns, before, fitted = None, np.inf, among(self.regressor.names, free)
        best, best_x, stalled, width = np.inf, x, 0, 1.0
        for n in range(MOST_STEPS):
            if progress(n / (n + 3.0)):
                break
            rows = self.rows(x, how)
            fit = _Linear(rows, fitted, self.targets, offsets)
            stalled = 0 if fit.misfit < best - GAIN else stalled + 1
            if fit.misfit < best:
                best, best_x = fit.misfit, x
            if stalled == STALLED:  # the step of friction moves from sample to sample, so that the misfit is not smooth
                if width < NARROWEST:
                    break
                x, stalled, width, columns = best_x, 0, width / 4, None
                rows = self.rows(x, how)
                fit = _Linear(rows, fitted, self.targets, offsets)
            if columns is None:
                columns = self.columns(x, fit.parameters, how, width)
            step, std = fit.with_columns(columns)
            coarse = float(np.max(np.abs(step) / sizes))
            if coarse > COARSE and coarse > SLOW * before:  # too curved for the Jacobian of another point
                columns = self.columns(x, fit.parameters, how, width)
                step, std = fit.with_columns(columns)
                coarse = float(np.max(np.abs(step) / sizes))
            if np.all(np.abs(step) < np.maximum(SMALL * std, SAME * sizes)):
                break
            x, before = np.clip(x + step, -most, most), coarse
        x = best_x
        corrections.refuse_bounds(x)
        return x

    def with_columns(self, rows: Rows, values: Array, parameters: Array) -> Rows:
        """The rows with the corrections as further parameters, linear about these values.

        rows: of `sessions(values)`. parameters: of the regressor. A fit to the result has intervals that allow for the
        uncertain corrections.
        """
        how = replace(self.processing, cutoff=rows.cutoff_Hz, every=rows.every)
        everything = self.rows(values, how)
        columns = self.columns(values, parameters, how)[_places(rows, everything)]
        names = tuple(free.name for free in self.corrections.free)
        session = self.sessions(values)[0].trajectory
        units = {"delay": lambda _: "s", "scale": lambda _: "1", "offset": session.unit}
        return replace(
            rows,
            names=(*rows.names, *names),
            nominal=np.concatenate([rows.nominal, values]),
            units=(*rows.units, *(units[free.what](free.signal) for free in self.corrections.free)),
            Y=np.concatenate([rows.Y, columns], axis=2),
            y0=rows.y0 - columns @ values,
            signed=(*rows.signed, *names),
        )


class _Linear:
    """Least squares of the free parameters at some corrections, each target weighted by its noise."""

    def __init__(self, rows: Rows, fitted: Sequence[int], targets: str, offsets: bool) -> None:
        more = with_offsets(rows, targets, drift=True) if offsets else rows
        p = len(rows.names)
        fixed = [k for k in range(p) if k not in fitted]
        self._A = more.Y[:, :, [*fitted, *range(p, len(more.names))]]
        self._b = rows.effort - rows.y0 - rows.Y[:, :, fixed] @ rows.nominal[fixed]
        self._size = np.ones(rows.effort.shape[1])
        for _ in range(2):
            residuals = self._b - self._A @ self._solve(self._A)[0]
            self._size = np.maximum(np.sqrt(np.mean(residuals**2, axis=0)), np.finfo(float).tiny)
        self.misfit = float(np.sum(np.log(self._size)))
        self.parameters = rows.nominal.copy()
        self.parameters[list(fitted)] = self._solve(self._A)[0][: len(fitted)]

    def with_columns(self, columns: Array) -> tuple[Array, Array]:
        """Step of the corrections with these derivatives (n, m, corrections), and its standard deviations."""
        J = np.concatenate([self._A, columns], axis=2)
        x, inverse = self._solve(J)
        n, k = J.shape[2], columns.shape[2]
        residuals = (self._b - J @ x) / self._size
        noise = float(np.sum(residuals**2)) / max(1, residuals.size - n)
        return x[-k:], np.sqrt(noise * np.diag(inverse)[-k:])

    def _solve(self, J: Array) -> tuple[Array, Array]:
        """Solution, of least norm if it is not determined, and the inverse of the information."""
        A = (J / self._size[:, None]).reshape(-1, J.shape[2])
        scale = np.linalg.norm(A, axis=0)
        scale = np.where(scale > 0, scale, 1.0)
        U, s, V = np.linalg.svd(A / scale, full_matrices=False)
        inverse = np.where(s > RANK * s[0], 1 / np.where(s > 0, s, 1.0), 0.0)
        x = V.T @ (inverse * (U.T @ (self._b / self._size).reshape(-1)))
        return x / scale, (V.T * inverse**2) @ V / np.outer(scale, scale)


def _modelled_minus_measured(rows: Rows, parameters: Array) -> Array:
    return rows.Y @ parameters + rows.y0 - rows.effort


def _places(rows: Rows, everything: Rows) -> Array:
    """Positions of rows among those of the same recordings without a selection."""
    places, ends = [], [*everything.starts, len(everything)]
    for k in range(len(rows.starts)):
        times = everything.time[ends[k] : ends[k + 1]]
        places.append(ends[k] + np.searchsorted(times, rows.part(k).time - 0.5 * rows.interval))
    chosen = np.concatenate(places)
    if not np.allclose(everything.time[chosen], rows.time, rtol=0.0, atol=1e-3 * rows.interval):
        raise TrajectoryError("the rows belong to other recordings; use those of the corrected sessions")
    return chosen


def corrected(
    corrections: Corrections,
    regressor: Regressor,
    processing: Processing,
    free: Sequence[str],
    known: str = "q",
    targets: str = "tau",
    offsets: bool = False,
    progress: Callable[[float], bool] = _undisturbed,
) -> tuple[tuple[Session, ...], dict[str, float]]:
    """Estimate the free corrections of the signals; return the corrected sessions and the estimates by name [SI].

    Args:
        corrections: the signals of raw sessions, with the delays, scales and offsets to estimate.
        regressor, processing, known, targets: as for `rows_of`.
        free: parameters of the regressor that are fitted at the same time.
        offsets: whether the fit also has a free offset of the efforts for each session, see `with_offsets`.
        progress: takes the share done and returns whether to stop.

    The corrections minimise the weighted residual of the least-squares fit of all parameters. A delay is positive if
    the column is late [s]. The efforts keep their samples and their times; the other signals move. Raises ModelError if
    the scale of the efforts is free: it cannot be distinguished from the masses.

    >>> class Axis(gt.Model):  # a cart with viscous and Coulomb friction
    ...     m, d, c = gt.parameter(2.0, unit="kg"), gt.parameter(5.0, unit="kg/s"), gt.parameter(3.0, unit="N")
    ...     q, tau = gt.variable(unit="m"), gt.variable(unit="N")
    ...     def equations(self):
    ...         v = gt.der(self.q)
    ...         yield self.tau == self.m * gt.der(v) + self.d * v + self.c * gt.sign(v)
    >>> time = 0.004 * np.arange(2000)
    >>> q = gt.identify.multisine(time, np.zeros(1), np.array([0.2]), np.array([0.5, 1.1]), seed=1)[:, 0]
    >>> truth = gt.identify.LogSimulator(Axis(), q).truth
    >>> late = np.interp(time - 0.006, time, truth["tau"])  # the efforts come 6 ms late
    >>> log = gt.Trajectory(time, {"q": q, "tau": late}, {"q": "m", "tau": "N"})
    >>> Signal = gt.measurements.Signal
    >>> signals = {"q": Signal("q", "m"), "tau": Signal("tau", "N", delay="estimate")}
    >>> raw = gt.measurements.Corrections(signals, [gt.measurements.session_of(log)])
    >>> regressor = gt.identify.Regressor(Axis(), ["m", "d", "c"])
    >>> how = gt.identify.Processing(cutoff=8.0)
    >>> _, values = gt.identify.corrected(raw, regressor, how, ["m", "d", "c"])
    >>> {name: round(value, 3) for name, value in values.items()}
    {'tau.delay': 0.006}
    """
    alignment, values = aligned(corrections, regressor, processing, free, known, targets, offsets, progress)
    return alignment.sessions(values), corrections.named(values)


def aligned(
    corrections: Corrections,
    regressor: Regressor,
    processing: Processing,
    free: Sequence[str],
    known: str,
    targets: str,
    offsets: bool,
    progress: Callable[[float], bool] = _undisturbed,
) -> tuple[CorrectionModel, Array]:
    """The alignment with the estimated corrections; arguments and errors as of `corrected`."""
    if corrections.signals[targets].scale == ESTIMATE:
        raise ModelError(
            "the scale of the efforts cannot be distinguished from masses and friction; give it a number, or let "
            "gt.identify.study estimate it with a known payload"
        )
    alignment = CorrectionModel(corrections, regressor, processing, known, targets)
    return alignment, alignment.estimate(free, offsets, progress) if corrections.free else np.zeros(0)
