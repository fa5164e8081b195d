"""The C compiler of this machine, strict compilation, and a cache folder of compiled libraries."""

from __future__ import annotations

import hashlib
import os
import platform
import shutil
import stat
import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

STANDARD = ("-std=c99", "-O2", "-ffp-contract=off")
WARNINGS = ("-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-pedantic", "-Werror")
# without a distribution's hardening, whose calls would appear in the symbols of the objects
PLAIN = ("-fPIC", "-fno-stack-protector", "-U_FORTIFY_SOURCE")
LINK = ("-lm",)
SECONDS = 300.0
_LIBM = """
    acos acosh asin asinh atan atan2 atanh ceil copysign cos cosh erf exp expm1 fabs floor fmax fmin fmod hypot
    log log10 log1p pow remainder sin sinh sqrt tan tanh
"""
LIBM = frozenset(_LIBM.split())
# symbols that generated code may use: libm, and the functions that compilers call to copy a struct
_MATH = (*LIBM, "sincos")
ALLOWED_SYMBOLS = frozenset([*_MATH, *[f"{n}f" for n in _MATH], "memcpy", "memset", "_GLOBAL_OFFSET_TABLE_"])
_OTHERS = stat.S_IWGRP | stat.S_IWOTH


@dataclass(frozen=True)
class Toolchain:
    """Absolute paths of the compiler and of nm."""

    cc: str
    nm: str

    def run(self, *command: str | Path) -> tuple[bool, str]:
        """Run a command; return whether it succeeded, and its output."""
        try:
            process = subprocess.run(
                [str(c) for c in command], capture_output=True, text=True, errors="replace", timeout=SECONDS
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            return False, str(error)
        return process.returncode == 0, process.stdout + process.stderr

    def compile(self, source: Path, target: Path) -> tuple[bool, str]:
        """Compile one file with all warnings as errors."""
        return self.run(self.cc, *STANDARD, *WARNINGS, *PLAIN, "-c", source, "-o", target)

    def link_shared(self, objects: list[Path], target: Path) -> tuple[bool, str]:
        """Link objects into a shared library."""
        return self.run(self.cc, "-shared", "-o", target, *objects, *LINK)

    def foreign_symbols(self, objects: list[Path]) -> tuple[bool, list[str]]:
        """Return the names that the objects neither define nor may use; False if nm fails."""
        good, text = self.run(self.nm, "-g", *objects)
        used, defined = set[str](), set[str]()
        for line in text.splitlines():
            match line.split():
                case ["U", name]:
                    used.add(name)
                case [_, _, name]:
                    defined.add(name)
        return good, sorted(used - defined - ALLOWED_SYMBOLS)


def find() -> Toolchain | str:
    """Return the toolchain, or a sentence about what is missing. The variable CC selects another compiler."""
    name = os.environ.get("CC", "").strip() or "cc"
    cc, nm = shutil.which(name), shutil.which("nm")
    if cc is None:
        return f"there is no C compiler '{name}' on this machine: install one (package gcc), or set CC"
    if nm is None:
        return "there is no 'nm' on this machine: install the package binutils"
    return Toolchain(cc, nm)


def exposed(path: Path) -> str:
    """Return why another user may have written, or may replace, the file at `path`; empty if no other user can.

    The path and all its parent folders must belong to this user or root and be writable only by the owner. A parent may
    be a sticky folder such as /tmp. On systems without such owners (Windows) the result is empty. Raises OSError if
    `path` does not exist.
    """
    if not hasattr(os, "getuid"):
        return ""
    absolute = path.resolve(strict=True)
    for place in (absolute, *absolute.parents):
        entry = place.stat()
        if entry.st_uid not in (os.getuid(), 0):
            return f"{place} belongs to another user"
        if entry.st_mode & _OTHERS and not (place != absolute and entry.st_mode & stat.S_ISVTX):
            return f"{place} can be written by other users"
    return ""


# no contraction, as in cgen: the same bits as CasADi's virtual machine, hence the same iterations
FLAGS = (*STANDARD, *PLAIN, "-shared", *LINK)
SHOWN = 500  # characters of a compiler's error message


class CompilerMissing(RuntimeError):
    """Machine code is required, but there is no C compiler or it failed."""


def cache_folder() -> Path:
    """Return the folder of cached libraries: $GTMODEL_CACHE, else gtmodel in $XDG_CACHE_HOME or in ~/.cache.

    An empty variable counts as not set. Raises CompilerMissing if there is no home folder.
    """
    if folder := os.environ.get("GTMODEL_CACHE", "").strip():
        return Path(folder)
    return Path(os.environ.get("XDG_CACHE_HOME", "").strip() or home_folder() / ".cache") / "gtmodel"


def home_folder() -> Path:
    """Return the user's home. If HOME is empty, Python would return the root folder: use the user database instead."""
    try:
        if os.environ.get("HOME", "not set").strip():
            return Path.home()
        import pwd  # not available on Windows, which does not use HOME

        return Path(pwd.getpwuid(os.getuid()).pw_dir)
    except (RuntimeError, ImportError, KeyError):
        raise CompilerMissing(
            "there is no home folder for compiled libraries; set GTMODEL_CACHE to a folder of your own"
        ) from None


def kept_library(source: str, flags: Sequence[str], wanted: bool) -> Path | None:
    """Return the cached library of a C source, compiled with additional `flags`.

    If it does not exist, it is built if `wanted`; otherwise the result is None. Raises CompilerMissing.
    """
    chain = find()
    if isinstance(chain, str):
        raise CompilerMissing(chain)
    all_flags = (*FLAGS[:-1], *flags, FLAGS[-1])
    library = place(chain, source, all_flags)
    if not whole(library):
        if not wanted:
            return None
        build(chain, source, library, all_flags)
    return library


def place(chain: Toolchain, source: str, flags: Sequence[str]) -> Path:
    """Return the path of the library of a source, which may not exist yet."""
    key = "\0".join([source, *flags, chain.cc, platform.machine(), platform.system()])
    return _folder() / f"{hashlib.sha256(key.encode()).hexdigest()[:32]}.so"


def _folder() -> Path:
    """Return the cache folder, private to this user. Raises CompilerMissing if that fails or others can write to it."""
    folder = cache_folder()
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        folder.mkdir(mode=0o700, exist_ok=True)
        reason = exposed(folder)
    except OSError as error:
        raise CompilerMissing(_unwritable(folder, error)) from None
    if reason:
        raise CompilerMissing(
            f"compile=True would run machine code from {folder}, but {reason}; remove that permission (chmod go-w), or "
            "set GTMODEL_CACHE to a folder of your own"
        )
    return folder


def _hash_of(library: Path) -> Path:
    return library.with_suffix(".sha256")


def whole(library: Path) -> bool:
    """Return whether a library exists exactly as it was built, and no other user can change it."""
    try:
        expected = _hash_of(library).read_text(encoding="ascii")
        return not exposed(library) and hashlib.sha256(library.read_bytes()).hexdigest() == expected
    except (OSError, UnicodeDecodeError):
        return False


def build(chain: Toolchain, source: str, library: Path, flags: Sequence[str]) -> None:
    """Compile next to the target, then rename: another process sees a complete library or none."""
    try:
        with tempfile.TemporaryDirectory(dir=library.parent) as folder:
            text, output = Path(folder) / "element.c", Path(folder) / library.name
            text.write_text(source, encoding="utf-8")
            good, message = chain.run(chain.cc, *flags[:-1], text, "-o", output, flags[-1])
            if not good:
                raise CompilerMissing(
                    f"the C compiler {chain.cc} failed on the element functions: {message.strip()[:SHOWN]}"
                )
            output.chmod(0o700)
            _hash_of(output).write_text(hashlib.sha256(output.read_bytes()).hexdigest(), encoding="ascii")
            # the hash comes last: a library without it is built again
            _hash_of(library).unlink(missing_ok=True)
            output.replace(library)
            _hash_of(output).replace(_hash_of(library))
    except OSError as error:
        raise CompilerMissing(_unwritable(library.parent, error)) from None


def _unwritable(folder: Path, error: OSError) -> str:
    return f"compile=True cannot write to {folder} ({error.strerror}); set GTMODEL_CACHE to another folder"
