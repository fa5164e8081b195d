"""Parser: text to syntax tree by a lark grammar, with error messages for syntax errors."""

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
# nested brackets; the deepest of the 201 files of the Standard Library has 13
DEEPEST = 100
_SKIPPED = re.compile(r'"(?:\\.|[^"\\])*"|//[^\n]*|/\*.*?\*/|\'(?:\\.|[^\'\\])+\'|[()\[\]{}]|\n', re.DOTALL)
_PAIRS = {")": "(", "]": "[", "}": "{"}
_WORDS = {
    "END": "end", "IDENT": "a name", "NUMBER": "a number", "STRING": "a string", "SEMICOLON": ";", "EQUAL": "=",
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
    """Return the classes of a text in order; if it begins with `within P;`, they belong to the package P.

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
        failure = error.orig_exc
    except lark.exceptions.UnexpectedInput as error:
        failure = _sentence(error, source)
    raise failure from None


def _not_too_deep(classes: list[ClassText]) -> list[ClassText]:
    stack = [(item, 1) for item in classes]
    while stack:
        item, depth = stack.pop()
        if depth > DEEPEST:
            raise ModelicaError(f"more than {DEEPEST} nested classes", item.at)
        stack += [(inner, depth + 1) for inner in item.classes.values()]
    return classes


def read(path: str | os.PathLike[str]) -> list[ClassText]:
    """Return the classes of a file; see `parse`. Raises ModelicaError if it cannot be read."""
    return known(content_of(path), str(path))


def known(text: str, path: str) -> list[ClassText]:
    """As `parse`, from the cache if the same text was parsed before."""
    source = Source(path, text.removeprefix("\ufeff"))
    classes = trees.tree(source)
    if classes is None:
        classes = parse(text, path)
        trees.keep(source, classes)
    return classes


def content_of(path: str | os.PathLike[str]) -> str:
    """Return the text of a file. Raises ModelicaError if it cannot be read."""
    file = path_of(path)
    try:
        if not file.is_file():
            raise ModelicaError(
                f"{path} cannot be read: " + ("it is not a file" if file.exists() else "the file does not exist")
            )
        if file.stat().st_size > LARGEST:
            raise ModelicaError(f"{file.name} has {file.stat().st_size} bytes; the limit is {LARGEST}")
        content = file.read_bytes()
    except OSError as error:
        raise ModelicaError(f"{path} cannot be read: {error.strerror}") from None
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("latin-1")  # older files, mostly in comments


def _bounded(source: Source) -> None:
    """Raises ModelicaError for a text that is too long or nested too deep, and for unbalanced brackets."""
    if len(source.text) > LARGEST:
        raise ModelicaError(f"{source.name} has {len(source.text)} characters; the limit is {LARGEST}")
    opened: list[tuple[str, int]] = []
    line = 1
    for match in _SKIPPED.finditer(source.text):
        token = match[0]
        if token in "([{":
            opened.append((token, line))
            if len(opened) > DEEPEST:
                raise ModelicaError(f"more than {DEEPEST} nested brackets", Place(source, line, 1))
        elif token in _PAIRS:
            if not opened or opened[-1][0] != _PAIRS[token]:
                fault = f"'{opened[-1][0]}' of line {opened[-1][1]} is open" if opened else "none is open"
                column = match.start() - source.text.rfind("\n", 0, match.start())
                raise ModelicaError(f"'{token}' closes a bracket, but {fault}", Place(source, line, column))
            opened.pop()
        line += token.count("\n")


def _sentence(error: Any, source: Source) -> ModelicaError:
    """Return a syntax error of lark as a ModelicaError with a readable message."""
    line = error.line if isinstance(getattr(error, "line", None), int) and error.line > 0 else len(source.lines)
    column = error.column if isinstance(getattr(error, "column", None), int) and error.column > 0 else 1
    place = Place(source, line, column)
    token: Any = getattr(error, "token", None)
    if token is None:  # a character with which no token begins
        letter = source.lines[line - 1][column - 1 : column] if source.lines else ""
        hints = {
            "=": "",
            "&": "; write and",
            "|": "; write or",
            "!": "; write not or <>",
            '"': "; this string has no closing quotation mark",
        }
        return ModelicaError(f"'{letter}' in column {column} is not valid in Modelica{hints.get(letter, '')}", place)
    expected: set[str] = {_WORDS.get(str(name), str(name).lower()) for name in error.accepts or error.expected}
    if token.type == "$END":
        last = len(source.lines)
        return ModelicaError(f"the text ends too early; expected {_some(expected)}", Place(source, last, 1))
    if token.column == 1 or not source.lines[line - 1][: column - 1].strip():  # the first token of its line
        before = next((n for n in range(line - 1, 0, -1) if _code(source.lines[n - 1])), 0)
        if ";" in expected and before:
            return ModelicaError(f"'{token}' in line {line} follows a missing ';'", _end_of(source, before))
    hint = "; write == to compare" if str(token) == "=" and "then" in expected else ""
    if str(token) == ":=":
        hint = "; := is only allowed in an algorithm section; write = in an equation"
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
    """Return up to four expected tokens as text, likely ones first."""
    order = [";", "=", ")", "a name", "end", "then", "loop", "equation", ",", "]", "}"]
    first = [w for w in order if w in expected]
    rest = sorted(expected - set(first))
    return " or ".join((first + rest)[:4])
