"""When samples were taken that are stamped when they arrive."""

from __future__ import annotations

import numpy as np

from ...results.refusal import ArgumentError


def sampled_instants(stamps: np.ndarray, period: float) -> np.ndarray:
    """Instants (n,) at which an even sensor took samples that arrived at these stamps (n,), but for the least delay.

    A sample was taken at least one period before the next one, and that one before it arrived: so none was taken later
    than any arrival after it less the periods between. The latest instants that this allows are given. They are even
    where samples wait in a buffer, and step on where samples were lost.

    period: of the sensor by its own clock [s]; a little short does no harm. Raises ArgumentError for one that is not
    above zero, and for stamps that go back.

    >>> taken = 0.01 * np.arange(7)
    >>> arrived = np.maximum.accumulate(taken + [0.0, 0.004, 0.0, 0.027, 0.017, 0.007, 0.0])  # three waited
    >>> gt.filtering.sampled_instants(arrived, 0.01).round(6).tolist()
    [0.0, 0.01, 0.02, 0.03, 0.04, 0.05, 0.06]
    """
    stamps = np.asarray(stamps, float)
    if not period > 0:
        raise ArgumentError(f"expected more than 0 s; found {period}", "period")
    if np.any(np.diff(stamps) < 0):
        row = int(np.argmax(np.diff(stamps) < 0)) + 1
        raise ArgumentError(f"the stamps go back in row {row}; drop such rows first", "stamps")
    own = period * np.arange(len(stamps))
    return own + np.minimum.accumulate((stamps - own)[::-1])[::-1]
