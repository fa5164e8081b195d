"""Words that the field does not use are gone from names, texts and documents; the changelog keeps the old names."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path

import pytest

from tests.support import sources

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
        for path, text in without_what_is_meant().items()
        if pattern.search(text)
        for n, line in enumerate(text.split("\n"), 1)
        if pattern.search(line)
    ]
    assert not found, f"say {RETIRED[word]}: {found[:5]}"


@cache
def without_what_is_meant() -> dict[Path, str]:
    """The texts line by line, without what the patterns catch besides."""
    return {path: "\n".join(MEANT.sub("", line) for line in path.read_text(encoding="utf-8").splitlines())
            for path in TEXTS}  # fmt: skip


SPOKEN = {"found", "told", "untold", "heard"}
"""What a name is to say is what it holds, not that somebody found it."""
OF_EACH_KIND = {"Schema"}
NAMED_BY = {
    ast.Name: "id", ast.Attribute: "attr", ast.arg: "arg", ast.keyword: "arg", ast.FunctionDef: "name",
    ast.AsyncFunctionDef: "name", ast.ClassDef: "name", ast.ExceptHandler: "name", ast.ImportFrom: "module",
    ast.Global: "names", ast.Nonlocal: "names", ast.MatchAs: "name", ast.MatchStar: "name", ast.MatchMapping: "rest",
    ast.MatchClass: "kwd_attrs",
}  # fmt: skip
"""Where the nodes of a syntax tree hold names; those of imports hold two."""


def names(nodes: Iterable[ast.AST]) -> Iterator[tuple[str, int]]:
    """Every name of a module with its line."""
    for node in nodes:
        if isinstance(node, ast.alias):
            yield from ((part, node.lineno) for part in f"{node.name}.{node.asname or ''}".split("."))
        elif (field := NAMED_BY.get(type(node))) and (held := getattr(node, field)):
            for name in held if isinstance(held, list) else held.split("."):
                yield name, getattr(node, "lineno", 0)


@cache
def is_spoken(name: str) -> bool:
    return bool(SPOKEN & set(name.lower().split("_")))


def test_names_say_what_they_hold() -> None:
    spoken = [f"{path.relative_to(CLONE)}:{line}: {name}" for path, nodes in sources.house().items()
              for name, line in names(nodes) if is_spoken(name)]  # fmt: skip
    assert not spoken, spoken[:5]


HOLDING = """
import a.found_1, b as found_2
from c.found_3 import found_4 as found_5
class Found_6(metaclass=M, found_7=1):
    async def found_8(self, *found_9, **found_10): self.found_11.x = f(found_12=1)
def found_13(found_14, /, *, found_15: found_16):
    global found_17
    def inner():
        nonlocal found_18
    try:
        f"{found_19}"
    except E as found_20:
        pass
    match found_21:
        case [K(found_22=1), *found_23] as found_24: pass
        case {1: 1, **found_25}: pass
        case found_26: pass
    (found_27 := 1)
    for found_28 in lambda found_29: 1: pass
"found", found.is_("found")  # found
"""


def test_every_name_is_read() -> None:
    read = {name.lower() for name, _ in names(ast.walk(ast.parse(HOLDING))) if is_spoken(name)}
    assert read == {"found", *(f"found_{n}" for n in range(1, 30))}


def test_no_two_classes_have_one_name() -> None:
    places: dict[str, list[str]] = {}
    for path, nodes in sources.house().items():
        for node in nodes:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_") and node.name not in OF_EACH_KIND:
                places.setdefault(node.name, []).append(f"{path.relative_to(CLONE)}:{node.lineno}")
    assert not {name: at for name, at in places.items() if len(at) > 1}
