"""Where a person wrote a declaration: file and line, quoted in every model error."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

_LANG = str(Path(__file__).resolve().parent)


@dataclass(frozen=True, order=True)
class SourceLocation:
    """File name (last two path parts) and line of a declaration or an equation."""

    file: str
    line: int

    def __str__(self) -> str:
        return f"{self.file}:{self.line}"


def _short(filename: str) -> str:
    """The last two parts of a path: enough to find the file, the same on every machine."""
    if filename.startswith("<"):
        return filename
    parts = Path(filename).parts
    return "/".join(parts[-2:])


def here() -> SourceLocation:
    """Location of the innermost calling frame outside the language package itself."""
    frame = sys._getframe(1)
    while frame.f_back is not None and frame.f_code.co_filename.startswith(_LANG):
        frame = frame.f_back
    return SourceLocation(_short(frame.f_code.co_filename), frame.f_lineno)


def of_frame(filename: str, line: int) -> SourceLocation:
    """Location from a code object's file name and a line number."""
    return SourceLocation(_short(filename), line)


class ModelError(ValueError):
    """A model is wrong: the sentence says what was found, what was expected and where it was written."""

    def __init__(self, sentence: str, where: SourceLocation | None = None) -> None:
        super().__init__(f"{sentence} ({where})" if where is not None else sentence)
        self.where = where
