"""Writing to a disk: a file whole or not at all, nobody's file replaced unasked, and temporary folders."""

from __future__ import annotations

import errno
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from .refusal import ArgumentError

PathLike = str | os.PathLike[str]


def path_of(value: PathLike, argument: str = "path") -> Path:
    """The path of a file or folder. Raises ArgumentError for what is no text and no path, such as an open file.

    >>> from gtmodel.results.disk import path_of
    >>> path_of(3)
    Traceback (most recent call last):
        ...
    gtmodel.results.agreement.WrongKind: path: expected text or os.PathLike; found 3
    """
    if not isinstance(value, (str, os.PathLike)):
        from .agreement import WrongKind

        raise WrongKind(value, PathLike, argument)
    return Path(value)


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


_NO_ROOM = {errno.ENOSPC, errno.EFBIG, errno.EDQUOT, errno.EROFS}


@contextmanager
def scratch(prefix: str = "gtmodel-") -> Iterator[Path]:
    """A temporary folder that goes again, with the process that made it, not with one that is forked meanwhile. Raises
    ArgumentError where there is none, or where it is full."""
    place, owner = "", os.getpid()
    try:
        place = tempfile.mkdtemp(prefix=prefix)
        try:
            yield Path(place)
        finally:
            if os.getpid() == owner:
                shutil.rmtree(place, ignore_errors=True)
    except OSError as error:
        if not place or error.errno in _NO_ROOM or not Path(place).parent.is_dir():
            named = place or tempfile.tempdir or "of this machine"
            raise ArgumentError(
                f"the temporary folder {named} does not take the files ({error.strerror}); free space, or set TMPDIR"
            ) from error
        raise
