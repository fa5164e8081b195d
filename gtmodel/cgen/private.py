"""Who may change a file that is going to be executed: its owner alone, if it shall be ours."""

from __future__ import annotations

import os
import stat
from pathlib import Path

_OTHERS = stat.S_IWGRP | stat.S_IWOTH


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
