"""Libraries of C, compiled once and kept in a folder of the user's."""

from __future__ import annotations

import hashlib
import os
import platform
import tempfile
from collections.abc import Sequence
from pathlib import Path

from .toolchain import LINK, PLAIN, STANDARD, Toolchain, exposed, find

# no contraction, as in cgen: the same bits as CasADi's virtual machine, hence the same iterations
FLAGS = (*STANDARD, *PLAIN, "-shared", *LINK)
SHOWN = 500  # characters of what a failing compiler says


class CompilerMissing(RuntimeError):
    """Machine code is wanted, and this machine has no C compiler or it failed."""


def cache_folder() -> Path:
    """Where libraries are kept: $GTMODEL_CACHE, else gtmodel in $XDG_CACHE_HOME or in ~/.cache.

    A variable that is empty counts as one that is not set. Raises CompilerMissing where no home is known.
    """
    if own := os.environ.get("GTMODEL_CACHE", "").strip():
        return Path(own)
    return Path(os.environ.get("XDG_CACHE_HOME", "").strip() or home_folder() / ".cache") / "gtmodel"


def home_folder() -> Path:
    """The user's home. With an empty HOME Python names the root folder: then the one of the list of users."""
    try:
        if os.environ.get("HOME", "not set").strip():
            return Path.home()
        import pwd  # here: Windows has none, and does not ask for HOME

        return Path(pwd.getpwuid(os.getuid()).pw_dir)
    except (RuntimeError, ImportError, KeyError):
        raise CompilerMissing(
            "no home folder is known to keep compiled libraries in; set GTMODEL_CACHE to a folder of your own"
        ) from None


def kept_library(source: str, flags: Sequence[str], wanted: bool) -> Path | None:
    """The library of a C source, with `flags` behind the usual ones, built where it is `wanted` and not there; None
    where it is neither. Raises CompilerMissing."""
    chain = find()
    if isinstance(chain, str):
        raise CompilerMissing(chain)
    every = (*FLAGS[:-1], *flags, FLAGS[-1])
    library = place(chain, source, every)
    if not whole(library):
        if not wanted:
            return None
        build(chain, source, library, every)
    return library


def place(chain: Toolchain, source: str, flags: Sequence[str]) -> Path:
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


def whole(library: Path) -> bool:
    """True for a library that is there, byte for byte as it was built, and that nobody else can change."""
    try:
        wanted = _hash_of(library).read_text(encoding="ascii")
        return not exposed(library) and hashlib.sha256(library.read_bytes()).hexdigest() == wanted
    except (OSError, UnicodeDecodeError):
        return False


def build(chain: Toolchain, source: str, library: Path, flags: Sequence[str]) -> None:
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
