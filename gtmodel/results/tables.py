"""Tables as CSV: one writer, columns of numbers by name."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np


def csv_text(columns: Mapping[str, np.ndarray], digits: int = 6) -> str:
    """Columns (n,) under their names, each number with so many digits; units stand in the names."""
    lines = [",".join(columns)]
    for row in zip(*columns.values(), strict=True):
        lines.append(",".join(f"{x:.{digits}g}" for x in row))
    return "\n".join(lines) + "\n"
