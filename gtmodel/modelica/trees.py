"""Syntax trees as plain lists for JSON, and a cache of the trees of parsed files in the user's cache folder."""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
import os
import tempfile
import time
import zlib
from collections.abc import Callable
from dataclasses import fields
from functools import cache
from pathlib import Path
from typing import Any, cast

from .._version import __version__
from ..compiler.toolchain import CompilerMissing, cache_folder, exposed
from . import syntax as s
from .syntax import ClassText, Place, ReferencePart, Source, SyntaxNode

# sorted by name, so that the numbers do not depend on the order of definition
_NODES: list[type[Any]] = sorted(
    (c for c in vars(s).values() if isinstance(c, type) and issubclass(c, SyntaxNode) and c is not SyntaxNode),
    key=lambda c: c.__name__,
)
_NUMBERS = {c: n for n, c in enumerate(_NODES)}
_CLASS = _NUMBERS[ClassText]
_FIELDS = {c: [f.name for f in fields(c) if f.name not in ("at", "scope")] for c in _NODES}
# levels; files of the Modelica Standard Library 4.0 have up to 71
DEEPEST = 150
_LIST, _TUPLE, _WORDS, _NAMES, _PART = -1, -2, -3, -4, -5


def packed(x: Any, depth: int = 0) -> Any:
    """Return a tree, or a list of trees, as lists, strings and numbers.

    The `scope` of a class, its enclosing class, is omitted, since the position determines it. Raises TypeError for
    other objects, RecursionError for a tree deeper than DEEPEST.
    """
    if x is None or isinstance(x, (bool, int, float)):
        return x
    if isinstance(x, str):
        return str(x)
    if depth > DEEPEST:
        raise RecursionError
    if isinstance(x, SyntaxNode):
        kind = type(x)
        return [_NUMBERS[kind], x.at.line, x.at.column, *[packed(getattr(x, n), depth + 1) for n in _FIELDS[kind]]]
    if isinstance(x, ReferencePart):
        return [_PART, x.name, packed(x.subscripts, depth + 1)]
    if isinstance(x, (list, tuple)):
        kind = _LIST if isinstance(x, list) else _TUPLE
        return [kind, *[packed(e, depth + 1) for e in cast("list[Any]", x)]]
    if isinstance(x, frozenset):
        return [_WORDS, *sorted(cast("frozenset[str]", x))]
    if isinstance(x, dict):
        return [_NAMES, *[e for k, v in cast("dict[str, Any]", x).items() for e in (str(k), packed(v, depth + 1))]]
    raise TypeError(f"{type(x).__name__} is not part of a syntax tree")


def unpacked(plain: Any, source: Source) -> Any:
    """Return the tree from which `packed` made a list, for a file. Raises an exception for invalid data."""

    def tree(x: list[Any]) -> Any:
        kind = x[0]
        if kind >= 0:
            if kind == _CLASS:
                return of_class(x)
            return _NODES[kind](Place(source, x[1], x[2]), *[tree(e) if type(e) is list else e for e in x[3:]])
        if kind == _PART:
            return ReferencePart(x[1], tree(x[2]) if x[2] is not None else None)
        if kind == _NAMES:
            return {x[k]: tree(x[k + 1]) if type(x[k + 1]) is list else x[k + 1] for k in range(1, len(x), 2)}
        if kind == _WORDS:
            return frozenset(x[1:])
        items = [tree(e) if type(e) is list else e for e in x[1:]]
        return items if kind == _LIST else tuple(items)

    def of_class(x: list[Any], scope: ClassText | None = None) -> ClassText:
        values = zip(_FIELDS[ClassText], x[3:], strict=True)
        inside: dict[str, Any] = {n: tree(e) if type(e) is list and n != "classes" else e for n, e in values}
        item = ClassText(Place(source, x[1], x[2]), **inside, scope=scope)
        item.classes = _Inner(inside["classes"], lambda inner: of_class(inner, item))
        return item

    return tree(plain)


class _Inner(dict[str, ClassText]):
    """Local classes of a class, each unpacked when first accessed: few of a large package are used."""

    def __init__(self, plain: list[Any], unpack: Callable[[list[Any]], ClassText]) -> None:
        super().__init__(zip(plain[1::2], plain[2::2], strict=True))
        self._made = unpack

    def __getitem__(self, name: str) -> ClassText:
        item: Any = super().__getitem__(name)
        if isinstance(item, list):
            item = self[name] = self._made(cast("list[Any]", item))
        return item

    def get(self, name: str, default: Any = None) -> Any:
        return self[name] if name in self else default  # noqa: SIM401 - of itself

    def values(self) -> Any:
        return [self[name] for name in self]

    def items(self) -> Any:
        return [(name, self[name]) for name in self]


# characters; a shorter text is parsed faster than its tree is loaded
SHORTEST = 2_000
# bytes of all trees; the whole Modelica Standard Library needs 5 MB
LARGEST = 64_000_000
# seconds after which use of a tree updates its time
TOUCHED = 3600.0
_ENDING = ".tree"
_DEFINED_BY = ("grammar.lark", "reader.py", "shape.py", "syntax.py", "trees.py")


def folder() -> Path | None:
    """Return the folder of trees and parser tables; None if there is no folder that only this user can write."""
    try:
        place = cache_folder() / "modelica"
        place.parent.mkdir(parents=True, exist_ok=True)
        place.mkdir(mode=0o700, exist_ok=True)
        if exposed(place):
            return None
        with tempfile.TemporaryFile(dir=place):
            return place
    except (OSError, CompilerMissing):
        return None


@cache
def version() -> str:
    """Return a hash of the versions of gtmodel and lark, the grammar, and the modules that make trees."""
    parts = [__version__.encode(), importlib.metadata.version("lark").encode()]
    parts += [Path(__file__).with_name(name).read_bytes() for name in _DEFINED_BY]
    return hashlib.sha256(b"\0".join(parts)).hexdigest()


def _place(text: str) -> Path | None:
    where = folder() if len(text) >= SHORTEST else None
    if where is None:
        return None
    key = hashlib.sha256(f"{version()}\0{text}".encode(errors="surrogatepass")).hexdigest()
    return where / f"{key[:32]}{_ENDING}"


def tree(source: Source) -> list[ClassText] | None:
    """Return the classes of a text from the cache; None if they are not there, or if their file is damaged."""
    place = _place(source.text)
    if place is None:
        return None
    try:
        if exposed(place):
            return None
        content = place.read_bytes()
        digest, _, body = content.partition(b"\n")
        if hashlib.sha256(body).hexdigest().encode() != digest:
            return None
        result: Any = unpacked(json.loads(zlib.decompress(body)), source)
        if time.time() - place.stat().st_mtime > TOUCHED:
            os.utime(place)
    except (OSError, ValueError, TypeError, LookupError, zlib.error, RecursionError):
        return None
    return result


def keep(source: Source, classes: list[ClassText]) -> None:
    """Store the classes of a text in the cache, completely or not at all; silent if it cannot be written."""
    place = _place(source.text)
    if place is None:
        return
    try:
        body = zlib.compress(json.dumps(packed(classes), separators=(",", ":")).encode(), 1)
    except (TypeError, RecursionError):
        return
    beside = ""
    try:
        # write beside the target, then rename: another process sees a complete tree or none
        with tempfile.NamedTemporaryFile(dir=place.parent, prefix="new-", suffix=_ENDING, delete=False) as file:
            beside = file.name
            file.write(hashlib.sha256(body).hexdigest().encode() + b"\n" + body)
        os.replace(beside, place)
        bound(place.parent)
    except OSError:
        if beside:
            Path(beside).unlink(missing_ok=True)


def bound(where: Path) -> None:
    """Delete the least recently used trees and flat texts until the others need at most LARGEST."""
    entries: list[tuple[float, int, str]] = []
    with os.scandir(where) as files:
        for file in files:
            if file.name.endswith((_ENDING, ".mo")):
                try:
                    entry = file.stat()
                except FileNotFoundError:  # deleted by another process
                    continue
                entries.append((entry.st_mtime, entry.st_size, file.path))
    total = sum(size for _, size, _ in entries)
    for _, size, path in sorted(entries):
        if total <= LARGEST:
            return
        Path(path).unlink(missing_ok=True)
        total -= size
