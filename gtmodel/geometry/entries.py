"""Vectors and matrices entry by entry, for NumPy rows, CasADi columns and expressions of the language.

CasADi and the language are imported only when needed, so that plain numbers do not wait for the import.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

NUMBERS = {float, int, np.float64}
ROWS = {*NUMBERS, np.ndarray}


def is_column(v: Any) -> bool:
    """Return whether this is a CasADi column."""
    return hasattr(v, "numel")


def entries(v: Any) -> Any:
    """Return the entries of a vector; for rows (..., k), k arrays (...)."""
    if isinstance(v, np.ndarray):
        return v if v.ndim == 1 else [v[..., k] for k in range(v.shape[-1])]
    return [v[k] for k in range(v.numel())] if is_column(v) else tuple(v)


def vector(parts: Sequence[Any]) -> Any:
    """Return the vector with these entries; for k arrays (...), rows (..., k)."""
    kinds = {type(x) for x in parts}
    if kinds <= NUMBERS:
        return np.array(parts)
    return np.stack(np.broadcast_arrays(*parts), axis=-1) if kinds <= ROWS else _symbols(parts)


def matrix(rows: Sequence[Sequence[Any]]) -> Any:
    """Return the matrix with these rows of entries; for numbers and arrays (...) of one shape, matrices (..., m, k)."""
    parts = [x for row in rows for x in row]
    kinds = {type(x) for x in parts}
    if kinds <= NUMBERS:
        return np.array(rows)
    if not kinds <= ROWS:
        return _symbols(rows)
    shape = next(x.shape for x in parts if isinstance(x, np.ndarray))
    flat = np.empty((*shape, len(parts)))
    for k, x in enumerate(parts):
        flat[..., k] = x
    return flat.reshape(*shape, len(rows), -1)


def _symbols(parts: Sequence[Any]) -> Any:
    import casadi as ca

    from ..lang.expression import scope_of, vector

    rows = parts if isinstance(parts[0], list) else [[x] for x in parts]
    if scope_of(*[x for row in rows for x in row]) is None:
        return ca.vertcat(*[ca.horzcat(*row) for row in rows])
    return vector(parts)
