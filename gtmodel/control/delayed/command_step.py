"""Equivalent mass, damping and stiffness from the vibration after one command, as the thesis measured them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from ...inference import noise_size, nonlinear_fit, whiteness
from ...results import ArgumentError, Estimate

NAMES, UNITS = ("m", "c", "k"), ("1", "1/s", "1/s2")
RATIOS = (0.02, 0.05, 0.1, 0.25)  # damping ratios of the starts
FEWEST = 8  # rows
FINE = 4  # to a step of the spectrum: frequencies that are tried as starts
SLOW = 10.0  # cycles between rows at most: what lies further apart shows no vibration that a command of a cycle excites
LEFT_OUT = 1e-4  # p-value below which residuals are no noise; one good log in ten thousand has a note
UNEXPLAINED = 0.05  # share of the squares that may be left where residuals are no noise
SIGMAS = 4.0  # standard deviations of a mean, likewise
ROUNDING, TINY = 1e-20, 1e-300  # share of the squares that rounding leaves
TURNED = 0.5  # of the squares that are left: with the sign turned less than this part is left


def command_response(m: float, c: float, k: float, time: ArrayLike, *, size: float, cycle: float) -> np.ndarray:
    """Vibration y (n,) [m] at times (n,) [s] after one command of `size` [m], which acts over one cycle [s].

    m y'' + c y' + k y = size / cycle^2 from 0 to the cycle, from rest (Cvitanic 2021, section 5.3.4); zero before.
    Units as in `equivalent_plant`. Raises ArgumentError for what is not positive or not an oscillation.

    >>> y = gt.control.delayed.command_response(3.0, 57.7, 34200.0, [0.004, 0.05], size=1e-3, cycle=0.004)
    >>> (1e6 * y).round(1)  # [um]
    array([ 160. , -453.4])
    """
    t = _checked(time, size, cycle)
    if not (m > 0 and k > 0 and 0 <= c < 2 * np.sqrt(m * k)):
        raise ArgumentError(f"m {m:g}, c {c:g} and k {k:g} are no oscillator that swings", "m")
    return _vibration(np.array([m, c, k], float), t, size, cycle)[0]


def fit_command_step(
    time: ArrayLike, displacement: ArrayLike, *, size: float, cycle: float, sigma: float | None = None
) -> Estimate:
    """m, c and k with intervals from the vibration after one command.

    Args:
        time: (n,) [s], from the instant at which the command acts, so after the delay.
        displacement: (n,) [m], less what the command itself moved the arm.
        size: of the command [m]; cycle [s]: over which it acts.
        sigma: standard deviation of the measurement [m]; from the residuals if left out.

    Least squares with exact derivatives from several starts, the best of which counts. `notes` of the estimate say
    where what is left is no noise (an offset, a delay, saturation, a second mode): the intervals are too narrow then.
    Raises ArgumentError for rows that do not fit or are too few, and where no oscillation fits or more than 5 % of the
    squares are left and no noise: a wrong sign, a delay that is left in, an arm that moved, a command of another cycle.

    >>> t = 0.004 * np.arange(1, 150)
    >>> y = gt.control.delayed.command_response(3.0, 57.7, 34200.0, t, size=1e-3, cycle=0.004)
    >>> y = y + 15e-6 * np.random.default_rng(1).standard_normal(len(t))  # synthetic
    >>> fit = gt.control.delayed.fit_command_step(t, y, size=1e-3, cycle=0.004, sigma=15e-6)
    >>> [bool(low < truth < high) for truth, low, high in zip([3.0, 57.7, 34200.0], *fit.intervals())]
    [True, True, True]
    """
    t, y = _checked(time, size, cycle), np.asarray(displacement, float).reshape(-1)
    if t.shape != y.shape or not np.all(np.isfinite(y)):
        raise ArgumentError(f"{len(y)} rows, {np.sum(~np.isfinite(y))} of them not finite, for {len(t)} times",
                            "displacement")  # fmt: skip
    if len(t) < FEWEST or np.ptp(t) < 2 * cycle:
        raise ArgumentError(f"{len(t)} rows over {np.ptp(t):g} s are too few; expected {FEWEST} and two cycles", "time")

    step = float(np.median(np.diff(np.unique(t))))
    if step > SLOW * cycle:
        raise ArgumentError(f"rows are {step:g} s apart, a command lasts {cycle:g} s; is time in seconds?", "time")
    estimate = _best(t, y, size, cycle, sigma)
    if estimate is None:
        raise ArgumentError("no damped oscillation after a command fits these rows; is time counted from the command?",
                            "displacement")  # fmt: skip
    left = estimate.residuals[np.argsort(t, kind="stable")]
    unit = 1.0 if sigma is None else sigma
    squares, whole = float(left @ left) * unit**2, float(y @ y)
    white, offset = whiteness(left), abs(float(np.mean(left))) * np.sqrt(len(left)) / max(float(np.std(left)), TINY)
    said = [] if white.p > LEFT_OUT else [white.message]
    said += [f"residuals are {np.mean(left) * unit:.3g} m in the mean, no noise"] if offset > SIGMAS else []
    if squares < ROUNDING * whole or not said:
        size_of = noise_size(estimate) if sigma is not None else None
        large = size_of is not None and estimate.noise > 1 and size_of.p < LEFT_OUT
        return replace(estimate, notes=(*estimate.notes, size_of.message)) if large and size_of else estimate
    if squares > UNEXPLAINED * whole:
        turned = _best(t, -y, size, cycle, sigma)
        better = turned is not None and float(turned.residuals @ turned.residuals) * unit**2 < TURNED * squares
        cause = "with the sign turned they do: check the signs of command and displacement" if better else (
            "is time counted from the instant at which the command acts, and what the command itself moved taken off?"
        )  # fmt: skip
        raise ArgumentError(
            f"a damped oscillation after a command explains {100 * max(0.0, 1 - squares / whole):.0f} % of these rows "
            f"alone, and the rest is no noise; {cause}",
            "displacement",
        )
    said[-1] += ": look for an offset, a delay, saturation or a second mode"
    return replace(estimate, notes=(*estimate.notes, *said))


def _best(t: np.ndarray, y: np.ndarray, size: float, cycle: float, sigma: float | None) -> Estimate | None:
    """The fit of least cost from all starts; None where none ends at an oscillator."""

    def residuals(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        m, c, k = x
        if not (m > 0 and k > 0 and c * c < 4 * m * k):
            return np.full(len(t), np.inf), np.full((len(t), 3), np.nan)
        modelled, slopes = _vibration(x, t, size, cycle)
        return modelled - y, slopes

    best = None
    for start in _starts(t, y, size, cycle):
        fit = nonlinear_fit(residuals, start, NAMES, scale=start, sigma=sigma, units=UNITS)
        if fit.estimate is not None and np.isfinite(fit.cost) and (best is None or fit.cost < best.cost):
            best = fit
    return best.estimate if best is not None and np.all(best.x > 0) else None


def _checked(time: ArrayLike, size: float, cycle: float) -> np.ndarray:
    t = np.asarray(time, float).reshape(-1)
    if not np.all(np.isfinite(t)):
        raise ArgumentError("holds a number that is not finite", "time")
    if not (np.isfinite(size) and size != 0):
        raise ArgumentError(f"must be a number other than 0; found {size!r}", "size")
    if not (np.isfinite(cycle) and cycle > 0):
        raise ArgumentError(f"must be a number above 0; found {cycle!r}", "cycle")
    return t


def _starts(t: np.ndarray, y: np.ndarray, size: float, cycle: float) -> list[np.ndarray]:
    """m, c, k for each damping ratio: the frequency whose response fits best, and the mass from its size."""
    span, step = float(np.ptp(t)), float(np.median(np.diff(np.unique(t))))
    w = 2 * np.pi * np.arange(FINE // 2, max(FINE, FINE * span / (2 * step))) / (FINE * span)
    starts = []
    for zeta in RATIOS:
        x = np.stack([np.ones_like(w), 2 * zeta * w, w**2], axis=1)
        shapes = _vibration(x, t, size, cycle)[0]
        over = shapes @ y / np.maximum(np.sum(shapes**2, axis=1), 1e-300)  # 1 / m by least squares
        left = np.where(over > 0, np.sum((y - over[:, None] * shapes) ** 2, axis=1), np.inf)
        at = int(np.argmin(left))
        if np.isfinite(left[at]):
            starts.append(x[at] / over[at])
    return starts


def _vibration(x: np.ndarray, t: np.ndarray, size: float, cycle: float) -> tuple[np.ndarray, np.ndarray]:
    """y (..., n) of m, c, k (..., 3) at times (n,), and its derivatives by them (..., n, 3)."""
    m, c, k = (x[..., i, None] for i in range(3))
    sigma = c / (2 * m)
    w = np.sqrt(k / m - sigma**2)
    turned = [-sigma / m, 1 / (2 * m), 0 * k]
    bent = [(2 * sigma**2 / m - k / m**2) / (2 * w), -sigma / (2 * m * w), 1 / (2 * m * w)]

    def step(s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """After a force of one, and its derivatives."""
        s = np.maximum(s, 0.0)
        fade, sin, cos = np.exp(-sigma * s), np.sin(w * s), np.cos(w * s)
        y = (1 - fade * (cos + sigma / w * sin)) / k
        by_sigma = fade * (s * (cos + sigma / w * sin) - sin / w) / k
        by_w = fade * (s * sin - sigma * (s * cos / w - sin / w**2)) / k
        slopes = [by_sigma * a + by_w * b for a, b in zip(turned, bent, strict=True)]
        slopes[2] = slopes[2] - y / k
        return y, np.stack(slopes, axis=-1)

    (y0, d0), (y1, d1) = step(t), step(t - cycle)
    return size / cycle**2 * (y0 - y1), size / cycle**2 * (d0 - d1)
