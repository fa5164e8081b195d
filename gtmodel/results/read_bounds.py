"""Bounds of what is read: how deep JSON, TOML and XML may go, asked before anything else is, and how large data may
be."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar
from xml.parsers import expat

from .disk import PathLike

MOST_NESTED = 100  # lists and tables in one another, and parts of a dotted key
DEEPEST = 50  # elements of XML inside one another; those of a robot go seven deep, of a unit six
# texts and comments of TOML; what nothing closes goes up to the end of its line or of the file
_TEXTS = re.compile(
    r'"""(?:\\.|[^\\])*?(?:"""|\Z)|\'\'\'.*?(?:\'\'\'|\Z)|"(?:\\.|[^"\\\n])*"?|\'[^\'\n]*\'?|#[^\n]*', re.S
)
_LONG_KEY = re.compile(rf"(?<![\w-])(?:[\w-]+[ \t]*\.[ \t]*){{{MOST_NESTED}}}")
_INSIDE = (dict, list, tuple)
_T = TypeVar("_T")


class TooDeepError(ValueError):
    """Lists and tables stand in one another deeper than anything that gtmodel writes or asks for."""

    def __init__(self) -> None:
        super().__init__(
            f"holds lists or tables inside one another, more than {MOST_NESTED} deep; take levels out, nothing that "
            "gtmodel reads needs more than a few"
        )


def json_of(content: str | bytes) -> Any:
    """The data in a JSON text. Raises ValueError for what is none, TooDeepError among them.

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
    """The tables in a TOML text. Raises ValueError for what is none, TooDeepError and TOMLDecodeError among them.

    A key of very many parts is refused before the parser, whose time grows with their square.
    """
    if text.count(".") >= MOST_NESTED and _LONG_KEY.search(_TEXTS.sub("text", text)):
        raise TooDeepError
    try:
        data = tomllib.loads(text)
    except RecursionError:
        raise TooDeepError from None
    return not_deep(data)


def not_deep(data: _T) -> _T:
    """The same data. Raises TooDeepError where lists and tables stand too deep in one another."""
    level: list[Any] = [data]
    for _ in range(MOST_NESTED):
        inner = (x.values() if isinstance(x, dict) else x for x in level if isinstance(x, _INSIDE))
        level = [x for values in inner for x in values if isinstance(x, _INSIDE)]
        if not level:
            return data
    raise TooDeepError


class XmlFault(ValueError):
    """What is wrong with XML, and in which line."""

    def __init__(self, sentence: str, line: int) -> None:
        super().__init__(sentence)
        self.sentence, self.line = sentence, line


def walk_xml(
    content: bytes,
    begin: Callable[[str, dict[str, str], int], None] = lambda tag, attributes, line: None,
    end: Callable[[], None] = lambda: None,
) -> None:
    """Go through XML: `begin` takes tag, attributes and line of an element, `end` is called after what stands in it.

    Raises XmlFault for what is no XML, for elements too deep in one another and for declared entities, of which a few
    hundred bytes make gigabytes.
    """
    parser, depth = expat.ParserCreate(), 0

    def begins(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > DEEPEST:
            raise XmlFault(f"holds elements inside one another, more than {DEEPEST} deep", parser.CurrentLineNumber)
        begin(tag, attributes, parser.CurrentLineNumber)

    def ends(_: str) -> None:
        nonlocal depth
        depth -= 1
        end()

    def entity(*_: object) -> None:
        raise XmlFault(
            "declares an entity, which gtmodel does not read; put its text where it is used", parser.CurrentLineNumber
        )

    parser.StartElementHandler, parser.EndElementHandler, parser.EntityDeclHandler = begins, ends, entity
    try:
        parser.Parse(content, True)
    except expat.ExpatError as error:
        raise XmlFault(f"is no XML: {expat.ErrorString(error.code)}", error.lineno) from None


GROWTH, SMALL = 200.0, 1 << 28  # how many times larger than the file numbers may be; bytes that always may


def swollen(path: PathLike, size: float, most_growth: float = GROWTH) -> str:
    """What is said of data of so many bytes in this file, "" where it may hold them."""
    own = Path(path).stat().st_size
    if size <= max(SMALL, most_growth * own):
        return ""
    times = size / max(own, 1)
    most = f"expected at most {most_growth:g} times"
    return f"would take {size / 1e6:.4g} MB, {times:.3g} times the size of the file; {most}"
