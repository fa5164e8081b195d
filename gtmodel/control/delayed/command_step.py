"""Equivalent mass, damping and stiffness from the vibration after one command, as measured in the thesis."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from ...inference import noise_size, nonlinear_fit, whiteness
from ...results import ArgumentError, Estimate

NAMES, UNITS = ("m", "c", "k"), ("1", "1/s", "1/s2")
RATIOS = (0.02, 0.05, 0.1, 0.25)  # damping ratios of the starts
FEWEST = 8  # rows
FINE = 4  # start frequencies per step of the spectrum
SLOW = 10.0  # cycles between rows at most: slower sampling misses the vibration after a command of one cycle
LEFT_OUT = 1e-4  # p-value below which residuals are not white noise; one good log in ten thousand has a note
UNEXPLAINED = 0.05  # largest unexplained share of the squares if residuals are not white noise
SIGMAS = 4.0  # the mean of white residuals is within this many standard deviations of zero
ROUNDING, TINY = 1e-20, 1e-300  # share of the squares left by rounding
TURNED = 0.5  # the sign is wrong if reversing it leaves less than this share of the residual squares


def command_response(m: float, c: float, k: float, time: ArrayLike, *, size: float, cycle: float) -> np.ndarray:
    """Return the vibration y (n,) [m] at times (n,) [s] after one command of `size` [m] that acts over one cycle [s].

    m y'' + c y' + k y = size / cycle^2 during the cycle and 0 after it, from rest (Cvitanic 2021, section 5.3.4); y is
    zero before. Units as in `equivalent_plant`. Raises ArgumentError if m or k is not positive or the plant is not
    underdamped.

    >>> y = gt.control.delayed.command_response(3.0, 57.7, 34200.0, [0.004, 0.05], size=1e-3, cycle=0.004)
    >>> (1e6 * y).round(1)  # [um]
    array([ 160. , -453.4])
    """
    t = _checked(time, size, cycle)
    if not (m > 0 and k > 0 and 0 <= c < 2 * np.sqrt(m * k)):
        raise ArgumentError(f"expected an underdamped oscillator; found m {m:g}, c {c:g}, k {k:g}", "m")
    return _vibration(np.array([m, c, k], float), t, size, cycle)[0]


def fit_command_step(
    time: ArrayLike, displacement: ArrayLike, *, size: float, cycle: float, sigma: float | None = None
) -> Estimate:
    """Fit m, c and k, with intervals, to the vibration after one command.

    Args:
        time: (n,) [s], from the instant at which the command acts, that is after the delay.
        displacement: (n,) [m], minus the motion of the arm by the command itself.
        size: of the command [m]; cycle [s]: how long it acts.
        sigma: standard deviation of the measurement [m]; by default estimated from the residuals.

    Takes the best of least-squares fits from several starts, with exact derivatives. If the residuals are not white
    noise (an offset, a delay, saturation, a second mode), the estimate's `notes` say so, and its intervals are too
    narrow. Raises ArgumentError if shapes do not fit, if there are too few rows, if no oscillation fits, or if the
    residuals are not white noise and exceed 5 % of the squares: a wrong sign, a remaining delay, an arm that moved, a
    command of another cycle.

    >>> t = 0.004 * np.arange(1, 150)
    >>> y = gt.control.delayed.command_response(3.0, 57.7, 34200.0, t, size=1e-3, cycle=0.004)
    >>> y = y + 15e-6 * np.random.default_rng(1).standard_normal(len(t))  # synthetic
    >>> fit = gt.control.delayed.fit_command_step(t, y, size=1e-3, cycle=0.004, sigma=15e-6)
    >>> [bool(low < truth < high) for truth, low, high in zip([3.0, 57.7, 34200.0], *fit.intervals())]
    [True, True, True]
    """
    t, y = _checked(time, size, cycle), np.asarray(displacement, float).reshape(-1)
    if t.shape != y.shape or not np.all(np.isfinite(y)):
        raise ArgumentError(
            f"expected {len(t)} finite rows; found {len(y)} rows, {np.sum(~np.isfinite(y))} not finite", "displacement"
        )
    if len(t) < FEWEST or np.ptp(t) < 2 * cycle:
        raise ArgumentError(f"expected {FEWEST} rows and two cycles; found {len(t)} rows in {np.ptp(t):g} s", "time")

    step = float(np.median(np.diff(np.unique(t))))
    if step > SLOW * cycle:
        raise ArgumentError(f"rows are {step:g} s apart, the command lasts {cycle:g} s; is time in seconds?", "time")
    estimate = _best(t, y, size, cycle, sigma)
    if estimate is None:
        raise ArgumentError("no damped oscillation after a command fits these rows; is time counted from the command?",
                            "displacement")  # fmt: skip
    rest = estimate.residuals[np.argsort(t, kind="stable")]
    unit = 1.0 if sigma is None else sigma
    squares, whole = float(rest @ rest) * unit**2, float(y @ y)
    white, offset = whiteness(rest), abs(float(np.mean(rest))) * np.sqrt(len(rest)) / max(float(np.std(rest)), TINY)
    notes = [] if white.p > LEFT_OUT else [white.message]
    notes += [f"the mean of the residuals is {np.mean(rest) * unit:.3g} m, not zero"] if offset > SIGMAS else []
    if squares < ROUNDING * whole or not notes:
        size_of = noise_size(estimate) if sigma is not None else None
        large = size_of is not None and estimate.noise > 1 and size_of.p < LEFT_OUT
        return replace(estimate, notes=(*estimate.notes, size_of.message)) if large and size_of else estimate
    if squares > UNEXPLAINED * whole:
        flipped = _best(t, -y, size, cycle, sigma)
        better = flipped is not None and float(flipped.residuals @ flipped.residuals) * unit**2 < TURNED * squares
        cause = "the reversed sign fits better: check the signs of command and displacement" if better else (
            "check that time counts from the instant at which the command acts, and that the motion by the command "
            "itself is subtracted"
        )  # fmt: skip
        raise ArgumentError(
            f"a damped oscillation after a command explains only {100 * max(0.0, 1 - squares / whole):.0f} % of these "
            f"rows, and the rest is not white noise; {cause}",
            "displacement",
        )
    notes[-1] += ": look for an offset, a delay, saturation or a second mode"
    return replace(estimate, notes=(*estimate.notes, *notes))


def _best(t: np.ndarray, y: np.ndarray, size: float, cycle: float, sigma: float | None) -> Estimate | None:
    """The best fit from all starts; None if no fit is an underdamped oscillator."""

    def residuals(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        m, c, k = x
        if not (m > 0 and k > 0 and c * c < 4 * m * k):
            return np.full(len(t), np.inf), np.full((len(t), 3), np.nan)
        modelled, jacobian = _vibration(x, t, size, cycle)
        return modelled - y, jacobian

    best = None
    for start in _starts(t, y, size, cycle):
        fit = nonlinear_fit(residuals, start, NAMES, scale=start, sigma=sigma, units=UNITS)
        if fit.estimate is not None and np.isfinite(fit.cost) and (best is None or fit.cost < best.cost):
            best = fit
    return best.estimate if best is not None and np.all(best.x > 0) else None


def _checked(time: ArrayLike, size: float, cycle: float) -> np.ndarray:
    t = np.asarray(time, float).reshape(-1)
    if not np.all(np.isfinite(t)):
        raise ArgumentError("must hold finite numbers only", "time")
    if not (np.isfinite(size) and size != 0):
        raise ArgumentError(f"must be a number other than 0; found {size!r}", "size")
    if not (np.isfinite(cycle) and cycle > 0):
        raise ArgumentError(f"must be a number above 0; found {cycle!r}", "cycle")
    return t


def _starts(t: np.ndarray, y: np.ndarray, size: float, cycle: float) -> list[np.ndarray]:
    """m, c, k for each damping ratio: the best-fitting frequency, and the mass from the amplitude."""
    span, step = float(np.ptp(t)), float(np.median(np.diff(np.unique(t))))
    w = 2 * np.pi * np.arange(FINE // 2, max(FINE, FINE * span / (2 * step))) / (FINE * span)
    starts = []
    for zeta in RATIOS:
        x = np.stack([np.ones_like(w), 2 * zeta * w, w**2], axis=1)
        shapes = _vibration(x, t, size, cycle)[0]
        inverse = shapes @ y / np.maximum(np.sum(shapes**2, axis=1), 1e-300)  # 1 / m by least squares
        cost = np.where(inverse > 0, np.sum((y - inverse[:, None] * shapes) ** 2, axis=1), np.inf)
        best = int(np.argmin(cost))
        if np.isfinite(cost[best]):
            starts.append(x[best] / inverse[best])
    return starts


def _vibration(x: np.ndarray, t: np.ndarray, size: float, cycle: float) -> tuple[np.ndarray, np.ndarray]:
    """y (..., n) for m, c, k (..., 3) at times (n,), and its derivatives with respect to m, c, k (..., n, 3)."""
    m, c, k = (x[..., i, None] for i in range(3))
    sigma = c / (2 * m)
    w = np.sqrt(k / m - sigma**2)
    d_sigma = [-sigma / m, 1 / (2 * m), 0 * k]
    d_w = [(2 * sigma**2 / m - k / m**2) / (2 * w), -sigma / (2 * m * w), 1 / (2 * m * w)]

    def step(s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Response to a unit step of force, and its derivatives."""
        s = np.maximum(s, 0.0)
        fade, sin, cos = np.exp(-sigma * s), np.sin(w * s), np.cos(w * s)
        y = (1 - fade * (cos + sigma / w * sin)) / k
        by_sigma = fade * (s * (cos + sigma / w * sin) - sin / w) / k
        by_w = fade * (s * sin - sigma * (s * cos / w - sin / w**2)) / k
        derivatives = [by_sigma * a + by_w * b for a, b in zip(d_sigma, d_w, strict=True)]
        derivatives[2] = derivatives[2] - y / k
        return y, np.stack(derivatives, axis=-1)

    (y0, d0), (y1, d1) = step(t), step(t - cycle)
    return size / cycle**2 * (y0 - y1), size / cycle**2 * (d0 - d1)
