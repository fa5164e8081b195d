"""Trees of files that were parsed before, in the user's cache folder: a large library is parsed once."""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
import os
import tempfile
import time
import zlib
from functools import cache
from pathlib import Path
from typing import Any

from .._version import __version__
from ..compiler.toolchain import CompilerMissing, cache_folder, exposed
from .syntax import ClassText, Source
from .trees import packed, unpacked

# characters; what is shorter is parsed faster than its tree is found
SHORTEST = 2_000
# bytes of all trees; those of a whole Modelica Standard Library take 5 MB
LARGEST = 64_000_000
# seconds after which a tree that is used counts as newly used
TOUCHED = 3600.0
_ENDING = ".tree"
_DEFINED_BY = ("grammar.lark", "reader.py", "shape.py", "syntax.py", "trees.py")


def folder() -> Path | None:
    """Where trees and the grammar's tables are kept; None where there is no folder that only this user can write."""
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
    """Changes with gtmodel, with lark, with the grammar and with what makes trees of it."""
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
    """The classes of a text that was parsed before; None for one that was not, or whose tree is not whole."""
    place = _place(source.text)
    if place is None:
        return None
    try:
        if exposed(place):
            return None
        content = place.read_bytes()
        said, _, body = content.partition(b"\n")
        if hashlib.sha256(body).hexdigest().encode() != said:
            return None
        result: Any = unpacked(json.loads(zlib.decompress(body)), source)
        if time.time() - place.stat().st_mtime > TOUCHED:
            os.utime(place)
    except (OSError, ValueError, TypeError, LookupError, zlib.error, RecursionError):
        return None
    return result


def keep(source: Source, classes: list[ClassText]) -> None:
    """Keep the classes of a text, whole or not at all; silent where nothing can be written."""
    place = _place(source.text)
    if place is None:
        return
    try:
        body = zlib.compress(json.dumps(packed(classes), separators=(",", ":")).encode(), 1)
    except (TypeError, RecursionError):
        return
    beside = ""
    try:
        # beside the target, then renamed: another process sees a whole tree or none
        with tempfile.NamedTemporaryFile(dir=place.parent, prefix="new-", suffix=_ENDING, delete=False) as file:
            beside = file.name
            file.write(hashlib.sha256(body).hexdigest().encode() + b"\n" + body)
        os.replace(beside, place)
        bound(place.parent)
    except OSError:
        if beside:
            Path(beside).unlink(missing_ok=True)


def bound(where: Path) -> None:
    """Take away the trees and flat texts that were not used for longest, until the others take less than LARGEST."""
    entries: list[tuple[float, int, str]] = []
    with os.scandir(where) as files:
        for file in files:
            if file.name.endswith((_ENDING, ".mo")):
                try:
                    entry = file.stat()
                except FileNotFoundError:  # by another process
                    continue
                entries.append((entry.st_mtime, entry.st_size, file.path))
    total = sum(size for _, size, _ in entries)
    for _, size, path in sorted(entries):
        if total <= LARGEST:
            return
        Path(path).unlink(missing_ok=True)
        total -= size
