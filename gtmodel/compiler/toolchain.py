"""The C compiler of this machine: strict compilation, a shared library, the symbols it asks for."""

from __future__ import annotations

import os
import shutil
import stat
import subprocess
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
