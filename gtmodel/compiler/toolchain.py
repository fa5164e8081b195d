"""The C compiler of this machine, strict compilation, and libraries that are compiled once and kept in a folder of the
user's."""

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
# objects show what the code itself calls: a distribution's hardening would add calls of its own
PLAIN = ("-fPIC", "-fno-stack-protector", "-U_FORTIFY_SOURCE")
LINK = ("-lm",)
SECONDS = 300.0
_LIBM = """
    acos acosh asin asinh atan atan2 atanh ceil copysign cos cosh erf exp expm1 fabs floor fmax fmin fmod hypot
    log log10 log1p pow remainder sin sinh sqrt tan tanh
"""
LIBM = frozenset(_LIBM.split())
# what generated code may ask for: libm, and what a compiler makes of a struct copy
_MATH = (*LIBM, "sincos")
ALLOWED_SYMBOLS = frozenset([*_MATH, *[f"{n}f" for n in _MATH], "memcpy", "memset", "_GLOBAL_OFFSET_TABLE_"])
_OTHERS = stat.S_IWGRP | stat.S_IWOTH


@dataclass(frozen=True)
class Toolchain:
    """Absolute paths of the compiler and of nm."""

    cc: str
    nm: str

    def run(self, *command: str | Path) -> tuple[bool, str]:
        """Whether a command succeeded, and all it printed."""
        try:
            done = subprocess.run(
                [str(c) for c in command], capture_output=True, text=True, errors="replace", timeout=SECONDS
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            return False, str(error)
        return done.returncode == 0, done.stdout + done.stderr

    def compile(self, source: Path, target: Path) -> tuple[bool, str]:
        """Compile one file with all warnings as errors."""
        return self.run(self.cc, *STANDARD, *WARNINGS, *PLAIN, "-c", source, "-o", target)

    def link_shared(self, objects: list[Path], target: Path) -> tuple[bool, str]:
        """Link objects into a shared library."""
        return self.run(self.cc, "-shared", "-o", target, *objects, *LINK)

    def foreign_symbols(self, objects: list[Path]) -> tuple[bool, list[str]]:
        """Names that the objects neither define nor may ask for; False if nm fails."""
        good, text = self.run(self.nm, "-g", *objects)
        wanted, defined = set[str](), set[str]()
        for line in text.splitlines():
            match line.split():
                case ["U", name]:
                    wanted.add(name)
                case [_, _, name]:
                    defined.add(name)
        return good, sorted(wanted - defined - ALLOWED_SYMBOLS)


def find() -> Toolchain | str:
    """The toolchain, or one sentence on what is missing. The variable CC names another compiler."""
    wanted = os.environ.get("CC", "").strip() or "cc"
    cc, nm = shutil.which(wanted), shutil.which("nm")
    if cc is None:
        return f"there is no C compiler '{wanted}' on this machine: install one (package gcc), or set CC"
    if nm is None:
        return "there is no 'nm' on this machine: install the package binutils"
    return Toolchain(cc, nm)


def exposed(path: Path) -> str:
    """Why another user may have put, or may exchange, what lies at `path`; empty where none but this one and root can.

    The path itself, and every folder above it, must belong to this user or to root and be writable by the owner alone;
    a folder above may be one as /tmp, where nobody takes away what is another's. Where the system has no such owners
    (Windows) nothing is said. Raises OSError where there is nothing at `path`.
    """
    if not hasattr(os, "getuid"):
        return ""
    whole = path.resolve(strict=True)
    for place in (whole, *whole.parents):
        entry = place.stat()
        if entry.st_uid not in (os.getuid(), 0):
            return f"{place} belongs to another user"
        if entry.st_mode & _OTHERS and not (place != whole and entry.st_mode & stat.S_ISVTX):
            return f"{place} can be written by other users"
    return ""


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
