"""Tests of what a fit leaves: colour, drift, other columns, other readings, one far off, larger than stated, held out.

Arrays in, a `Suspicion` out; all tests of one run go into one `suspicion_checks`, which sets their common level. Of a
fit, `J` (rows, channels, n) is the Jacobian at its optimum and `r` (rows, channels) what it leaves, in the order of
time, both divided by the standard deviation of each channel where these differ; (rows, n) and (rows,) of one channel.
F tests are exact for linear fits with white normal noise, whose size they need not know, however few the rows are.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...inference.chance import f_chance, f_test
from ...inference.held_out import MATTERS, chi_squared_over_noise
from ...inference.residuals import autocorrelation, shown_p
from .suspicion import Suspicion

NEARER = 1.5  # another reading leaves so many times less, or it is not believed: errors of a model are not told by it
WIDER = 1.2  # slow residuals so many times as large as white ones: below, intervals are too narrow by less than matters
OCTAVES = 6  # of slow waves, 1, 2 to 3, 4 to 7, ... half periods over all rows
MOST_ROWS = 1024  # longer series are averaged over neighbours first, which slow waves survive
IN_SPAN = 1e-10  # of a column's square: what is left of it is rounding, it lies in the span of the others
TOO_FEW = "too few rows are left to test"


class Explained(NamedTuple):
    """F test of further columns: `F` for `more` and `rest` degrees of freedom, `p`, and what is moved by them (rows,
    channels); p is NaN where nothing can be tested."""

    F: float
    p: float
    more: int
    rest: int
    moved: np.ndarray


def explained_by(J: np.ndarray, r: np.ndarray, columns: np.ndarray, *, least: float = 0.0) -> Explained:
    """Whether further columns (rows, channels, k) beside those of J explain of r more than chance does.

    r may be the measured values too. `least` is the rms of r that is rounding: below it nothing is tested.

    >>> from gtmodel.measurements.inspection.residual_tests import explained_by
    >>> time = np.linspace(0.0, 1.0, 30)
    >>> noise = np.random.default_rng(1).normal(size=30)
    >>> for drift in (0.0, 3.0):
    ...     print(round(explained_by(np.ones((30, 1)), noise + drift * time, time[:, None]).p, 4))
    0.1559
    0.0001
    """
    r = np.asarray(r, float)
    shape, values = r.shape, r.reshape(-1)
    known = _orthonormal(np.asarray(J, float).reshape(values.size, -1))
    further = np.asarray(columns, float).reshape(values.size, -1)
    size = np.sum(further**2, axis=0)
    further = further[:, size > 0] / np.sqrt(size[size > 0])
    further = further - known @ (known.T @ further)
    further = further - known @ (known.T @ further)
    own = _orthonormal(further, of=1.0)
    left = values - known @ (known.T @ values)
    parts = own.T @ left
    more, rest = own.shape[1], values.size - known.shape[1] - own.shape[1]
    moved = (own @ parts).reshape(shape)
    if more < 1 or rest < 1 or not float(left @ left) > values.size * least**2:
        return Explained(np.nan, np.nan, more, rest, moved)
    after = left - own @ parts
    explained, unexplained = float(parts @ parts), float(after @ after)
    return Explained(*f_test(explained + unexplained, unexplained, more, rest), more, rest, moved)


def drifts(
    J: np.ndarray,
    r: np.ndarray,
    time: np.ndarray,
    remedy: str,
    *,
    name: str = "drift",
    unit: str = "",
    least: float = 0.0,
) -> Suspicion:
    """Whether what is measured moves with `time` (rows,) in a straight line, each channel by its own slope."""
    rows = _rows(r)
    t = np.asarray(time, float)
    span = float(np.ptp(t))
    line = (t - t.mean()) / (span or 1.0)
    test = explained_by(J, rows, line[:, None, None] * np.eye(rows.shape[1]), least=least)
    if np.isnan(test.p):
        return Suspicion(name, f"drift: {TOO_FEW}", np.nan, remedy)
    # the slope beside the other unknowns
    slopes = _beside(J, rows, line)
    size = float(np.linalg.norm(slopes))
    return Suspicion(
        name, f"the readings move by {size:.3g}{unit and f' {unit}'} over the recording ({shown_p(test.p)})", test.p,
        remedy,
    )  # fmt: skip


def coloured(J: np.ndarray, r: np.ndarray, remedy: str, *, name: str = "coloured", least: float = 0.0) -> Suspicion:
    """Whether slow residuals, in the order of the rows, are larger than white noise has them: intervals for white noise
    are then too narrow by up to the ratio. Cosines over all rows are tested by octaves, the strongest counts.

    `whiteness` of gtmodel.inference tests correlations at all lags of a long series; its p of 0.1 % comes by chance two
    to six times as often for 24 to 200 rows. This test keeps its level for any number, and beside many unknowns.

    >>> from gtmodel.measurements.inspection.residual_tests import coloured
    >>> noise = np.random.default_rng(1).normal(size=200)
    >>> walk = np.cumsum(noise) / 5
    >>> [bool(coloured(np.ones((200, 1)), r, "average fewer").p < 1e-3) for r in (noise, noise + walk)]
    [False, True]
    """
    rows = _rows(r)
    J, short = _averaged(np.asarray(J, float).reshape(*rows.shape, -1)), _averaged(rows)
    T, channels = short.shape
    at = np.pi * (np.arange(T) + 0.5) / T
    tests = []
    for octave in range(OCTAVES):
        if 2 ** (octave + 1) > T // 2:
            break
        waves = np.cos(at[:, None] * np.arange(2**octave, 2 ** (octave + 1)))
        columns = np.einsum("tk,cd->tckd", waves, np.eye(channels)).reshape(T, channels, -1)
        tests.append(explained_by(J, short, columns, least=least / np.sqrt(len(rows) / T)))
    tests = [t for t in tests if not np.isnan(t.p)]
    if not tests:
        return Suspicion(name, f"colour: {TOO_FEW}", np.nan, remedy)
    strongest = min(tests, key=lambda t: (t.p, -t.F))
    p, times = min(1.0, len(tests) * strongest.p), float(np.sqrt(strongest.F))
    neighbours = max((float(autocorrelation(x, 1)[1]) for x in rows.T), key=abs)
    return Suspicion(
        name,
        f"residuals are coloured: slow ones are {times:.3g} times as large as white noise has them, neighbours have a "
        f"correlation of {neighbours:.2g} ({shown_p(p)})",
        p if times > WIDER else 1.0,
        remedy,
    )


def over_stated(chi_squared: float, degrees_of_freedom: float, remedy: str, *, name: str = "over_noise") -> Suspicion:
    """Whether residuals in units of the noise that was stated for them are larger than it, by more than matters: the
    sum of their squares and its degrees of freedom, see gtmodel.inference.chi_squared_over_noise."""
    judged = chi_squared_over_noise(chi_squared, degrees_of_freedom)
    p = judged.p if not judged.ratio <= MATTERS else 1.0
    return Suspicion(name, judged.extent, p, remedy)


def reads_better(
    given: float,
    other: float,
    degrees_of_freedom: float,
    reading: str,
    remedy: str,
    *,
    tests: int = 1,
    name: str = "reading",
    least: float = 0.0,
) -> Suspicion:
    """Whether another reading of the columns, the best of `tests`, is to be believed: it leaves so much less.

    given, other: sums of squares that both readings leave, with about `degrees_of_freedom` each; `least`: the rms of
    residuals that is rounding. `reading`: the other reading in words, "turns read as transposed".

    >>> from gtmodel.measurements.inspection.residual_tests import reads_better
    >>> reads_better(160.0, 0.6, 60, "read in the base frame", "transform them", tests=3).evidence
    'read in the base frame they fit 16.3 times better (p = 2.4e-56)'
    """
    if not degrees_of_freedom > 0:
        return Suspicion(name, f"{reading}: {TOO_FEW}", np.nan, remedy)
    small = max(degrees_of_freedom * least**2, np.finfo(float).tiny)
    ratio = float(np.sqrt(max(given, small) / max(other, small)))
    p = min(1.0, tests * float(f_chance(ratio**2, degrees_of_freedom, degrees_of_freedom)))
    evidence = f"{reading} they fit {ratio:.3g} times better ({shown_p(p)})"
    return Suspicion(name, evidence, p if ratio > NEARER else 1.0, remedy)


def held_out_worse(
    ratio: float,
    growth: float,
    fitted_freedom: float,
    held_out_freedom: float,
    remedy: str,
    *,
    tests: int = 1,
    name: str = "held_out",
) -> Suspicion:
    """Whether errors held out are larger than a sound model has them: the numbers of gtmodel.inference.held_out_ratio.

    `tests`: how many such ratios were looked at, of which this is the one with the smallest p.
    """
    if not (growth > 0 and np.isfinite(growth) and fitted_freedom > 0 and held_out_freedom > 0):
        return Suspicion(name, f"held out: {TOO_FEW}", np.nan, remedy)
    p = min(1.0, tests * float(f_chance(ratio**2 / growth, held_out_freedom, fitted_freedom)))
    evidence = (
        f"held-out errors are {ratio:.3g} times the fitted ones; a sound model has {np.sqrt(growth):.3g} on average "
        f"({shown_p(p)})"
    )
    return Suspicion(name, evidence, p if not ratio <= MATTERS else 1.0, remedy)


def one_far_off(
    J: np.ndarray, r: np.ndarray, remedy: str, *, name: str = "largest_residual", least: float = 0.0, base: int = 0
) -> Suspicion:
    """Whether one residual is larger than the others let it be, each in units of its own deviation (Student's, by a fit
    without it) and all counted. `base`: the number of the first row, for the sentence."""
    rows = _rows(r)
    Q = _orthonormal(np.asarray(J, float).reshape(rows.size, -1))
    values = rows.reshape(-1)
    rest, own = values.size - Q.shape[1], 1 - np.sum(Q**2, axis=1)
    total = float(values @ values)
    if rest < 2 or not total > values.size * least**2:
        return Suspicion(name, f"largest residual: {TOO_FEW}", np.nan, remedy)
    # a row that determines an unknown alone leaves nothing
    share = np.where(own > IN_SPAN, values**2 / np.maximum(own, IN_SPAN), 0.0)
    others = np.maximum(total - share, np.finfo(float).tiny * total) / (rest - 1)
    k = int(np.argmax(share / others))
    t = float(np.sqrt(share[k] / others[k]))
    p = min(1.0, values.size * float(f_chance(t**2, 1, rest - 1)))
    evidence = f"row {base + k // rows.shape[1]} is off by {t:.3g} deviations of the others ({shown_p(p)})"
    return Suspicion(name, evidence, p, remedy)


def _rows(r: np.ndarray) -> np.ndarray:
    r = np.asarray(r, float)
    return r[:, None] if r.ndim == 1 else r


def _orthonormal(A: np.ndarray, of: float | None = None) -> np.ndarray:
    """Orthonormal columns with the span of A, whose columns count in units of `of`, of their own size if left out."""
    size = np.linalg.norm(A, axis=0) if of is None else np.full(A.shape[1], of)
    A = A[:, size > 0] / size[size > 0]
    if not A.size:
        return np.zeros((len(A), 0))
    U, s, _ = np.linalg.svd(A, full_matrices=False)
    return U[:, s**2 > IN_SPAN]


def _beside(J: np.ndarray, rows: np.ndarray, line: np.ndarray) -> np.ndarray:
    """Slope of each channel along a line (rows,), fitted together with the columns of J."""
    T, channels = rows.shape
    lines = (line[:, None, None] * np.eye(channels)).reshape(T * channels, channels)
    both = np.hstack([lines, _orthonormal(np.asarray(J, float).reshape(T * channels, -1))])
    return np.linalg.lstsq(both, rows.reshape(-1), rcond=None)[0][:channels]


def _averaged(rows: np.ndarray) -> np.ndarray:
    """Sums of equally many neighbours over the root of their number, at most MOST_ROWS: white noise stays so."""
    each = -(-len(rows) // MOST_ROWS)
    if each == 1:
        return rows
    whole = len(rows) // each * each
    return rows[:whole].reshape(len(rows) // each, each, *rows.shape[1:]).sum(axis=1) / np.sqrt(each)
