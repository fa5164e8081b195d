"""Compiler, other programs and cache of libraries on this machine."""

from __future__ import annotations

import ctypes
import getpass
import re
import shutil
import subprocess
import tempfile
from pathlib import Path

from gtmodel.compiler.toolchain import Toolchain, cache_folder, exposed, find, home_folder

SECONDS = 20.0
_SOURCE = "double tried(double x);\ndouble tried(double x) { return 2.0 * x; }\n"


def first_line(*command: str) -> str:
    """Return the first line that a command prints; "" if it fails."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, errors="replace", timeout=SECONDS)
    except (OSError, subprocess.SubprocessError):
        return ""
    return done.stdout.strip().partition("\n")[0].strip() if done.returncode == 0 else ""


def compiler() -> tuple[str, str]:
    """Return the C compiler with its version, and its fault in a test that compiles and calls a tiny function."""
    chain = find()
    if isinstance(chain, str):
        return "none", chain
    return f"{chain.cc}: {first_line(chain.cc, '--version') or 'of unknown version'}", _tried(chain)


def _tried(chain: Toolchain) -> str:
    try:
        with tempfile.TemporaryDirectory(prefix="gtmodel-doctor-", ignore_cleanup_errors=True) as name:
            source, object_file, library = (Path(name) / f"tried.{ending}" for ending in ("c", "o", "so"))
            source.write_text(_SOURCE, encoding="utf-8")
            for good, output in (chain.compile(source, object_file), chain.link_shared([object_file], library)):
                if not good:
                    return f"it fails on a tiny function: {' '.join(output.split())[:200]}"
            function = ctypes.CDLL(str(library)).tried
            function.argtypes, function.restype = [ctypes.c_double], ctypes.c_double
            return "" if function(21.0) == 42.0 else "compiled code returns wrong numbers"
    except OSError as error:
        return f"compiled code does not run: {error}"


def program(name: str, option: str) -> str:
    """Return the first line of `name option`, or "none" if there is no such program."""
    path = shutil.which(name)
    return "none" if path is None else first_line(path, option) or f"{path}, which does not start"


def cache() -> tuple[str, str]:
    """Return the folder of compiled libraries with their number and size, and the reason if it cannot be used."""
    try:
        folder = cache_folder()
    except RuntimeError:
        return "none", "no home folder is known: set GTMODEL_CACHE to a folder of your own"
    try:
        sizes = [path.stat().st_size for path in folder.glob("*.so")] if folder.is_dir() else []
        existing = next(p for p in (folder, *folder.parents) if p.exists())
        reason = "" if _writable(existing) else "cannot be written to"
        reason = reason or (exposed(folder) if folder.is_dir() else "")
    except OSError as error:
        return str(folder), f"cannot be read: {error.strerror}"
    text = f"{folder}: {len(sizes)} libraries, {sum(sizes) / 1e6:.1f} MB"
    return text, f"{reason}: set GTMODEL_CACHE to a folder of your own" if reason else ""


def _writable(folder: Path) -> bool:
    """True if a file can be created; permissions are not enough, for example in /proc."""
    try:
        with tempfile.TemporaryFile(dir=folder, prefix="gtmodel-doctor-"):
            return True
    except OSError:
        return False


def discreet(text: str) -> str:
    """Replace the home folder by ~ and the user's name by USER in a text."""
    try:
        home = str(home_folder())
    except RuntimeError:
        home = ""
    if len(home) > 1:
        text = text.replace(home, "~")
    try:
        user = getpass.getuser()
    except (OSError, KeyError, ImportError):
        return text
    return re.sub(rf"(?<=[/\\]){re.escape(user)}(?![\w.-])", "USER", text)
