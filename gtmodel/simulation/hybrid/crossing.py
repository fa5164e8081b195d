"""The first instant in an interval at which a comparison changes its truth."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

# a correction of so many parts of the interval, or of the time, no longer moves the instant
CLOSE = 1e-13
MOST = 60
# from a root of values that are nearly right
CORRECTIONS = 4
# halvings of an interval until it is seen on which side it begins
HALVINGS = 40
# of a comparison's distance from zero: what its rates at two ends leave of its change between them
EXPLAINED = 0.3

# values and rates of the comparisons, signed so that they are positive on the side where they were, at a time after the
# interval's beginning; None where the integrator gives up
Signed = Callable[[float], tuple[np.ndarray, np.ndarray] | None]


def dips(h: np.ndarray, s: np.ndarray, ds: np.ndarray, least: np.ndarray) -> np.ndarray:
    """For intervals of length h (n,), the share at which the cubic through signed values s (n + 1, m) with rates ds has
    its minimum where that lies more than the round-off `least` (m,) or (n, m) below 0; NaN elsewhere."""
    a, b, da, db = s[:-1], s[1:], ds[:-1] * h[:, None], ds[1:] * h[:, None]
    # derivative of the cubic: c0 + c1 u + c2 u^2
    c0, c1, c2 = da, 6 * (b - a) - 4 * da - 2 * db, 6 * (a - b) + 3 * (da + db)
    with np.errstate(all="ignore"):
        root = np.sqrt(c1**2 - 4 * c0 * c2)
        u = np.where(np.abs(c2) > 1e-12 * np.abs(c1), (-c1 + root) / (2 * c2), -c0 / c1)
        lowest = (1 + 2 * u) * (1 - u) ** 2 * a + u * (1 - u) ** 2 * da + u**2 * (3 - 2 * u) * b + u**2 * (u - 1) * db
        inside = (u > 0) & (u < 1) & (lowest < -least) & (a >= 0) & (b >= 0)
    return np.where(inside, u, np.nan)


def unexplained(h: np.ndarray, s: np.ndarray, ds: np.ndarray, zero: np.ndarray) -> np.ndarray:
    """Whether values s (n + 1, m) with rates ds at the ends of intervals of length h (n,) leave open what a comparison
    does inside: its rates do not give its change, to a part of its distance from zero. For each interval."""
    change = s[1:] - s[:-1]
    larger = np.maximum(np.maximum(np.abs(s[:-1]), np.abs(s[1:])), zero)
    with np.errstate(all="ignore"):
        return np.any(np.abs(change - h[:, None] * (ds[:-1] + ds[1:]) / 2) > EXPLAINED * larger, axis=1)


def first_root(signed: Signed, n: int, low: float, high: float) -> float | None:
    """Where comparison n, negative at `high`, becomes negative first after `low`; None where numbers do not come out.

    At `low` it is positive, or zero and about to become positive.
    """
    if high <= low:
        return low
    ends = {end: signed(end) for end in (low, high)}
    if any(end is None for end in ends.values()):
        return None
    (a, da), (b, db) = ((float(e[0][n]), float(e[1][n])) for e in ends.values() if e is not None)
    if not a > 0:
        probe = high
        for _ in range(HALVINGS):
            probe = low + (probe - low) / 2
            at = signed(probe)
            if at is None:
                return None
            if at[0][n] > 0:
                low, a, da = probe, float(at[0][n]), float(at[1][n])
                break
            high, b, db = probe, float(at[0][n]), float(at[1][n])
        else:
            return low
    span = high - low
    for k in range(MOST):
        if high - low <= CLOSE * max(abs(high), span) or b == 0:
            break
        guess = _cubic_root(low, a, da, high, b, db) if k % 4 < 3 else (low + high) / 2
        at = signed(guess)
        if at is None:
            return None
        value, rate = float(at[0][n]), float(at[1][n])
        if value > 0:
            low, a, da = guess, value, rate
        else:
            high, b, db = guess, value, rate
        if rate < 0 and abs(value / rate) <= CLOSE * max(abs(high), span):
            return guess
    return high


def corrected_root(signed: Signed, near: Signed | None, n: int, low: float, high: float) -> float | None:
    """As `first_root`, begun where values `near` the true ones have theirs."""
    guess = None if near is None else first_root(near, n, low, high)
    for _ in range(CORRECTIONS if guess is not None else 0):
        assert guess is not None
        at = signed(guess)
        if at is None or not at[1][n] < 0:
            break
        correction = -float(at[0][n] / at[1][n])
        if abs(correction) <= CLOSE * max(abs(high), high - low):
            return guess
        guess += correction
        if not low <= guess <= high:
            break
        # Newton's next correction is of its square
        if abs(correction) <= CLOSE**0.5 * (high - low):
            return guess
    return first_root(signed, n, low, high)


def _cubic_root(low: float, a: float, da: float, high: float, b: float, db: float) -> float:
    """The root of the cubic through both ends with their rates that is the first one inside."""
    h = high - low
    c = [2 * (a - b) + h * (da + db), 3 * (b - a) - h * (2 * da + db), h * da, a]
    roots = np.roots(c) if np.all(np.isfinite(c)) else np.zeros(0)
    inside = np.sort(roots.real[(np.abs(roots.imag) < 1e-9) & (roots.real > 0) & (roots.real < 1)])
    share = float(inside[0]) if inside.size else a / (a - b)
    return low + min(max(share, 1e-9), 1 - 1e-9) * h if inside.size else low + 0.5 * h
