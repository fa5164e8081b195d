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

from ..cgen.toolchain import LINK, PLAIN, STANDARD, Toolchain, exposed, find

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
    library = _place(chain, source, FLAGS)
    begin = time.perf_counter()
    if _whole(library):
        try:
            return _loaded(functions, library), 0.0
        except RuntimeError:
            pass  # whole as it was written, but for another system or another CasADi
    _build(chain, source, library, FLAGS)
    try:
        return _loaded(functions, library), time.perf_counter() - begin
    except RuntimeError as error:
        said = " ".join(str(error).split())[:SHOWN]
        raise CompilerMissing(f"the element functions compiled by {chain.cc} do not load: {said}") from None


def kept_library(source: str, flags: Sequence[str], build: bool) -> Path | None:
    """The library of C, from the same cache, with `flags` behind the usual ones; None where it is not there and `build`
    is false. Raises CompilerMissing."""
    chain = find()
    if isinstance(chain, str):
        raise CompilerMissing(chain)
    every = (*FLAGS[:-1], *flags, FLAGS[-1])
    library = _place(chain, source, every)
    if not _whole(library):
        if not build:
            return None
        _build(chain, source, library, every)
    return library


def _place(chain: Toolchain, source: str, flags: Sequence[str]) -> Path:
    """Where the library of a source lies, or will."""
    key = "\0".join([source, *flags, chain.cc, platform.machine(), platform.system()])
    return _folder() / f"{hashlib.sha256(key.encode()).hexdigest()[:32]}.so"


def _folder() -> Path:
    """The cache folder, made for this user alone. Raises CompilerMissing where it cannot be, or others may write it."""
    folder = cache_folder()
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        folder.mkdir(mode=0o700, exist_ok=True)
        reason = exposed(folder)
    except OSError as error:
        raise CompilerMissing(_unwritable(folder, error)) from None
    if reason:
        raise CompilerMissing(
            f"compile=True would run machine code from {folder}, and {reason}; take that right away (chmod go-w), or "
            "set GTMODEL_CACHE to a folder of your own"
        )
    return folder


def _hash_of(library: Path) -> Path:
    return library.with_suffix(".sha256")


def _whole(library: Path) -> bool:
    """True for a library that is there, byte for byte as it was built, and that nobody else can change."""
    try:
        wanted = _hash_of(library).read_text(encoding="ascii")
        return not exposed(library) and hashlib.sha256(library.read_bytes()).hexdigest() == wanted
    except (OSError, UnicodeDecodeError):
        return False


def _loaded(functions: Sequence[ca.Function], library: Path) -> list[ca.Function]:
    return [ca.external(f.name(), str(library)) for f in functions]


def _build(chain: Toolchain, source: str, library: Path, flags: Sequence[str]) -> None:
    """Compile beside the target, then rename: another process sees a whole library or none."""
    try:
        with tempfile.TemporaryDirectory(dir=library.parent) as folder:
            text, made = Path(folder) / "element.c", Path(folder) / library.name
            text.write_text(source, encoding="utf-8")
            good, said = chain.run(chain.cc, *flags[:-1], text, "-o", made, flags[-1])
            if not good:
                raise CompilerMissing(
                    f"the C compiler {chain.cc} failed on the element functions: {said.strip()[:SHOWN]}"
                )
            made.chmod(0o700)
            _hash_of(made).write_text(hashlib.sha256(made.read_bytes()).hexdigest(), encoding="ascii")
            # the hash last: without it a library is built anew
            _hash_of(library).unlink(missing_ok=True)
            made.replace(library)
            _hash_of(made).replace(_hash_of(library))
    except OSError as error:
        raise CompilerMissing(_unwritable(library.parent, error)) from None


def _unwritable(folder: Path, error: OSError) -> str:
    return f"compile=True cannot write to {folder} ({error.strerror}); set GTMODEL_CACHE to another folder"
