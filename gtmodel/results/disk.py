"""Writing to a disk: a file whole or not at all, nobody's file replaced unasked; files made when they are written;
how files for machines say that they must not be relied on."""

from __future__ import annotations

import errno
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path, PurePath
from typing import Any

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


class MadeFiles(Mapping[str, str]):
    """Contents by file name, each from a function that is called when it is asked for."""

    def __init__(self, makers: Mapping[str, Callable[[], str]]) -> None:
        self.makers = dict(makers)

    def __getitem__(self, name: str) -> str:
        return self.makers[name]()

    def __iter__(self) -> Iterator[str]:
        return iter(self.makers)

    def __len__(self) -> int:
        return len(self.makers)

    def with_(self, name: str, maker: Callable[[], str], *, behind: str) -> MadeFiles:
        """The same with one file more, behind another one."""
        place = list(self.makers).index(behind) + 1
        pairs = list(self.makers.items())
        return MadeFiles(dict([*pairs[:place], (name, maker), *pairs[place:]]))


def made(files: Mapping[str, Any]) -> MadeFiles:
    """Any files as such: those that are there are given when they are asked for."""
    if isinstance(files, MadeFiles):
        return files
    return MadeFiles({name: partial(str, content) for name, content in files.items()})


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
