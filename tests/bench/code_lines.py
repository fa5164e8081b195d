"""Lines of code by package, without docstrings, comments and blank lines; modules, and functions of many arguments.

python tests/bench/code_lines.py [TREE]
"""

from __future__ import annotations

import ast
import io
import sys
import tokenize
from collections import Counter
from pathlib import Path

SILENT = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}
MANY = 8  # arguments, that of the object itself apart
DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


def code_lines(text: str) -> int:
    """How many lines of a Python file hold code."""
    nodes = [n for n in ast.walk(ast.parse(text)) if isinstance(n, DOCUMENTED)]
    told = [n.body[0] for n in nodes if ast.get_docstring(n) is not None]
    words = {k for n in told for k in range(n.lineno, (n.end_lineno or n.lineno) + 1)}
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    return len({k for t in tokens if t.type not in SILENT for k in range(t.start[0], t.end[0] + 1)} - words)


def many_arguments(text: str) -> int:
    """How many functions of a Python file take `MANY` arguments or more."""
    functions = [n.args for n in ast.walk(ast.parse(text)) if isinstance(n, DOCUMENTED[2:])]
    taken = [[*a.posonlyargs, *a.args, *a.kwonlyargs, *filter(None, (a.vararg, a.kwarg))] for a in functions]
    return sum(len(names) - (names[0].arg in ("self", "cls")) >= MANY for names in taken if names)


def main(tree: Path) -> None:
    found: Counter[str] = Counter()
    texts = {path: path.read_text() for path in sorted((tree / "gtmodel").rglob("*.py"))}
    for path, text in texts.items():
        parts = path.relative_to(tree / "gtmodel").parts
        found[parts[0] if len(parts) > 1 else "."] += code_lines(text)
    for name, count in sorted(found.items()):
        print(f"{name:16s}{count:7d}")
    print(f"{'total':16s}{found.total():7d}")
    print(f"{len(texts)} modules; {sum(map(many_arguments, texts.values()))} functions of {MANY} and more arguments")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "."))
