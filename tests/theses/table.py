"""The rows of docs/theses.toml, and the one comparison that ties a computed number to its row."""

from __future__ import annotations

import tomllib
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from gtmodel.robots import kr500_tables

CLONE = Path(__file__).parents[2]
FILE = CLONE / "docs" / "theses.toml"
SHOWN = 3e-3
"""Relative: three to five digits of `ours` stand in the table."""
KR500: dict[str, Any] = kr500_tables()


@cache
def rows() -> dict[str, dict[str, Any]]:
    """All rows by id."""
    groups = tomllib.loads(FILE.read_text(encoding="utf-8"))["group"]
    return {row["id"]: row for group in groups for row in group["row"]}


@cache
def gantry_tau(dynamics: bool = False) -> dict[str, Any]:
    """Printed numbers of the Gantry-Tau."""
    name = "gantry_tau_dynamics" if dynamics else "gantry_tau"
    return tomllib.loads((CLONE / "gtmodel/robots/data" / f"{name}.toml").read_text(encoding="utf-8"))


def assert_is_ours(row: str, computed: Any) -> None:
    """The number in the column "ours" is the computed one."""
    np.testing.assert_allclose(computed, rows()[row]["ours"], rtol=SHOWN, atol=1e-9, err_msg=row)
