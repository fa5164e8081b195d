"""What there is: the robots of the catalogue and the problems shipped with gtmodel."""

from __future__ import annotations

import difflib
from typing import Any

from gtmodel._files import problems_dir
from gtmodel.robots import catalogue

from .base import InputError
from .load import parse, read, shipped_names

HEADS = {"robots": ("family", "degrees of freedom", "source", "masses"), "problems": ("kind", "title")}


def of(what: str = "all") -> dict[str, Any]:
    """{"robots": {name: {...}}} or {"problems": ...}, or both for "all". Raises InputError for another word."""
    if what not in ("all", *HEADS):
        close = difflib.get_close_matches(what, HEADS, n=1)
        hint = f"did you mean '{close[0]}'?" if close else "expected 'robots' or 'problems'"
        raise InputError(f"there is no list of '{what}'; {hint}")
    makers = {"robots": _robots, "problems": _problems}
    return {name: make() for name, make in makers.items() if what in ("all", name)}


def _robots() -> dict[str, dict[str, Any]]:
    return {name: entry._asdict() for name, entry in catalogue.entries().items()}


def _problems() -> dict[str, dict[str, str]]:
    problems = {}
    for name in shipped_names():
        data = parse(read(problems_dir() / f"{name}.toml"))
        problems[name] = {"kind": str(data.get("kind", "")), "title": str(data.get("title", ""))}
    return problems
