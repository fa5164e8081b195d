"""Which name was meant, for the end of a sentence about one that is not there."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


def meant(name: object, known: Iterable[str], otherwise: str = "", *, most: int = 1, cutoff: float = 0.6) -> str:
    """ "did you mean 'a' or 'b'?" of at most `most` known names that are close to `name`; `otherwise` where none is.

    >>> from gtmodel._near import meant
    >>> meant("lenght", ["length", "mass"], "it has length, mass")
    "did you mean 'length'?"
    """
    close = difflib.get_close_matches(str(name), list(known), n=most, cutoff=cutoff)
    return f"did you mean {' or '.join(map(repr, close))}?" if close else otherwise


def near(name: object, known: Iterable[str]) -> str:
    """The same behind a semicolon, "; did you mean 'a'?", or nothing."""
    hint = meant(name, known)
    return f"; {hint}" if hint else ""
