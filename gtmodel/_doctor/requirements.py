"""Packages that gtmodel requires, and their installed versions."""

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
    """A required package: name, extras, and smallest version as text, "" for any."""

    name: str
    extras: tuple[str, ...] = ()
    least: str = ""

    def __str__(self) -> str:
        return f"{self.name}>={self.least}" if self.least else self.name

    def installed(self) -> str:
        """Return the installed version; "" if there is none."""
        try:
            return metadata.version(self.name)
        except metadata.PackageNotFoundError:
            return ""

    def missing(self) -> str:
        """Return "missing" or "too old", or "" if the installed version is fine."""
        version = self.installed()
        if not version:
            return "missing"
        return "too old" if self.least and _numbers(version) < _numbers(self.least) else ""


@dataclass(frozen=True)
class Requirements:
    """Smallest Python version, required packages, and packages of each extra; empty if unknown."""

    python: str
    packages: tuple[Requirement, ...]
    extras: dict[str, tuple[Requirement, ...]]


def requirements(package: str = "gtmodel") -> Requirements:
    """Return the requirements in pyproject.toml, in a clone, otherwise those in the metadata of the installation."""
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
    """Parse requirements of pyproject.toml; name, extras and smallest version count."""
    parsed = []
    for text in texts:
        match = _REQUIREMENT.match(text)
        if match is not None:
            least = re.search(r">=\s*([\w.]+)", match[3])
            extras = tuple(e.strip() for e in (match[2] or "").split(",") if e.strip())
            parsed.append(Requirement(match[1], extras, least[1] if least else ""))
    return tuple(parsed)


def _extra(text: str) -> str:
    match = _EXTRA.search(text)
    return match[1] if match else ""


def _whole(
    package: str, python: str, packages: tuple[Requirement, ...], extras: dict[str, tuple[Requirement, ...]]
) -> Requirements:
    """Requirements in which an extra includes the extras that it names, as dev names gtmodel[notebooks]."""

    def opened(name: str, seen: tuple[str, ...]) -> list[Requirement]:
        every = []
        for one in extras.get(name, ()):
            if one.name != package:
                every.append(one)
            every += [r for e in one.extras if one.name == package and e not in seen for r in opened(e, (*seen, e))]
        return every

    return Requirements(python.lstrip(">= "), packages, {name: tuple(opened(name, (name,))) for name in extras})


def _numbers(version: str) -> tuple[int, ...]:
    """Release numbers of a version without trailing zeros: "3.8.0rc1" gives (3, 8), so that 3.8 equals 3.8.0."""
    match = re.match(r"\d+(\.\d+)*", version)
    numbers = [int(part) for part in match[0].split(".")] if match else []
    while numbers and numbers[-1] == 0:
        numbers.pop()
    return tuple(numbers)
