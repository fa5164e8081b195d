"""Text that is safe inside C: comments, numbers, lines of one width; and the error of what cannot become such text."""

from __future__ import annotations

import textwrap

from ..results.refusal import ArgumentError

WIDTH = 110


class GenerationError(ArgumentError):
    """Code that cannot be generated, written or compared; the message is one plain sentence."""


def comment_safe(text: str) -> str:
    """One line of ASCII that cannot end a comment or continue a line."""
    line = " ".join(text.split()).replace("*/", "* /").replace("/*", "/ *").replace("??/", "?? /")
    return line.encode("ascii", "backslashreplace").decode("ascii").rstrip("\\")


def comment(lines: list[str], indent: str = "") -> str:
    """A block comment of wrapped paragraphs; an empty paragraph is an empty line."""
    width = WIDTH - len(indent) - 3
    wrapped: list[str] = []
    for line in lines:
        safe = comment_safe(line)
        hang = "  " if line.startswith("- ") else ""
        wrapped += textwrap.wrap(safe, width, subsequent_indent=hang, break_long_words=False) or [""]
    if len(wrapped) == 1:
        return f"{indent}/* {wrapped[0]} */\n"
    first, *rest = wrapped
    body = "".join(f"{indent} * {line}".rstrip() + "\n" for line in rest)
    return f"{indent}/* {first}\n{body}{indent} */\n"


def hexadecimal(value: float) -> str:
    """A double as a C constant with all its bits; NAN and INFINITY by their names in math.h."""
    if value != value:
        return "NAN"
    if value in (float("inf"), float("-inf")):
        return "INFINITY" if value > 0 else "-INFINITY"
    return value.hex()


def decimal(value: float) -> str:
    """A double as the shortest decimal constant that reads back as the same double."""
    return repr(float(value))
