"""Read a text file in blocks of lines, for any encoding and line ending."""

from __future__ import annotations

import codecs
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from .form import LogError, LogForm, shown

BLOCK = 1 << 18  # bytes
LONGEST_LINE = 1 << 25  # characters; a million columns take less
_MARKS = ((codecs.BOM_UTF8, "utf-8-sig"), (codecs.BOM_UTF16_LE, "utf-16"), (codecs.BOM_UTF16_BE, "utf-16"))
COMMENTS = ("#", "%", "//")
_ERROR_CELL = re.compile(r"#(N/A|NUM!|DIV/0!|VALUE!|REF!|NAME\?|NULL!)", re.IGNORECASE)  # of a spreadsheet


class Chunk(NamedTuple):
    """Lines without line endings, the number of the first in the file, and the fraction of the file read so far."""

    first: int
    lines: list[str]
    text: str
    fraction: float
    ended: bool  # the last line has a line ending


def encoding_of(path: Path, form: LogForm) -> str:
    """Return the encoding of the byte-order mark, else of `form`, else UTF-8. Raises LogError if it is unknown."""
    with open(path, "rb") as file:
        head = file.read(4)
    marked = next((name for mark, name in _MARKS if head.startswith(mark)), None)
    try:
        codecs.lookup(form.encoding or "utf-8")
    except LookupError:
        raise LogError(f"there is no encoding '{form.encoding}'; expected one such as cp1252 or utf-16") from None
    return marked or form.encoding or "utf-8"


def chunks(path: Path, encoding: str, size: int = BLOCK) -> Iterator[Chunk]:
    """Yield the lines of a text file. Raises LogError if it is not text in this encoding."""
    decoder = codecs.getincrementaldecoder(encoding)("strict")
    total = max(path.stat().st_size, 1)
    number, rest, single = 1, "", None
    with open(path, "rb") as file:
        while True:
            data = file.read(size)
            try:
                text = rest + decoder.decode(data, final=not data)
            except UnicodeDecodeError as error:
                line = number + rest.count("\n") + data[: error.start].count(b"\n")
                raise LogError(
                    f"{shown(path)} line {line} is not {encoding.removesuffix('-sig').upper()} text ({error.reason}); "
                    'save it as UTF-8, or, if an older Windows program wrote it, set encoding = "cp1252"'
                ) from error
            if "\0" in text:
                raise LogError(
                    f"{shown(path)} line {number + text[: text.index(chr(0))].count(chr(10))} contains a zero byte, so "
                    "it is not a text file; save the table as CSV"
                )
            if "\r" in text:
                single = "\n" not in text if single is None else single
                open_return = text.endswith("\r") and bool(data)  # the line feed may follow in the next block
                text = (text[:-1] if open_return else text).replace("\r\n", "\n")
                if single:
                    text = text.replace("\r", "\n")
                elif "\r" in text:
                    line = number + text[: text.index("\r")].count("\n")
                    raise LogError(
                        f"{shown(path)} line {line} contains a carriage return within the line; save the file with "
                        "line feeds"
                    )
            else:
                open_return = False
            lines = text.split("\n")
            rest = lines.pop() if data else ""
            if len(rest) > LONGEST_LINE:
                raise LogError(
                    f"{shown(path)} line {number + len(lines)} is longer than {LONGEST_LINE >> 20} million characters: "
                    "the file is not a table, or it lacks line endings"
                )
            if data and rest:
                text = text[: -len(rest)]
            if open_return:
                rest += "\r"
            ended = bool(data) or not lines or lines[-1] == ""
            if not data and lines and lines[-1] == "":
                lines.pop()
            if lines:
                yield Chunk(number, lines, text, min(1.0, file.tell() / total), ended)
            number += len(lines)
            if not data:
                return


def is_row(line: str) -> bool:
    """Return whether a line is neither blank nor a comment; "#N/A" in the first cell is not a comment."""
    if line.startswith(COMMENTS):
        return _ERROR_CELL.match(line) is not None
    return bool(line) and not line.isspace()
