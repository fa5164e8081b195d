"""The reference: a page for each library with every public object, made from the docstrings."""

from __future__ import annotations

import ast
import inspect
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gtmodel as gt
from gtmodel.results.options import Options, declared
from gtmodel.results.quantity import described
from gtmodel.results.study import Study

from .public_names import LIBRARIES, public

if TYPE_CHECKING:
    from sphinx.application import Sphinx

FOLDER = Path(__file__).parents[1] / "reference"
_HELD: dict[str, list[str]] = {}
_FIRST: dict[Any, str] = {}  # object -> the name under which it is described; others refer to it


def write(app: Sphinx) -> None:
    """A page for each library, and one that lists them."""
    shutil.rmtree(FOLDER, ignore_errors=True)
    FOLDER.mkdir()
    for library in ["", *LIBRARIES]:
        (FOLDER / f"{_file(library)}.rst").write_text("\n".join(page(library)) + "\n", encoding="utf-8")
    names = "\n".join(f"   {_file(library)}" for library in ["", *LIBRARIES])
    text = (
        "Reference\n=========\n\nEvery public name, from its docstring; the examples are run by the tests. "
        f"``import gtmodel as gt`` and ``import numpy as np`` stand above each.\n\n"
        f".. toctree::\n   :maxdepth: 1\n\n{names}\n"
    )
    (FOLDER / "index.rst").write_text(text, encoding="utf-8")


def _file(library: str) -> str:
    return f"gtmodel.{library}".rstrip(".")


def page(library: str) -> Iterator[str]:
    """The lines of the page of a library."""
    holder = gt
    for name in filter(None, library.split(".")):
        holder = getattr(holder, name)
    full, title = _file(library), _file(library).replace("gtmodel", "gt", 1)
    yield from (title, "=" * len(title), "")
    summary, _, table = (inspect.getdoc(holder) or "").partition("\n\n")
    yield from map(_plain_text, [*summary.splitlines(), ""])
    if re.search(r"\w {2,}\S", table):  # columns: names and what they are
        yield from ("::", "", *(f"   {line}" for line in table.splitlines()), "")
    else:
        yield from [*_lists(table.splitlines()), ""]
    items = public(library)
    at = {name: _FIRST.setdefault(item, f"{full}.{name}") for name, item in items.items()}
    again = sorted(name for name in items if at[name] != f"{full}.{name}")
    for heading, wanted in (("Functions", False), ("Classes", True)):
        names = sorted(name for name, item in items.items() if inspect.isclass(item) is wanted and name not in again)
        if names:
            yield from (heading, "-" * len(heading), "")
        for name in names:
            yield from ((f".. autoclass:: {full}.{name}", "   :members:", "") if wanted
                        else (f".. autofunction:: {full}.{name}", ""))  # fmt: skip

    if again:
        yield from ("Names of other pages that stand here too", "-" * 40, "")
        yield from (f"- ``{name}``: :py:obj:`{at[name]}`" for name in again)


def signature(app: Sphinx, what: str, name: str, item: Any, options: Any, text: str, returned: str) -> Any:
    """The signature as it is written, without what annotations carry besides the type."""
    if what not in ("function", "method", "class") or text is None:
        return None
    try:
        given = inspect.signature(item)
    except (TypeError, ValueError):
        return None
    parameters = [p.replace(annotation=_plain(p.annotation)) for p in given.parameters.values()]
    if what == "method" and parameters and parameters[0].name in ("self", "cls"):
        parameters = parameters[1:]
    plain = given.replace(parameters=parameters, return_annotation=inspect.Signature.empty)
    shown = "" if what == "class" else _plain(given.return_annotation)
    return str(plain), "" if shown in ("", inspect.Signature.empty) else str(shown)


class _Typed(str):
    """An annotation that is printed as it is."""

    def __repr__(self) -> str:
        return str(self)


def _plain(annotation: Any) -> Any:
    """`Annotated[float, Unit("N")]` -> `float`, of a text or of what it was evaluated to."""
    if annotation in (inspect.Parameter.empty, None):
        return annotation
    text = annotation if isinstance(annotation, str) else MODULES.sub("", inspect.formatannotation(annotation))
    try:
        tree = _Unwrapped().visit(ast.parse(text, mode="eval"))
    except SyntaxError:
        return annotation
    return _Typed(ast.unparse(tree))


class _Unwrapped(ast.NodeTransformer):
    def visit_Subscript(self, node: ast.Subscript) -> ast.AST:
        self.generic_visit(node)
        of = getattr(node.value, "attr", getattr(node.value, "id", ""))  # typing.Annotated too
        if of == "Annotated" and isinstance(node.slice, ast.Tuple):
            return node.slice.elts[0]
        return node


def kept_from_napoleon(app: Sphinx, what: str, name: str, item: Any, options: Any, lines: list[str]) -> None:
    """The first words of a property, up to a colon, are no type."""
    if what in ("property", "attribute"):
        _HELD[name] = list(lines)
        lines.clear()


def docstring(app: Sphinx, what: str, name: str, item: Any, options: Any, lines: list[str]) -> None:
    """Turns the lists of a docstring into lists, and adds to options and studies what their fields are."""
    lines[:] = _lists(_HELD.pop(name, lines))
    if what != "class":
        return
    if issubclass(item, Study) and item is not Study:
        lines += ["", "Quantities, attribute and what it is:", ""]
        rows = described(item)
        lines += [f"- ``{key}``{_in(q.file_unit)}: {_line(q.description)}" for key, q in rows.items()]
    elif issubclass(item, Options) and item is not Options:
        fields = declared(item)
        texts = {key: next((m for m in marks if isinstance(m, str)), "") for key, marks in fields.items()}
        units = {key: next((m.text for m in marks if hasattr(m, "written")), "") for key, marks in fields.items()}
        lines += ["", "Fields:", "", *(f"- ``{key}``{_in(units[key])}: {_line(texts[key])}" for key in fields)]


MODULES = re.compile(r"\b(?:gtmodel|collections|typing|numpy)(?:\.\w+)*\.(?=\w)")
ENTRY = re.compile(r"([a-z_]\w*(?:, \w+)*) ?: (\S.*)")
CODE = re.compile(r"(``?[^`]*``?)")


def _lists(lines: list[str]) -> Iterator[str]:
    """`name: text` lines with their continuations become a list; signs that mean something to Sphinx are text."""
    block: list[str] = []
    entries = 0
    for line in [*lines, ""]:
        if ENTRY.fullmatch(line) or (block and line.startswith("    ")):
            entries += not line.startswith(" ")
            block.append(line)
            continue
        if block and (entries > 1 or len(block) > 1):
            yield ""
            for held in block:
                item = ENTRY.fullmatch(held)
                yield f"- ``{item[1]}``: {_plain_text(item[2])}" if item else f"  {_plain_text(held.strip())}"
            yield ""
        else:
            yield from map(_plain_text, block)
        block, entries = [], 0
        yield line if line.lstrip().startswith((">>>", "...")) else _plain_text(line)


def _plain_text(line: str) -> str:
    """Stars and bars outside of code are multiplication and absolute values; letters may follow code: `Part`s."""
    parts = CODE.split(line)
    for k in range(2, len(parts), 2):
        parts[k] = re.sub(r"^(?=\w)", r"\\ ", parts[k])
    return "".join(p if i % 2 else re.sub(r"(?<!\\)[*|]", r"\\\g<0>", p) for i, p in enumerate(parts))


def _in(unit: str) -> str:
    return f" [{unit}]" if unit else ""


def _line(text: str) -> str:
    return " ".join(text.split()).replace("*", r"\*").replace("|", r"\|")
