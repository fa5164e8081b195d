"""Whether one signal of a log is another one times about 1: signs, units and channels that were exchanged."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ...inference.residuals import shown_p
from ...results.suspicion import Suspicion

LEAST, MOST = 0.5, 2.0  # gains that still count as 1: models and lags are not told by this test, signs and units are
STRETCHES = 16  # of rows, whose sums are tested, each with the same part of the motion
FEWEST = 8  # stretches: where the motion lies in fewer rows, nothing is tested


def gain_off(
    measured: ArrayLike, expected: ArrayLike, by: ArrayLike, what: str, of: str, remedy: str, *, name: str = "gain"
) -> Suspicion:
    """Whether `measured` (n,) is `expected` (n,) times a number below LEAST or above MOST.

    Both may be noisy. `by` (n,) moves with what they should have in common and holds the noise of neither, such as a
    model's answer to the reference: an instrumental variable, so that the gain has no bias by noise. The sums of `by`
    times (measured - bound expected) over stretches of rows, each with the same sum of squares of `by`, have one sign
    where the gain lies beyond that bound; Student's t of these sums bears noise that is coloured within a stretch.
    p is NaN where too little moves to be tested. The evidence reads "`what` is -1 times `of`".

    >>> from gtmodel.measurements.inspection.gains import gain_off
    >>> a = np.sin(0.1 * np.arange(1000))
    >>> felt = a + 0.1 * np.random.default_rng(1).normal(size=1000)
    >>> [bool(gain_off(sign * felt, a, a, "the reading", "the model's", "turn it").p < 1e-9) for sign in (1, -1)]
    [False, True]
    """
    y, x, z = (rows - rows.mean() for rows in (np.asarray(given, float) for given in (measured, expected, by)))
    common = float(z @ x)
    moved = np.cumsum(z**2)
    ends = np.unique(np.searchsorted(moved, moved[-1] * np.arange(1, STRETCHES) / STRETCHES))
    if len(ends) + 1 < FEWEST or common == 0.0:
        return Suspicion(name, f"the gain of {what} on {of}: too little is left to test", np.nan, remedy)
    z = np.sign(common) * z
    gain = float(z @ y) / abs(common)
    of_y, of_x = (np.add.reduceat(z * rows, np.concatenate([[0], ends])) for rows in (y, x))
    p = min(1.0, 2 * min(_below(of_y - LEAST * of_x), _below(MOST * of_x - of_y)))
    return Suspicion(name, f"{what} is {gain:.3g} times {of} ({shown_p(p)})", p, remedy)


def _below(sums: np.ndarray) -> float:
    """Probability that independent sums with mean zero or more have one so far below."""
    from scipy import special  # here: keys of kinds import what judges a log

    error = float(np.std(sums, ddof=1)) / np.sqrt(len(sums))
    t = float(np.mean(sums)) / error if error > 0 else np.sign(np.mean(sums)) * np.inf
    return float(special.stdtr(len(sums) - 1, t))
