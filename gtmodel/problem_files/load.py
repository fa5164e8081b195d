"""From a TOML file to a checked problem. Every fault is one plain sentence with the file and the key."""

from __future__ import annotations

import difflib
import json
import re
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import pydantic

from gtmodel._files import problems_dir

from .base import InputError, Kind, Problem
from .registry import get
from .sentences import sentence_for, shown
from .settings import apply
from .toml_slips import shown_line, slip

_TOO_DEEP = "holds arrays or tables inside one another, hundreds deep; no key of any kind goes deeper than five"
_KINDS = 'write kind = "trajectory", or another that gtmodel schema lists'
S = TypeVar("S", bound=pydantic.BaseModel)


@dataclass(frozen=True)
class Loaded:
    """A problem read from a file: where it lies, its bytes, and what `--set` changed."""

    path: Path
    content: bytes
    settings: tuple[str, ...]
    kind: Kind
    problem: Problem
    shipped: bool

    @property
    def name(self) -> str:
        """File name; the same wherever the folder stands."""
        return self.path.name


def load(path: str | Path, settings: Iterable[str] = ()) -> Loaded:
    """Read and check a problem file, or one shipped with gtmodel where there is no such file.

    settings: texts "key=value" as in `--set`. Raises InputError; its sentence names the file and the key.
    """
    file, shipped = find(path)
    settings = tuple(settings)
    try:
        content = read(file)
        data = apply(parse(content), settings)
        kind, problem = check(data)
    except InputError as error:
        raise error.within(str(path)) from None
    except RecursionError:
        raise InputError(_TOO_DEEP, file=str(path)) from None
    return Loaded(file, content, settings, kind, problem, shipped)


def find(path: str | Path) -> tuple[Path, bool]:
    """The file, and True when it is one shipped with gtmodel: "problems/NAME.toml", "NAME.toml" or "NAME"."""
    asked = Path(path)
    if not asked.stem.isprintable():  # it titles files and pictures
        raise InputError("the name of a problem file has to be one line of printable characters", file=repr(str(path)))
    try:
        there = asked.exists()
    except OSError as error:  # such as a name that is too long
        raise InputError(f"cannot be read: {error.strerror}", file=str(path)) from error
    if there:
        return asked, False
    folder = problems_dir()
    if asked.parent in (Path(), Path("problems")):
        for name in (asked.name, f"{asked.name}.toml"):
            if (folder / name).is_file():
                return folder / name, True
    beside = difflib.get_close_matches(asked.name, [p.name for p in asked.parent.glob("*.toml")], n=1)
    close = difflib.get_close_matches(asked.stem, shipped_names(), n=1)
    hint = f"did you mean the shipped '{close[0]}'?" if close else "gtmodel list problems shows the shipped ones"
    hint = f"did you mean '{beside[0]}'?" if beside else hint
    raise InputError(f"there is no such file; {hint}", file=str(path))


def shipped_names() -> list[str]:
    """Names of the problems shipped with gtmodel."""
    return sorted(p.stem for p in problems_dir().glob("*.toml"))


def read(path: Path) -> bytes:
    """The bytes of a file. Raises InputError where it cannot be read."""
    try:
        return path.read_bytes()
    except OSError as error:
        reason = "is a folder; name a TOML file" if path.is_dir() else f"cannot be read: {error.strerror}"
        raise InputError(reason) from error


def parse(content: bytes) -> dict[str, Any]:
    """TOML as plain data. Raises InputError with the line."""
    try:
        return tomllib.loads(content.decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise InputError(f"line {line}: not UTF-8 text; save the file as UTF-8") from error
    except RecursionError:
        raise InputError(_TOO_DEEP) from None
    except tomllib.TOMLDecodeError as error:
        reason = str(error).partition(" (at ")[0]
        place = re.search(r"at line (\d+)", str(error))  # else at the end
        line = int(place[1]) if place else content.count(b"\n", 0, len(content.rstrip())) + 1
        written = [*content.decode("utf-8-sig").splitlines(), ""][line - 1].strip()
        line_text = f"; found {shown_line(written)}" if written else ""
        raise InputError(f"line {line}: not TOML: {slip(written, reason)}{line_text}") from error


def check(data: Mapping[str, Any]) -> tuple[Kind, Problem]:
    """The kind that the data name and the checked problem. Raises InputError for the first fault."""
    if "kind" not in data:
        raise InputError(f"is missing; {_KINDS}", "kind")
    if not isinstance(data["kind"], str):
        raise InputError(f"expected a text; found {shown(data['kind'])}; {_KINDS}", "kind")
    try:
        kind = get(data["kind"])
    except InputError as error:
        raise error.within("", "kind") from None
    return kind, validate(kind.Schema, data)


def validate(schema: type[S], data: Mapping[str, Any]) -> S:
    """The data as an instance of the schema. Raises InputError for the first fault."""
    try:
        # through JSON: its strict mode takes lists for tuples, but no text for a number
        return schema.model_validate_json(json.dumps(data, default=str))
    except pydantic.ValidationError as error:
        raise sentence_for(error, schema, data) from None
