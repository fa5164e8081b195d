"""The archive: a zip with the same bytes for the same content, whoever makes it and when."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping
from pathlib import Path

FIRST = (1980, 1, 1, 0, 0, 0)  # the earliest time that a zip can hold
PLAIN, PROGRAM = 0o100644, 0o100755
LEVEL = 9


def archive(files: Mapping[str, bytes]) -> bytes:
    """The zip of these files by their paths: sorted, with one time, fixed rights and one compression.

    >>> from gtmodel.fmu.archive import archive
    >>> archive({"b": b"2", "a": b"1"}) == archive({"a": b"1", "b": b"2"})
    True
    """
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED, compresslevel=LEVEL) as z:
        for name in sorted(files):
            entry = zipfile.ZipInfo(name, FIRST)
            entry.create_system = 3  # Unix, on every machine
            entry.external_attr = (PROGRAM if name.startswith("binaries/") else PLAIN) << 16
            entry.compress_type = zipfile.ZIP_DEFLATED
            z.writestr(entry, files[name], compresslevel=LEVEL)
    return made.getvalue()


def is_ours(path: Path) -> bool:
    """Whether gtmodel made this archive."""
    try:
        with zipfile.ZipFile(io.BytesIO(path.read_bytes())) as archive:
            return b'generationTool="gtmodel ' in archive.read("modelDescription.xml")
    except (OSError, KeyError, zipfile.BadZipFile):
        return False
