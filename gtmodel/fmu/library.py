"""The shared library of a unit, made by the C compiler of this machine."""

from __future__ import annotations

import platform
import subprocess
from collections.abc import Mapping

from ..cgen.text import GenerationError
from ..compiler.toolchain import SECONDS, STANDARD, find
from ..results.disk import scratch

# one folder, relative names, no time, no build number: the same bytes wherever it is made. Only what the standard
# names is seen from outside, so that two units in one program share nothing. Nothing runs at loading: no start files.
FLAGS = (
    *STANDARD, "-Os", "-fPIC", "-fvisibility=hidden", "-ffunction-sections", "-fdata-sections", "-fno-ident",
    "-fno-asynchronous-unwind-tables", "-g0",
)  # fmt: skip
LINK = (
    "-shared", "-s", "-nostartfiles", "-Wl,--build-id=none", "-Wl,--gc-sections", "-Wl,--no-undefined",
    "-Wl,-z,noexecstack", "-Wl,-z,noseparate-code", "-Wl,--hash-style=gnu", "-lm",
)  # fmt: skip
WINDOWS = "x86_64-w64-mingw32-gcc"


def binary_places() -> tuple[str, str]:
    """Folder of the library for this machine in archives of FMI 3.0 and 2.0. Raises GenerationError for a machine for
    which no name is known."""
    machine, system = platform.machine().lower(), platform.system()
    names = {"x86_64": "x86_64", "amd64": "x86_64", "aarch64": "aarch64", "arm64": "aarch64"}
    if system != "Linux" or machine not in names:
        raise GenerationError(f"libraries are made on Linux for x86_64 and aarch64 only; this is {system} on {machine}")
    return f"{names[machine]}-linux", "linux64" if names[machine] == "x86_64" else "aarch64-linux"


def library(files: Mapping[str, str]) -> bytes:
    """The library of these sources, by name. Raises GenerationError without a compiler, and where one fails."""
    tools = find()
    if isinstance(tools, str):
        raise GenerationError(tools)
    return _compiled(tools.cc, files, LINK)


def windows_library(compiler: str, files: Mapping[str, str]) -> bytes:
    """The same for Windows by a cross compiler such as x86_64-w64-mingw32-gcc. Raises GenerationError as `library`."""
    return _compiled(compiler, files, ("-shared", "-s", "-Wl,--no-insert-timestamp", "-static-libgcc", "-lm"))


def _compiled(compiler: str, files: Mapping[str, str], link: tuple[str, ...]) -> bytes:
    with scratch("gtmodel-fmu-") as folder:
        for name, text in files.items():
            (folder / name).write_text(text, encoding="utf-8")
        sources = sorted(name for name in files if name.endswith(".c"))
        command = [compiler, *FLAGS, *sources, "-o", "library.bin", *link]
        try:
            done = subprocess.run(
                command, cwd=folder, capture_output=True, text=True, errors="replace", timeout=SECONDS
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            raise GenerationError(f"the compiler cannot be run: {error}") from error
        if done.returncode != 0:
            lines = done.stderr.splitlines()
            said = next((line for line in lines if "error" in line or "undefined" in line), done.stderr.strip())
            raise GenerationError(f"the compiler refuses the unit: {said}")
        return (folder / "library.bin").read_bytes()
