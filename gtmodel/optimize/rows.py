"""Functions of a point, as (x, xd, u, P, t), at many instants at once."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np


def on_rows(
    f: ca.Function, rows: Sequence[np.ndarray], P: np.ndarray, times: np.ndarray, *more: np.ndarray
) -> list[np.ndarray]:
    """Results (r, n) of f for n instants side by side; `rows` and `more` (n, ...) stand before and behind P and t."""
    n = len(times)
    before, behind = ([ca.DM(a.T) for a in arguments] for arguments in (rows, more))
    return [v.full() for v in f.map(n).call([*before, ca.repmat(ca.DM(P), 1, n), ca.DM(times).T, *behind])]
