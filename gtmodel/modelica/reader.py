"""Text to tree: the grammar on lark, and sentences for what it does not take."""

from __future__ import annotations

import hashlib
import os
import re
from functools import cache
from pathlib import Path
from typing import Any

from .._near import near
from ..results.disk import path_of
from . import trees
from .syntax import ClassText, ModelicaError, Place, Source

GRAMMAR = Path(__file__).with_name("grammar.lark")
# the largest file of the Modelica Standard Library has 1.1 MB
LARGEST = 4_000_000
# brackets inside one another; the deepest of the 201 files of the Standard Library go 13 deep
DEEPEST = 100
_SKIPPED = re.compile(r'"(?:\\.|[^"\\])*"|//[^\n]*|/\*.*?\*/|\'(?:\\.|[^\'\\])+\'|[()\[\]{}]|\n', re.DOTALL)
_PAIRS = {")": "(", "]": "[", "}": "{"}
_WORDS = {
    "END": "end", "IDENT": "a name", "NUMBER": "a number", "STRING": "a text", "SEMICOLON": ";", "EQUAL": "=",
    "LPAR": "(", "RPAR": ")", "LSQB": "[", "RSQB": "]", "LBRACE": "{", "RBRACE": "}", "COMMA": ",", "COLON": ":",
    "DOT": ".", "$END": "the end of the text", "INITIAL": "initial", "CONSTRAINT": "constraint",
}  # fmt: skip


@cache
def _parser() -> Any:
    try:
        import lark
    except ModuleNotFoundError:
        raise ModelicaError(
            "reading Modelica text needs the package lark; pip install 'gtmodel[modelica]' brings it"
        ) from None
    grammar = GRAMMAR.read_text(encoding="utf-8")
    options: dict[str, Any] = {
        "parser": "lalr", "lexer": "basic", "propagate_positions": True, "maybe_placeholders": False,
    }  # fmt: skip
    key = hashlib.sha256(f"{lark.__version__} {grammar}".encode()).hexdigest()[:16]
    where = trees.folder()  # tables are pickled: only from a folder that nobody else can write
    return lark.Lark(grammar, cache=str(where / f"{key}.tables") if where is not None else False, **options)


def parse(text: str, path: str = "") -> list[ClassText]:
    """The classes of a text, in its order; those of a file that begins `within P;` stand in a package P.

    path: of the file, for error messages. Raises ModelicaError with file, line and the line itself.
    """
    source = Source(path, text.removeprefix("\ufeff"))
    _bounded(source)
    parser = _parser()
    import lark

    from .shape import Shaping, of_source

    try:
        with of_source(source):
            classes: list[ClassText] = Shaping().transform(parser.parse(source.text))
            return _not_too_deep(classes)
    except lark.exceptions.VisitError as error:
        refused = error.orig_exc
    except lark.exceptions.UnexpectedInput as error:
        refused = _sentence(error, source)
    raise refused from None


def _not_too_deep(classes: list[ClassText]) -> list[ClassText]:
    stack = [(item, 1) for item in classes]
    while stack:
        item, depth = stack.pop()
        if depth > DEEPEST:
            raise ModelicaError(f"more than {DEEPEST} classes stand in one another", item.at)
        stack += [(inner, depth + 1) for inner in item.classes.values()]
    return classes


def read(path: str | os.PathLike[str]) -> list[ClassText]:
    """The classes of a file; see `parse`. Raises ModelicaError where it cannot be read."""
    return known(content_of(path), str(path))


def known(text: str, path: str) -> list[ClassText]:
    """As `parse`, from the cache if a file with this very text was parsed before."""
    source = Source(path, text.removeprefix("\ufeff"))
    classes = trees.tree(source)
    if classes is None:
        classes = parse(text, path)
        trees.keep(source, classes)
    return classes


def content_of(path: str | os.PathLike[str]) -> str:
    """The text of a file. Raises ModelicaError where it cannot be read."""
    file = path_of(path)
    try:
        if not file.is_file():
            raise ModelicaError(f"{path} cannot be read: " + ("it is no file" if file.exists() else "there is no file"))
        if file.stat().st_size > LARGEST:
            raise ModelicaError(f"{file.name} has {file.stat().st_size} bytes; no Modelica text of that size is read")
        content = file.read_bytes()
    except OSError as error:
        raise ModelicaError(f"{path} cannot be read: {error.strerror}") from None
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("latin-1")  # comments of the nineties


def _bounded(source: Source) -> None:
    """Refuses what would take memory or stack without a bound, and brackets that do not close."""
    if len(source.text) > LARGEST:
        raise ModelicaError(f"{source.name} has {len(source.text)} characters; no Modelica text of that size is read")
    opened: list[tuple[str, int]] = []
    line = 1
    for match in _SKIPPED.finditer(source.text):
        token = match[0]
        if token in "([{":
            opened.append((token, line))
            if len(opened) > DEEPEST:
                raise ModelicaError(f"more than {DEEPEST} brackets stand in one another", Place(source, line, 1))
        elif token in _PAIRS:
            if not opened or opened[-1][0] != _PAIRS[token]:
                what = f"'{opened[-1][0]}' of line {opened[-1][1]} is open" if opened else "none is open"
                column = match.start() - source.text.rfind("\n", 0, match.start())
                raise ModelicaError(f"'{token}' closes a bracket, but {what}", Place(source, line, column))
            opened.pop()
        line += token.count("\n")


def _sentence(error: Any, source: Source) -> ModelicaError:
    """What the parser says, in words."""
    line = error.line if isinstance(getattr(error, "line", None), int) and error.line > 0 else len(source.lines)
    column = error.column if isinstance(getattr(error, "column", None), int) and error.column > 0 else 1
    place = Place(source, line, column)
    token: Any = getattr(error, "token", None)
    if token is None:  # a character that begins no word of the language
        letter = source.lines[line - 1][column - 1 : column] if source.lines else ""
        meant = {"=": "", "&": "; write and", "|": "; write or", "!": "; write not or <>", '"': "; its text never ends"}
        return ModelicaError(f"'{letter}' in column {column} is no Modelica{meant.get(letter, '')}", place)
    expected: set[str] = {_WORDS.get(str(name), str(name).lower()) for name in error.accepts or error.expected}
    if token.type == "$END":
        last = len(source.lines)
        return ModelicaError(f"the text ends too early; expected {_some(expected)}", Place(source, last, 1))
    if token.column == 1 or not source.lines[line - 1][: column - 1].strip():  # begins its line
        before = next((n for n in range(line - 1, 0, -1) if _code(source.lines[n - 1])), 0)
        if ";" in expected and before:
            return ModelicaError(f"'{token}' of line {line} comes where a ';' is missing", _end_of(source, before))
    hint = "; write == to compare" if str(token) == "=" and "then" in expected else ""
    if str(token) == ":=":
        hint = "; := belongs into an algorithm section, an equation has ="
    if str(token) in ("<=", ">=") and re.search(r"[<>]=[^;]*$", source.lines[line - 1][: column - 1]):
        hint = "; write two constraints in place of a chain: a <= x; x <= b;"
    if token.type == "IDENT" and not hint:
        hint = near(str(token), sorted(w for w in expected if w.isalpha()))
    shown = f"'{token}'" if len(token) < 40 else f"'{token[:40]}...'"
    return ModelicaError(f"{shown} in column {column} is unexpected; expected {_some(expected)}{hint}", place)


def _code(line: str) -> bool:
    return bool(line.split("//")[0].strip())


def _end_of(source: Source, line: int) -> Place:
    return Place(source, line, len(source.lines[line - 1]) + 1)


def _some(expected: set[str]) -> str:
    """A few of what may stand there, the likely ones first."""
    order = [";", "=", ")", "a name", "end", "then", "loop", "equation", ",", "]", "}"]
    first = [w for w in order if w in expected]
    rest = sorted(expected - set(first))
    return " or ".join((first + rest)[:4])
