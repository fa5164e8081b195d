"""Problem files on the disk: find them by name, parse their TOML, explain typing errors, and list the shipped files."""

from __future__ import annotations

import difflib
import re
import tomllib
from itertools import takewhile
from pathlib import Path
from typing import Any

from gtmodel import modelica
from gtmodel._files import problems_dir
from gtmodel.modelica.reference import is_reference
from gtmodel.results.read_bounds import TooDeepError, toml_of
from gtmodel.robots.entries import entries

from .._near import meant
from ..results.disk import path_of


class InputError(ValueError):
    """Wrong input: one sentence, with file, key and line if they are known."""

    def __init__(self, sentence: str, key: str = "", file: str = "", line: int | None = None) -> None:
        super().__init__(sentence, key, file, line)
        self.message = sentence
        self.key = key
        self.file = file
        self.line = line

    def __str__(self) -> str:
        text = ": ".join(part for part in (self.file, self.key, self.message) if part)
        return text if self.line is None else f"{text} (line {self.line})"

    def within(self, file: str, key: str = "", content: bytes | None = None) -> InputError:
        """Return the error with this file, key and the line in `content`, as far as it does not name its own."""
        key = self.key or key
        line = self.line if self.file or self.line or content is None else line_of(content, key)
        return InputError(self.message, key, self.file or file, line)


_NUMBER = r"=\s*[-+]?"
# the first pattern that matches the line gives the hint; _SLIPS sees the line without quoted texts
_QUOTES = (
    (r"[“”„‘’»«]", "write a text in straight quotes, \"text\" or 'text'"),
    (r"^[^'#]*\\", "write a path with /, or in single quotes, where a backslash has no special meaning"),
    (r'^[^"#]*"[^"]*$|^[^\'#]*\'[^\']*$', "a quote is missing"),
)
_SLIPS = (
    (r"^\s*[\w.]+\s*:", "set a key with =, not with a colon"),
    (r"==", "set a key with one ="),
    (_NUMBER + r"\d+,\d", "write a number with a decimal point"),
    (_NUMBER + r"0\d", "write a number without a leading zero"),
    (_NUMBER + r"(\d+\.(?!\d)|\.\d)", "write a digit on both sides of the decimal point"),
    (_NUMBER + r"[\d.]+(e[-+]?\d+)?\s*[^\W\d_]", "write a number without its unit; the key names the unit"),
    (r"=\s*(True|False)\b", "write true and false in lower case"),
    (r"=\s*(None|null|nil|NULL)?\s*(#|$)", "remove a key that has no value"),
    (r"\s//|\s/\*|\s;", "start a comment with #"),
    (r"=\s*[^\W\d]", "write a text in quotes"),
)
_REASONS = (
    (r"overwrite a value", "the key appears twice"),
    (r"[Cc]annot declare", "the table appears twice"),
)


def slip(line: str, reason: str) -> str:
    """Return advice about the likely mistake in a line that a parser refused for `reason`; else the reason itself.

    >>> from gtmodel.problem_files.files import slip
    >>> slip("payload_kg = 5,0", "Expected newline")
    'write a number with a decimal point'
    """
    bare = re.sub(r'"[^"]*"|\'[^\']*\'', '""', line)
    for text, table in ((reason, _REASONS), (line, _QUOTES), (bare, _SLIPS)):
        for pattern, sentence in table:
            if re.search(pattern, text):
                return sentence
    return f"{reason[:1].lower()}{reason[1:]}"


def shown_line(line: str) -> str:
    """Return a line of a file in quotes, shortened, for a message."""
    text = line if line.isprintable() else repr(line)[1:-1]
    return f"'{text}'" if len(text) <= 60 else f"'{text[:57]}...'"


def find(path: str | Path) -> tuple[Path, bool]:
    """Return the file, and True if it is shipped with gtmodel: "problems/NAME.toml", "NAME.toml" or "NAME"."""
    wanted = path_of(path)
    if not wanted.stem.isprintable():  # the name becomes a title of files and pictures
        raise InputError("the name of a problem file must be one line of printable characters", file=repr(str(path)))
    try:
        exists = wanted.exists()
    except OSError as error:  # such as a name that is too long
        raise InputError(f"cannot be read: {error.strerror}", file=str(path)) from error
    if exists:
        return wanted, False
    folder = problems_dir()
    if wanted.parent in (Path(), Path("problems")):
        for name in (wanted.name, f"{wanted.name}.toml"):
            if (folder / name).is_file():
                return folder / name, True
    name = wanted.name.removesuffix(".toml")
    neighbours = difflib.get_close_matches(name, [p.stem for p in wanted.parent.glob("*.toml")], n=1)
    close = difflib.get_close_matches(name, shipped_names(), n=1)
    hint = f"did you mean the shipped '{close[0]}'?" if close else "gtmodel list problems shows the shipped problems"
    hint = f"did you mean '{wanted.with_name(neighbours[0])}.toml'?" if neighbours else hint
    raise InputError(f"there is no such file; {hint}", file=str(path))


def shipped_names() -> list[str]:
    """Return the names of the problems shipped with gtmodel."""
    return sorted(p.stem for p in problems_dir().glob("*.toml"))


def read(path: Path) -> bytes:
    """Return the bytes of a file. Raises InputError if it cannot be read."""
    try:
        return path.read_bytes()
    except OSError as error:
        reason = "is a folder; name a TOML file" if path.is_dir() else f"cannot be read: {error.strerror}"
        raise InputError(reason) from error


def parse(content: bytes) -> dict[str, Any]:
    """Parse TOML into plain data. Raises InputError with the line."""
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
        text = [*content.decode("utf-8-sig").splitlines(), ""][line - 1].strip()
        line_text = f"; found {shown_line(text)}" if text else ""
        raise InputError(f"line {line}: not TOML: {slip(text, reason)}{line_text}") from error


def parts_of(key: str) -> list[str | int]:
    """Split `goal.tcp_m[1]`, or `goal.tcp_m.1` as in `--set`, into ["goal", "tcp_m", 1]."""
    return [int(part) if part.isdecimal() else part.strip() for part in re.findall(r"[^.\[\]]+", key)]


def line_of(content: bytes, key: str) -> int | None:
    """Return the line of a TOML text on which the value of a dotted key begins, or the innermost table or list around
    it; None if the text has neither.

    >>> from gtmodel.problem_files.files import line_of
    >>> line_of(b'kind = "modes"\\n[[rows]]\\na = 1\\n[[rows]]\\na = [\\n  2,\\n]', "rows[1].a[0]")
    5
    """
    lines = content.decode("utf-8-sig", errors="replace").splitlines()
    place, table = parts_of(key), list[str | int]()
    count: dict[tuple[str | int, ...], int] = {}  # the last index of each list of tables
    begin, deepest, line = 0, 0, None
    for end in range(1, len(lines) + 1):
        try:
            data: Any = toml_of("\n".join(lines[begin:end]))
        except ValueError:
            continue  # inside a statement
        first, begin = begin, end
        if data and lines[first].lstrip().startswith("["):
            table = []
            while data:
                ((name, data),) = data.items()
                table.append(name)
                if isinstance(data, list):
                    count[tuple(table)] = count.get(tuple(table), -1) + 1
                    data = data[0]
                if tuple(table) in count:
                    table.append(count[tuple(table)])
        depth = sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], zip(table, place, strict=False)))
        if depth == len(table):
            for part in place[depth:]:
                values: Any = dict(enumerate(data)) if isinstance(data, list) else data
                if not isinstance(values, dict) or part not in values:
                    break
                data, depth = values[part], depth + 1
        if depth > deepest:
            deepest, line = depth, first + 1
    return line


HEADS = {
    "robots": ("family", "degrees of freedom", "source", "masses"),
    "problems": ("kind", "title"),
    "classes": ("what", "line", "description"),
}


def of(what: str = "all") -> dict[str, Any]:
    """Return {"robots": {name: {...}}} or {"problems": ...}, both for "all", or {"classes": ...} for a Modelica file.
    Raises InputError for another word."""
    if is_reference(what):
        return {"classes": modelica.listing(what)}
    if what in ("kind", "kinds"):
        raise InputError("the kinds of problems are listed by: gtmodel schema")
    if what not in ("all", "robots", "problems"):
        hint = meant(what, ("robots", "problems"), "expected 'robots' or 'problems'")
        raise InputError(f"there is no list of '{what}'; {hint}")
    lists = {"robots": _robots, "problems": _problems}
    return {name: entries_of() for name, entries_of in lists.items() if what in ("all", name)}


def _robots() -> dict[str, dict[str, Any]]:
    return {name: entry._asdict() for name, entry in entries().items()}


def _problems() -> dict[str, dict[str, str]]:
    problems = {}
    for name in shipped_names():
        data = parse(read(problems_dir() / f"{name}.toml"))
        problems[name] = {"kind": str(data.get("kind", "")), "title": str(data.get("title", ""))}
    return problems
