"""Tables as CSV: one writer, columns of numbers or words by name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

Columns = Mapping[str, Sequence[Any] | np.ndarray]


def csv_text(columns: Columns, digits: int | Mapping[str, int | str] = 6, notes: Sequence[str] = ()) -> str:
    """Columns (n,) under their names, each number with so many digits, or with those of its column, or in its format,
    as ".4f"; units stand in the names. NaN becomes an empty cell; words stand as they are. `notes`: comments above."""
    of = [digits if isinstance(digits, int) else digits.get(name, "") for name in columns]
    forms = [f".{d}g" if isinstance(d, int) else d for d in of]
    lines = [*(f"# {note}" for note in notes), ",".join(columns)]
    for row in zip(*columns.values(), strict=True):
        lines.append(",".join(_cell(x, form) for x, form in zip(row, forms, strict=True)))
    return "\n".join(lines) + "\n"


def _cell(x: Any, form: str) -> str:
    return x if isinstance(x, str) else "" if np.isnan(x) else f"{x:{form}}"
