"""Suggestions for a misspelt name, to end an error message with."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


def meant(name: object, known: Iterable[str], otherwise: str = "", *, most: int = 1, cutoff: float = 0.6) -> str:
    """Return "did you mean 'a' or 'b'?" with at most `most` known names close to `name`; `otherwise` if none is close.

    >>> from gtmodel._near import meant
    >>> meant("lenght", ["length", "mass"], "it has length, mass")
    "did you mean 'length'?"
    """
    close = difflib.get_close_matches(str(name), list(known), n=most, cutoff=cutoff)
    return f"did you mean {' or '.join(map(repr, close))}?" if close else otherwise


def near(name: object, known: Iterable[str]) -> str:
    """Return "; did you mean 'a'?", or an empty string if no known name is close."""
    hint = meant(name, known)
    return f"; {hint}" if hint else ""
