"""Problem files as they lie on the disk: which file a name means, its bytes, its TOML."""

from __future__ import annotations

import difflib
import re
import tomllib
from pathlib import Path
from typing import Any

from gtmodel._files import problems_dir
from gtmodel.results.read_bounds import TooDeepError, toml_of

from ..results.disk import path_of
from .input_error import InputError
from .toml_slips import shown_line, slip


def find(path: str | Path) -> tuple[Path, bool]:
    """The file, and True when it is one shipped with gtmodel: "problems/NAME.toml", "NAME.toml" or "NAME"."""
    asked = path_of(path)
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
    name = asked.name.removesuffix(".toml")
    beside = difflib.get_close_matches(name, [p.stem for p in asked.parent.glob("*.toml")], n=1)
    close = difflib.get_close_matches(name, shipped_names(), n=1)
    hint = f"did you mean the shipped '{close[0]}'?" if close else "gtmodel list problems shows the shipped ones"
    hint = f"did you mean '{asked.with_name(beside[0])}.toml'?" if beside else hint
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
        return toml_of(content.decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise InputError(f"line {line}: not UTF-8 text; save the file as UTF-8") from error
    except TooDeepError as error:
        raise InputError(str(error)) from None
    except tomllib.TOMLDecodeError as error:
        reason = str(error).partition(" (at ")[0]
        place = re.search(r"at line (\d+)", str(error))  # else at the end
        line = int(place[1]) if place else content.count(b"\n", 0, len(content.rstrip())) + 1
        written = [*content.decode("utf-8-sig").splitlines(), ""][line - 1].strip()
        line_text = f"; found {shown_line(written)}" if written else ""
        raise InputError(f"line {line}: not TOML: {slip(written, reason)}{line_text}") from error
