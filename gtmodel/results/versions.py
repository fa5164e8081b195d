"""Versions of gtmodel and of the packages that its numbers depend on."""

from __future__ import annotations

import os
import platform
import sys
from importlib.util import find_spec
from pathlib import Path

from .._version import __version__

OURS = "gtmodel"
_PACKAGES = ("casadi", "numpy", "scipy", "pydantic")


def versions(*used: str) -> dict[str, str]:
    """Return the versions of gtmodel, Python, the numerical packages and those in `used`."""
    versions_by_name = {OURS: __version__, "python": platform.python_version(), "platform": _system()}
    return versions_by_name | {name: _installed(name) for name in (*_PACKAGES, *used)}


def _system() -> str:
    """As `platform.platform`, but without the process that it starts on Linux to find the processor's name."""
    if sys.platform != "linux":
        return platform.platform()
    parts = [platform.system(), platform.release(), platform.machine(), "with", "".join(platform.libc_ver())]
    return "-".join(part for part in parts if part)


def _installed(package: str) -> str:
    """The version of a package from its folder PACKAGE-VERSION.dist-info; importlib.metadata takes longer than writing
    the whole result."""
    spec = find_spec(package)
    if spec is not None and spec.origin is not None:
        names = os.listdir(Path(spec.origin).parents[1])
        folders = [n for n in names if n.startswith(f"{package}-") and n.endswith(".dist-info")]
        if len(folders) == 1:
            return folders[0].removeprefix(f"{package}-").removesuffix(".dist-info")
    from importlib.metadata import PackageNotFoundError, version  # none or several: an unusual installation

    try:
        return version(package)
    except PackageNotFoundError:
        return "not found"
