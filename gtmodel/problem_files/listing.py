"""What there is: the robots of the catalogue and the problems shipped with gtmodel."""

from __future__ import annotations

from typing import Any

from gtmodel import modelica
from gtmodel._files import problems_dir
from gtmodel.modelica.reference import is_reference
from gtmodel.robots.entries import entries

from .._near import meant
from .files import parse, read, shipped_names
from .input_error import InputError

HEADS = {
    "robots": ("family", "degrees of freedom", "source", "masses"),
    "problems": ("kind", "title"),
    "classes": ("what", "line", "description"),
}


def of(what: str = "all") -> dict[str, Any]:
    """{"robots": {name: {...}}} or {"problems": ...}, or both for "all"; {"classes": ...} of a Modelica
    file. Raises InputError for another word."""
    if is_reference(what):
        return {"classes": modelica.listing(what)}
    if what not in ("all", "robots", "problems"):
        hint = meant(what, ("robots", "problems"), "expected 'robots' or 'problems'")
        raise InputError(f"there is no list of '{what}'; {hint}")
    makers = {"robots": _robots, "problems": _problems}
    return {name: make() for name, make in makers.items() if what in ("all", name)}


def _robots() -> dict[str, dict[str, Any]]:
    return {name: entry._asdict() for name, entry in entries().items()}


def _problems() -> dict[str, dict[str, str]]:
    problems = {}
    for name in shipped_names():
        data = parse(read(problems_dir() / f"{name}.toml"))
        problems[name] = {"kind": str(data.get("kind", "")), "title": str(data.get("title", ""))}
    return problems
