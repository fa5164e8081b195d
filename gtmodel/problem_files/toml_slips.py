"""A line that is no TOML: what a person most likely mistyped there."""

from __future__ import annotations

import re

_NUMBER = r"=\s*[-+]?"
# the first that is found in the line stands in the sentence; a quoted text is left out for those below the quotes
_QUOTES = (
    (r"[“”„‘’»«]", "a text stands in straight quotes, \"text\" or 'text'"),
    (r"^[^'#]*\\", "a path is written with /, or in single quotes, where a backslash stands for itself"),
    (r'^[^"#]*"[^"]*$|^[^\'#]*\'[^\']*$', "a quote is missing"),
)
_SLIPS = (
    (r"^\s*[\w.]+\s*:", "a key is set with =, not with a colon"),
    (r"==", "a key is set with one ="),
    (_NUMBER + r"\d+,\d", "a number is written with a decimal point"),
    (_NUMBER + r"0\d", "a number has no zero in front"),
    (_NUMBER + r"(\d+\.(?!\d)|\.\d)", "a number has a digit on both sides of its point"),
    (_NUMBER + r"[\d.]+(e[-+]?\d+)?\s*[^\W\d_]", "a number stands without its unit, which the key says"),
    (r"=\s*(True|False)\b", "true and false are written in small letters"),
    (r"=\s*(None|null|nil|NULL)?\s*(#|$)", "a key without a value is left out"),
    (r"\s//|\s/\*|\s;", "a comment begins with #"),
    (r"=\s*[^\W\d]", "a text stands in quotes"),
)
_REASONS = (
    (r"overwrite a value", "the key is there twice"),
    (r"[Cc]annot declare", "the table is there twice"),
)


def slip(line: str, reason: str) -> str:
    """The likely slip in a line that a parser refused for `reason`; the reason itself where none is seen.

    >>> from gtmodel.problem_files.toml_slips import slip
    >>> slip("payload_kg = 5,0", "Expected newline")
    'a number is written with a decimal point'
    """
    bare = re.sub(r'"[^"]*"|\'[^\']*\'', '""', line)
    for text, table in ((reason, _REASONS), (line, _QUOTES), (bare, _SLIPS)):
        for pattern, sentence in table:
            if re.search(pattern, text):
                return sentence
    return f"{reason[:1].lower()}{reason[1:]}"


def shown_line(line: str) -> str:
    """A line of a file as it may stand in a sentence."""
    text = line if line.isprintable() else repr(line)[1:-1]
    return f"'{text}'" if len(text) <= 60 else f"'{text[:57]}...'"
