"""Writing to disk: complete files or none, no file replaced without permission, contents computed when written, and
marks on machine files that must not be used."""

from __future__ import annotations

import errno
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path, PurePath

from .refusal import ArgumentError

PathLike = str | os.PathLike[str]


def path_of(value: PathLike, argument: str = "path") -> Path:
    """Return the path of a file or folder. Raises ArgumentError for anything but text or a path, such as an open file.

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
    """Write a file completely or not at all; only a process killed while it creates a new file leaves a part.

    Raises FileExistsError if the file exists, unless `overwrite`, and OSError of the system.
    """
    place = os.path.realpath(path)
    replaces = overwrite and (os.path.isfile(place) or not os.path.exists(place))  # a device cannot be replaced
    folder, name = os.path.split(place)
    part = os.path.join(folder, f".{name}.{os.getpid()}.part") if replaces else place
    try:
        file = open(part, "wb" if overwrite else "xb")  # noqa: SIM115
    except FileExistsError:
        raise FileExistsError(
            f"{path} exists already and was not changed; choose another path or pass overwrite=True"
        ) from None
    try:
        with file:
            file.write(data)
        if replaces:
            os.replace(part, place)
    except BaseException:
        if replaces or not overwrite:
            with suppress(FileNotFoundError):
                os.unlink(part)
        raise


_NO_ROOM = {errno.ENOSPC, errno.EFBIG, errno.EDQUOT, errno.EROFS}


@contextmanager
def scratch(prefix: str = "gtmodel-") -> Iterator[Path]:
    """Yield a temporary folder, which this process removes afterwards, but not its forks. Raises ArgumentError if the
    folder cannot be created or is full."""
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
            name = place or tempfile.tempdir or "of this machine"
            raise ArgumentError(
                f"cannot write into the temporary folder {name} ({error.strerror}); free space, or set TMPDIR"
            ) from error
        raise


class MadeFiles(Mapping[str, str]):
    """Contents by file name, each computed by a function at access."""

    def __init__(self, makers: Mapping[str, Callable[[], str]]) -> None:
        self.makers = dict(makers)

    def __getitem__(self, name: str) -> str:
        return self.makers[name]()

    def __iter__(self) -> Iterator[str]:
        return iter(self.makers)

    def __len__(self) -> int:
        return len(self.makers)


_MARK = "NOT TO BE USED"
_LONGEST = 4096  # bytes of a first line that are read: a measured file may be one line of many megabytes
# comments by file extension; all readers of these formats skip them
_COMMENT = {
    ".csv": ("# ", ""),
    ".toml": ("# ", ""),
    ".mod": ("! ", ""),
    ".c": ("/* ", " */"),
    ".h": ("/* ", " */"),
    ".urdf": ("<!-- ", " -->"),  # before the outermost element: written without a declaration
}


def marked(name: str, content: bytes, message: str, by: str = ", written by --write-failed") -> bytes:
    """Return the content with a first line that says that the file must not be used.

    Raises ValueError for a file extension without a known comment syntax.
    """
    try:
        before, after = _COMMENT[PurePath(name).suffix]
    except KeyError:
        raise ValueError(f"{name}: no comment is known for files of this ending") from None
    reason = " ".join(message.split()).replace("*/", "* /").replace("/*", "/ *")
    text = f"{_MARK}{by}: {reason}"
    line = f"{before}{text.replace('--', '- -') if before == '<!-- ' else text}{after}"
    return line.encode() + b"\n" + content


def is_marked(path: Path) -> bool:
    """Return True for a file marked as not to be used; False if it cannot be read."""
    try:
        with open(path, "rb") as file:
            return _MARK.encode() in file.readline(_LONGEST)
    except OSError:
        return False
