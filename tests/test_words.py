"""Words that the field does not use are gone from names, texts and documents; the changelog keeps the old names."""

from __future__ import annotations

import ast
import re
import tokenize
from pathlib import Path

import pytest

CLONE = Path(__file__).parents[1]
MADE = ("notebooks", "project", "reference")  # by `make docs`, from other files
TEXTS = sorted(
    path
    for path in [CLONE / "README.md", CLONE / "ARCHITECTURE.md", *(CLONE / "docs").rglob("*.md"),
                 *(CLONE / "gtmodel").rglob("*.py")]
    if "conformance" not in path.name and path.parent.name not in MADE
)  # fmt: skip
RETIRED = {
    r"\bfreedoms\b": "degrees of freedom",
    r"(?<!of )(?<!of_)(?<!of-)\bfreedom\b(?!_)": "degrees of freedom",
    r"\bmade[-_ ]up\b": "synthetic",
    r"\bg[ia]ves? way\b|\bgiving way\b": "is compliant, deflects, yields",
    r"\b\w*roads?\b": "way, method, cross-check",
    r"\bwander\w*|\bWander\w*": "guideway errors",
    r"\bkinks?\b|\bKINK\w*": "corner, nonsmooth",
    r"\bmisreading\b": "misread columns",
    r"\b\w*_slopes\b": "jacobian, derivatives",
    r"\b[uU]ntold\b|\bUNTOLD\b": "undetermined",
}
MEANT = re.compile(r"^\s*(# )?freedom\b|\bbroads?\b")
"""What the patterns catch besides; "degrees of" may stand on the line before."""


@pytest.mark.parametrize("word", RETIRED)
def test_a_retired_word_is_not_used(word: str) -> None:
    pattern = re.compile(word)
    found = [
        f"{path.relative_to(CLONE)}:{n}: {line.strip()[:80]}"
        for path in TEXTS
        for n, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        if pattern.search(MEANT.sub("", line))
    ]
    assert not found, f"say {RETIRED[word]}: {found[:5]}"


SPOKEN = {"found", "told", "untold", "heard"}
"""What a name is to say is what it holds, not that somebody found it."""
OF_EACH_KIND = {"Schema"}
SOURCES = sorted((CLONE / "gtmodel").rglob("*.py"))


def test_names_say_what_they_hold() -> None:
    spoken = []
    for path in SOURCES:
        with path.open("rb") as file:
            spoken += [
                f"{path.relative_to(CLONE)}:{token.start[0]}: {token.string}"
                for token in tokenize.tokenize(file.readline)
                if token.type == tokenize.NAME and SPOKEN & set(token.string.lower().split("_"))
            ]
    assert not spoken, spoken[:5]


def test_no_two_classes_have_one_name() -> None:
    places: dict[str, list[str]] = {}
    for path in SOURCES:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_") and node.name not in OF_EACH_KIND:
                places.setdefault(node.name, []).append(f"{path.relative_to(CLONE)}:{node.lineno}")
    assert not {name: at for name, at in places.items() if len(at) > 1}
