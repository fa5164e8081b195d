"""sensitivity.csv: what a small change of each parameter does, link by link (Dressler 2012, Table 5.10)."""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from ...results.table import csv_text

_OF_A_LINK = re.compile(r"(?P<name>\w+)\[(?P<link>\d+)(,(?P<axis>[012]))?\]")
_TITLES = {
    "position_mm": "position change, mm",
    "orientation_deg": "orientation change, deg",
    "cost_m4": "change of (5.1), m^4",
}


def table(sums: Mapping[str, Mapping[str, float]], of: str) -> tuple[list[str], np.ndarray]:
    """Rows such as "L", "A_x" and their sums (rows, links), NaN where a link has none; `of`: the key of the sums."""
    sums_by_row: dict[str, dict[int, float]] = {}
    for name, own in sums.items():
        m = _OF_A_LINK.fullmatch(name)
        if m is not None and of in own:
            row = m["name"] + (f"_{'xyz'[int(m['axis'])]}" if m["axis"] else "")
            sums_by_row.setdefault(row, {})[int(m["link"])] = own[of]
    links = 1 + max((k for row in sums_by_row.values() for k in row), default=-1)
    order = sorted(sums_by_row, key=lambda row: (row[0] != "L", row))
    rows = [[sums_by_row[row].get(k, np.nan) for k in range(links)] for row in order]
    return order, np.array(rows, float).reshape(len(order), links)


def text(sums: Mapping[str, Mapping[str, float]]) -> str:
    """All three tables under each other, a line per parameter and a column per link."""
    parts = []
    for of, title in _TITLES.items():
        order, values = table(sums, of)
        if order:
            links = {f"link {k}": [f"{x:.4g}" for x in own] for k, own in enumerate(values.T)}
            parts.append(csv_text({title: order} | links))
    return "".join(parts) or "\n"
