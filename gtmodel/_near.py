"""Suggestions for a misspelt name or command line, to end an error message with."""

from __future__ import annotations

import difflib
from collections.abc import Collection, Iterable


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


def plain(sentence: str, words: list[str], commands: Collection[str]) -> str:
    """Error message about the command line, with a hint at the probable mistake."""
    sentence = sentence.replace(
        "Input should be a valid number, unable to parse string as a number", "expected a number"
    )
    if "extra argument" in sentence and "=" in words:
        place = words.index("=")
        return f"{sentence}; write {''.join(words[max(0, place - 1) : place + 2])}, without blanks around ="
    if "No such option" not in sentence:
        return sentence
    if words[0].startswith("-") and (command := next((w for w in words if w in commands), None)):
        return f"{sentence.partition(' (')[0]} here; options come after the command: gtmodel {command} ... {words[0]}"
    single = next(
        (w for w in words if len(w) > 2 and w[0] == "-" and w[1:].replace("-", "").isalpha() and w[1] != "-"), None
    )
    return f"{sentence}; an option has two dashes: -{single}" if single else sentence
