"""Element functions as machine code: their C compiled once and kept in a folder of the user's."""

from __future__ import annotations

import hashlib
import os
import platform
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import casadi as ca

from ..cgen.toolchain import LINK, PLAIN, STANDARD, Toolchain, find

# no contraction, as in cgen: the same bits as CasADi's virtual machine, hence the same iterations
FLAGS = (*STANDARD, *PLAIN, "-shared", *LINK)
SHOWN = 500  # characters of what a failing compiler says


class CompilerMissing(RuntimeError):
    """Machine code is wanted, and this machine has no C compiler or it failed."""


def cache_folder() -> Path:
    """Where libraries are kept: $GTMODEL_CACHE, else gtmodel in $XDG_CACHE_HOME or in ~/.cache."""
    if own := os.environ.get("GTMODEL_CACHE", "").strip():
        return Path(own)
    return Path(os.environ.get("XDG_CACHE_HOME", "").strip() or Path.home() / ".cache") / "gtmodel"


def compiled(functions: Sequence[ca.Function]) -> tuple[list[ca.Function], float]:
    """The same functions from one shared library, and the seconds that compiling took: 0.0 if it was there.

    The library's name is a hash of the source, the flags, the compiler's path and the machine. Externals have no
    derivatives. Raises CompilerMissing.
    """
    chain = find()
    if isinstance(chain, str):
        raise CompilerMissing(f"compile=True needs a compiler, and {chain}; compile=False gives the same optimum")
    generator = ca.CodeGenerator("element.c", {"with_header": False})
    for f in functions:
        generator.add(f)
    source = generator.dump()
    key = "\0".join([source, *FLAGS, chain.cc, platform.machine(), platform.system()])
    library = cache_folder() / f"{hashlib.sha256(key.encode()).hexdigest()[:32]}.so"
    begin, made = time.perf_counter(), not library.exists()
    if made:
        _build(chain, source, library)
    spent = time.perf_counter() - begin if made else 0.0
    return [ca.external(f.name(), str(library)) for f in functions], spent


def _build(chain: Toolchain, source: str, library: Path) -> None:
    """Compile beside the target, then rename: another process sees a whole library or none."""
    try:
        library.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=library.parent) as folder:
            text, made = Path(folder) / "element.c", Path(folder) / library.name
            text.write_text(source, encoding="utf-8")
            good, said = chain.run(chain.cc, *FLAGS[:-1], text, "-o", made, FLAGS[-1])
            if not good:
                raise CompilerMissing(
                    f"the C compiler {chain.cc} failed on the element functions: {said.strip()[:500]}"
                )
            made.replace(library)
    except OSError as error:
        raise CompilerMissing(
            f"compile=True cannot write to {library.parent} ({error.strerror}); set GTMODEL_CACHE to another folder"
        ) from None
