"""How far two results are apart."""

from __future__ import annotations

from typing import Any

import numpy as np


def relative_error(actual: Any, expected: Any, floor: float = 1.0) -> float:
    """Largest distance of the rows (last axis) in units of the expected row's largest entry, but at least `floor`.

    NaN anywhere gives infinity: a missing value is never close.
    """
    a, e = np.atleast_1d(np.asarray(actual, dtype=float)), np.atleast_1d(np.asarray(expected, dtype=float))
    assert a.shape == e.shape, f"shapes {a.shape} and {e.shape} cannot be compared"
    size = np.maximum(floor, np.max(np.abs(e), axis=-1, keepdims=True, initial=0.0))
    error = np.abs(a - e) / size
    return float(np.max(error, initial=0.0)) if np.all(np.isfinite(error)) else np.inf
