"""The printed tables of robots, as data of this package."""

from __future__ import annotations

import tomllib
from functools import cache
from importlib.resources import files
from typing import Any


@cache
def printed(name: str) -> dict[str, Any]:
    """A file of `data`, such as "gantry_tau.toml"; read once, so leave it as it is."""
    return tomllib.loads(files("gtmodel.robots").joinpath("data", name).read_text(encoding="utf-8"))
