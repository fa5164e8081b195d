"""Sample sentences of pages, docstrings and messages for readers who have never seen gtmodel.

python tests/bench/draw_sentences.py SEED [TREE]

34, 33 and 33 of them, a line each: kind, tab, where it stands, tab, sentence. The place is what a person sees
beside the sentence: the page's title, the name of the documented object, the module of a message.
"""

from __future__ import annotations

import ast
import random
import re
import sys
from collections.abc import Iterator
from pathlib import Path

COUNTS = {"page": 34, "docstring": 33, "message": 33}
WORDS = range(6, 46)
END = re.compile(r"(?<=[.!?])\s+(?=[A-Z`\"0-9])")
DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef)


def sentences(text: str) -> Iterator[str]:
    for sentence in END.split(" ".join(text.split())):
        bare = sentence.strip(" -*|>")
        if len(bare.split()) in WORDS and re.search(r"[a-z]{3}", bare):
            yield bare


def of_page(text: str) -> Iterator[str]:
    prose = re.sub(r"```.*?```", "\n\n", text, flags=re.S)
    for block in re.split(r"\n\s*\n|\n(?=\s*[-*] )", prose):
        if not block.lstrip().startswith(("#", "|", ":", "[", "<", "{")):
            yield from sentences(block)


def of_docstring(text: str) -> Iterator[str]:
    for block in re.split(r"\n\s*\n", text):
        if ">>>" not in block:
            for entry in re.split(r"\n(?=\s+[\w, ]+: )", block):
                yield from sentences(re.sub(r"^\s*(Args|Returns|Raises|Attributes):\s", "", entry))


def of_module(text: str, module: str) -> Iterator[tuple[str, str, str]]:
    """Kind, place and text of docstrings and of other strings; `{...}` stands for a value in a message."""
    tree, done = ast.parse(text), set()
    for node in ast.walk(tree):
        if isinstance(node, DOCUMENTED) and (doc := ast.get_docstring(node)):
            done.add(id(node.body[0].value))  # type: ignore[attr-defined]
            name = f"{module}: {node.name}" if not isinstance(node, ast.Module) else module
            yield from (("docstring", name, s) for s in of_docstring(doc))
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            done |= {id(part) for part in node.values}
            parts = [str(p.value) if isinstance(p, ast.Constant) else "{...}" for p in node.values]
            yield from (("message", module, s) for s in sentences("".join(parts)))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in done:
            yield from (("message", module, s) for s in sentences(node.value) if "\n" not in node.value)


def main(seed: int, tree: Path) -> None:
    pools: dict[str, dict[str, str]] = {kind: {} for kind in COUNTS}
    for path in [*tree.glob("*.md"), *(tree / "docs").rglob("*.md")]:
        if path.name != "CHANGELOG.md":
            title = re.search(r"^# (.+)", path.read_text(), re.M)
            pools["page"].update((s, title[1] if title else path.name) for s in of_page(path.read_text()))
    for path in (tree / "gtmodel").rglob("*.py"):
        module = ".".join(path.relative_to(tree).with_suffix("").parts).removesuffix(".__init__")
        for kind, where, sentence in of_module(path.read_text(), module):
            pools[kind].setdefault(sentence, where)
    draw = random.Random(seed)
    for kind, count in COUNTS.items():
        for sentence in draw.sample(sorted(pools[kind]), count):
            print(f"{kind}\t{pools[kind][sentence]}\t{sentence}")


if __name__ == "__main__":
    main(int(sys.argv[1]), Path(sys.argv[2] if len(sys.argv) > 2 else "."))
