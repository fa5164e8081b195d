"""Element functions as machine code: their C compiled once and kept in a folder of the user's."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

import casadi as ca

from ..compiler.toolchain import FLAGS, SHOWN, CompilerMissing, build, find, place, whole


def compiled(functions: Sequence[ca.Function]) -> tuple[list[ca.Function], float]:
    """The same functions from one shared library, and the seconds that compiling took: 0.0 if it was there.

    The library's name is a hash of the source, the flags, the compiler's path and the machine; beside it lies the hash
    of its own bytes: one that is cut, or exchanged, or does not load, is built anew. Libraries are loaded from folders
    that none but their owner can write. Externals have no derivatives. Raises CompilerMissing.
    """
    chain = find()
    if isinstance(chain, str):
        raise CompilerMissing(f"compile=True needs a compiler, and {chain}; compile=False gives the same optimum")
    generator = ca.CodeGenerator("element.c", {"with_header": False})
    for f in functions:
        generator.add(f)
    source = generator.dump()
    library = place(chain, source, FLAGS)
    begin = time.perf_counter()
    if whole(library):
        try:
            return _loaded(functions, library), 0.0
        except RuntimeError:
            pass  # whole as it was written, but for another system or another CasADi
    build(chain, source, library, FLAGS)
    try:
        return _loaded(functions, library), time.perf_counter() - begin
    except RuntimeError as error:
        said = " ".join(str(error).split())[:SHOWN]
        raise CompilerMissing(f"the element functions compiled by {chain.cc} do not load: {said}") from None


def _loaded(functions: Sequence[ca.Function], library: Path) -> list[ca.Function]:
    return [ca.external(f.name(), str(library)) for f in functions]
