"""How files for machines say in their first line that they must not be relied on."""

from __future__ import annotations

from pathlib import Path, PurePath

_MARK = "NOT TO BE USED"
_LONGEST = 4096  # bytes of a first line that are looked at: a measured file may be one line of many megabytes
# how a file of this ending says something in its first line; all readers of these formats pass over it
_COMMENT = {
    ".csv": ("# ", ""),
    ".toml": ("# ", ""),
    ".mod": ("! ", ""),
    ".c": ("/* ", " */"),
    ".h": ("/* ", " */"),
    ".urdf": ("<!-- ", " -->"),  # before the outermost element: written without a declaration
}


def marked(name: str, content: bytes, message: str, by: str = ", written by --write-failed") -> bytes:
    """A file for a machine whose result must not be relied on: its first line says so. Nothing else changes.

    Raises ValueError for an ending that has no comment here: such a file cannot be marked.
    """
    try:
        before, after = _COMMENT[PurePath(name).suffix]
    except KeyError:
        raise ValueError(f"{name}: no comment is known for files of this ending") from None
    said = " ".join(message.split()).replace("*/", "* /").replace("/*", "/ *")
    text = f"{_MARK}{by}: {said}"
    line = f"{before}{text.replace('--', '- -') if before == '<!-- ' else text}{after}"
    return line.encode() + b"\n" + content


def is_marked(path: Path) -> bool:
    """True for a file that says of itself that it must not be relied on; False for what cannot be read."""
    try:
        with open(path, "rb") as file:
            return _MARK.encode() in file.readline(_LONGEST)
    except OSError:
        return False
