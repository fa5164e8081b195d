"""The archive: a zip with the same bytes for the same content, whoever makes it and when; unpacked within bounds."""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path

from ..results.read_bounds import XmlFault, swollen, walk_xml

DESCRIPTION = "modelDescription.xml"
FIRST = (1980, 1, 1, 0, 0, 0)  # the earliest time that a zip can hold
PLAIN, PROGRAM = 0o100644, 0o100755
LEVEL = 9
MOST_DESCRIPTION = 1 << 26  # bytes: of 200,000 variables
# what reading a zip raises: damaged, encrypted, compressed by a method that Python lacks
_DAMAGED = (OSError, zipfile.BadZipFile, NotImplementedError, RuntimeError, EOFError, zlib.error)


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


class ArchiveFault(ValueError):
    """Why an archive is not unpacked, as a sentence that goes on after its name."""


def unpack(path: Path, folder: Path) -> None:
    """Unpacks the archive of a unit into a folder.

    Raises ArchiveFault, before anything is written, for what is no archive, for one that holds far more than its own
    size, and for a description that is too large, too deep or declares entities.
    """
    try:
        with zipfile.ZipFile(path) as packed:
            if said := swollen(path, sum(entry.file_size for entry in packed.infolist())):
                raise ArchiveFault(f"{said}; pack it without what it does not need")
            if (size := packed.getinfo(DESCRIPTION).file_size) > MOST_DESCRIPTION:
                most = f"expected at most {MOST_DESCRIPTION / 1e6:.3g} MB"
                raise ArchiveFault(f"has a description of {size / 1e6:.4g} MB; {most}")
            walk_xml(packed.read(DESCRIPTION))
            packed.extractall(folder)
    except XmlFault as fault:
        raise ArchiveFault(f"has a description, {DESCRIPTION}, that {fault.sentence} (line {fault.line})") from fault
    except KeyError:
        raise ArchiveFault(f"holds no {DESCRIPTION}: it is no unit") from None
    except _DAMAGED as error:
        what = "unpacked" if path.is_file() else "read"
        why = getattr(error, "strerror", None) or next(iter(str(error).splitlines()), type(error).__name__)
        raise ArchiveFault(f"cannot be {what}: {why}") from error


def is_ours(path: Path) -> bool:
    """Whether gtmodel made this archive."""
    try:
        with zipfile.ZipFile(path) as packed, packed.open(DESCRIPTION) as description:
            return b'generationTool="gtmodel ' in description.read(MOST_DESCRIPTION)
    except (*_DAMAGED, KeyError):
        return False
