"""Limits for input: nesting depth of JSON, TOML and XML, tested before anything else, and size of unpacked data."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar
from xml.parsers import expat

from .disk import PathLike

MOST_NESTED = 100  # levels of nested lists and tables, and parts of a dotted key
DEEPEST = 50  # levels of nested XML elements; a robot has seven, a unit six
# texts and comments of TOML; an unclosed text ends with its line or with the file
_TEXTS = re.compile(
    r'"""(?:\\.|[^\\])*?(?:"""|\Z)|\'\'\'.*?(?:\'\'\'|\Z)|"(?:\\.|[^"\\\n])*"?|\'[^\'\n]*\'?|#[^\n]*', re.S
)
_LONG_KEY = re.compile(rf"(?<![\w-])(?:[\w-]+[ \t]*\.[ \t]*){{{MOST_NESTED}}}")
_INSIDE = (dict, list, tuple)
_T = TypeVar("_T")


class TooDeepError(ValueError):
    """Lists and tables are nested deeper than in any file of gtmodel."""

    def __init__(self) -> None:
        super().__init__(
            f"has lists or tables nested more than {MOST_NESTED} deep; remove levels: no file of gtmodel needs more "
            "than a few"
        )


def json_of(content: str | bytes) -> Any:
    """Parse a JSON text. Raises ValueError if it is not JSON, or its subclass TooDeepError.

    >>> from gtmodel.results.read_bounds import json_of
    >>> json_of('{"a": [1, 2]}')
    {'a': [1, 2]}
    """
    try:
        data = json.loads(content)
    except RecursionError:
        raise TooDeepError from None
    return not_deep(data)


def toml_of(text: str) -> dict[str, Any]:
    """Parse a TOML text. Raises ValueError if it is not TOML: TOMLDecodeError or TooDeepError.

    A key with very many parts is refused first, because the parser's time grows with their square.
    """
    if text.count(".") >= MOST_NESTED and _LONG_KEY.search(_TEXTS.sub("text", text)):
        raise TooDeepError
    try:
        data = tomllib.loads(text)
    except RecursionError:
        raise TooDeepError from None
    return not_deep(data)


def not_deep(data: _T) -> _T:
    """Return the data unchanged. Raises TooDeepError if lists and tables are nested too deep."""
    level: list[Any] = [data]
    for _ in range(MOST_NESTED):
        inner = (x.values() if isinstance(x, dict) else x for x in level if isinstance(x, _INSIDE))
        level = [x for values in inner for x in values if isinstance(x, _INSIDE)]
        if not level:
            return data
    raise TooDeepError


class XmlFault(ValueError):
    """An error in XML, with its line."""

    def __init__(self, sentence: str, line: int) -> None:
        super().__init__(sentence)
        self.sentence, self.line = sentence, line


def walk_xml(
    content: bytes,
    begin: Callable[[str, dict[str, str], int], None] = lambda tag, attributes, line: None,
    end: Callable[[], None] = lambda: None,
    text: Callable[[str], None] = lambda text: None,
) -> None:
    """Walk through XML: call `begin` with tag, attributes and line of each element, `text` with parts of its text, and
    `end` after its content.

    Raises XmlFault for invalid XML, for elements nested too deep and for declared entities, which can expand from a few
    hundred bytes to gigabytes.
    """
    parser, depth = expat.ParserCreate(), 0

    def begins(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > DEEPEST:
            raise XmlFault(f"has elements nested more than {DEEPEST} deep", parser.CurrentLineNumber)
        begin(tag, attributes, parser.CurrentLineNumber)

    def ends(_: str) -> None:
        nonlocal depth
        depth -= 1
        end()

    def entity(*_: object) -> None:
        raise XmlFault(
            "declares an entity, which gtmodel does not read; replace its uses by its text", parser.CurrentLineNumber
        )

    parser.StartElementHandler, parser.EndElementHandler, parser.EntityDeclHandler = begins, ends, entity
    parser.CharacterDataHandler = text
    try:
        parser.Parse(content, True)
    except expat.ExpatError as error:
        raise XmlFault(f"is not XML: {expat.ErrorString(error.code)}", error.lineno) from None


GROWTH, SMALL = 200.0, 1 << 28  # largest unpacked size as a multiple of the file size; bytes that are always allowed


def swollen(path: PathLike, size: float, most_growth: float = GROWTH) -> str:
    """Return an error message if a file would unpack to too many bytes, otherwise ""."""
    stored = Path(path).stat().st_size
    if size <= max(SMALL, most_growth * stored):
        return ""
    times = size / max(stored, 1)
    most = f"expected at most {most_growth:g} times"
    return f"would take {size / 1e6:.4g} MB, {times:.3g} times the size of the file; {most}"
