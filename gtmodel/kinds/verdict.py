"""The verdict on a result: which of its checks failed, in one sentence, and how files of it are marked."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path, PurePath
from typing import Any

from .units import split

_DIGITS, _ALL = 6, 17  # of a number in a sentence; that tell any two numbers apart

_MARK = "NOT TO BE USED"
_LONGEST = 4096  # bytes of a first line that are looked at: a measured file may be one line of many megabytes
# how a file of this ending says something in its first line; all readers of these formats pass over it
_COMMENT = {
    ".csv": ("# ", ""),
    ".toml": ("# ", ""),
    ".mod": ("! ", ""),
    ".c": ("/* ", " */"),
    ".h": ("/* ", " */"),
}


def failed_of(checks: Mapping[str, Any]) -> dict[str, Any]:
    """The checks that failed, by name."""
    return {name: check for name, check in checks.items() if not check.passed}


def verdict(failed: Mapping[str, Any], count: int) -> str:
    """One sentence: which of `count` checks failed with value and bound, and what to do."""
    told = ", ".join(f"{name} ({_numbers(name, check)})" for name, check in failed.items())
    text = f"{len(failed)} of {count} checks failed: {told}"
    advice = list(dict.fromkeys(a for check in failed.values() if (a := getattr(check, "advice", ""))))
    return "; ".join([text, *advice])


def _numbers(name: str, check: Any) -> str:
    _, unit = split(name)
    unit = f" {unit}" if unit else ""
    value = "no value" if check.value is None else f"{check.value:.{_digits(check)}g}{unit}"
    if check.bound is None:
        return value
    return f"{value}, {bound_in_words(check)}{unit}"


def bound_in_words(check: Any) -> str:
    """ "at most 0.005", with as many digits as tell the value from the bound."""
    word = "at least" if getattr(check, "least", False) else "at most"
    return f"{word} {check.bound:.{_digits(check)}g}"


def _digits(check: Any) -> int:
    """Six, or as many as tell a value from a bound that it just misses."""
    if check.value is None or check.bound is None or check.value == check.bound:
        return _DIGITS
    alike = (n for n in range(_DIGITS, _ALL) if f"{check.value:.{n}g}" != f"{check.bound:.{n}g}")
    return next(alike, _ALL)


def told(outcome: Any) -> str:
    """What an outcome says of itself in a sentence, for the files that must say it too."""
    return str(outcome.message or outcome.status.sentence)


def marked(name: str, content: bytes, message: str, by: str = ", written by --write-failed") -> bytes:
    """A file for a machine whose result must not be relied on: its first line says so. Nothing else changes.

    Raises ValueError for an ending that has no comment here: such a file cannot be marked.
    """
    try:
        before, after = _COMMENT[PurePath(name).suffix]
    except KeyError:
        raise ValueError(f"{name}: no comment is known for files of this ending") from None
    said = " ".join(message.split()).replace("*/", "* /").replace("/*", "/ *")
    line = f"{before}{_MARK}{by}: {said}{after}"
    return line.encode() + b"\n" + content


def is_marked(path: Path) -> bool:
    """True for a file that says of itself that it must not be relied on; False for what cannot be read."""
    try:
        with open(path, "rb") as file:
            return _MARK.encode() in file.readline(_LONGEST)
    except OSError:
        return False
