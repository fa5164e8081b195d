"""One file, written whole: what breaks off leaves what was there, and nobody's file is replaced unasked."""

from __future__ import annotations

import os
from pathlib import Path

PathLike = str | os.PathLike[str]


def write_whole(path: PathLike, data: bytes, *, overwrite: bool) -> None:
    """Write a file; only a process that is killed while it makes a new one leaves a part.

    Raises FileExistsError for a file that is there, unless `overwrite`, and OSError of the system.
    """
    place = Path(os.path.realpath(path))
    beside = overwrite and (place.is_file() or not place.exists())  # a device is no file to be replaced
    part = place.with_name(f".{place.name}.{os.getpid()}.part") if beside else place
    try:
        file = open(part, "wb" if overwrite else "xb")  # noqa: SIM115
    except FileExistsError:
        raise FileExistsError(
            f"{path} is already there and was left alone; choose another path or pass overwrite=True"
        ) from None
    try:
        with file:
            file.write(data)
        if beside:
            os.replace(part, place)
    except BaseException:
        if beside or not overwrite:
            part.unlink(missing_ok=True)
        raise
