"""Tables as CSV: one writer, columns of numbers by name."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np


def csv_text(columns: Mapping[str, np.ndarray], digits: int | Mapping[str, int] = 6) -> str:
    """Columns (n,) under their names, each number with so many digits, or with those of its column; units stand in the
    names. NaN becomes an empty cell."""
    of = [digits if isinstance(digits, int) else digits[name] for name in columns]
    lines = [",".join(columns)]
    for row in zip(*columns.values(), strict=True):
        lines.append(",".join("" if np.isnan(x) else f"{x:.{d}g}" for x, d in zip(row, of, strict=True)))
    return "\n".join(lines) + "\n"
