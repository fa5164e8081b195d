"""Packages: what gtmodel asks for, and what is installed."""

from __future__ import annotations

import re
import tomllib
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

_REQUIREMENT = re.compile(r"\s*([\w.-]+)\s*(?:\[([\w\s,.-]+)\])?\s*([^;]*)")
_EXTRA = re.compile(r"""extra\s*==\s*["']([\w.-]+)["']""")


@dataclass(frozen=True)
class Requirement:
    """A package that is asked for: its name, extras of it, the least version as text, "" for any."""

    name: str
    extras: tuple[str, ...] = ()
    least: str = ""

    def __str__(self) -> str:
        return f"{self.name}>={self.least}" if self.least else self.name

    def installed(self) -> str:
        """The installed version; "" where there is none."""
        try:
            return metadata.version(self.name)
        except metadata.PackageNotFoundError:
            return ""

    def missing(self) -> str:
        """What is wrong with the installed version, "" where nothing is."""
        version = self.installed()
        if not version:
            return "missing"
        return "too old" if self.least and _numbers(version) < _numbers(self.least) else ""


@dataclass(frozen=True)
class Requirements:
    """The least Python, the packages that gtmodel needs, and those of each extra; nothing where that is not known."""

    python: str
    packages: tuple[Requirement, ...]
    extras: dict[str, tuple[Requirement, ...]]


def requirements(package: str = "gtmodel") -> Requirements:
    """Those of the pyproject.toml beside the package, in a clone; else those that were installed with it."""
    beside = Path(__file__).resolve().parents[2] / "pyproject.toml"
    if beside.is_file():
        project = tomllib.loads(beside.read_text(encoding="utf-8")).get("project", {})
        if project.get("name") == package:
            extras = {name: read(texts) for name, texts in project.get("optional-dependencies", {}).items()}
            return _whole(package, project["requires-python"], read(project["dependencies"]), extras)
    try:
        about = metadata.metadata(package)
    except metadata.PackageNotFoundError:
        return Requirements("", (), {})
    texts = metadata.requires(package) or []
    extras = {name: read([t for t in texts if _extra(t) == name]) for name in about.get_all("Provides-Extra") or []}
    return _whole(package, about["Requires-Python"] or "", read([t for t in texts if not _extra(t)]), extras)


def read(texts: list[str]) -> tuple[Requirement, ...]:
    """Requirements as pyproject.toml writes them, of which the name and the least version count."""
    asked = []
    for text in texts:
        match = _REQUIREMENT.match(text)
        if match is not None:
            least = re.search(r">=\s*([\w.]+)", match[3])
            extras = tuple(e.strip() for e in (match[2] or "").split(",") if e.strip())
            asked.append(Requirement(match[1], extras, least[1] if least else ""))
    return tuple(asked)


def _extra(text: str) -> str:
    match = _EXTRA.search(text)
    return match[1] if match else ""


def _whole(
    package: str, python: str, packages: tuple[Requirement, ...], extras: dict[str, tuple[Requirement, ...]]
) -> Requirements:
    """With the packages of an extra that another one names, as dev names gtmodel[notebooks]."""

    def opened(name: str, seen: tuple[str, ...]) -> list[Requirement]:
        every = []
        for one in extras.get(name, ()):
            if one.name != package:
                every.append(one)
            every += [r for e in one.extras if one.name == package and e not in seen for r in opened(e, (*seen, e))]
        return every

    return Requirements(python.lstrip(">= "), packages, {name: tuple(opened(name, (name,))) for name in extras})


def _numbers(version: str) -> tuple[int, ...]:
    """The release numbers of a version: "3.8.0rc1" is (3, 8, 0); without zeros at the end, so that 3.8 is 3.8.0."""
    match = re.match(r"\d+(\.\d+)*", version)
    numbers = [int(part) for part in match[0].split(".")] if match else []
    while numbers and numbers[-1] == 0:
        numbers.pop()
    return tuple(numbers)
