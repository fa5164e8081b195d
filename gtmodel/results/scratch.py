"""A folder for what is compiled or read back at once."""

from __future__ import annotations

import errno
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from .refusal import ArgumentError

_NO_ROOM = {errno.ENOSPC, errno.EFBIG, errno.EDQUOT, errno.EROFS}


@contextmanager
def scratch(prefix: str = "gtmodel-") -> Iterator[Path]:
    """A temporary folder that goes again. Raises ArgumentError where there is none, or where it is full."""
    place = "of this machine"
    try:
        with tempfile.TemporaryDirectory(prefix=prefix) as place:
            yield Path(place)
    except OSError as error:
        if error.errno in _NO_ROOM or not Path(place).parent.is_dir():
            raise ArgumentError(
                f"the temporary folder {place} does not take the files ({error.strerror}); free space, or set TMPDIR"
            ) from error
        raise
