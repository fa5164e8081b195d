"""Elements of MATLAB files of version 5 to 7, looked at before SciPy reads them: its reader trusts their types and ends
the process where one is none."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

from .form import LogError, LogForm, refuse_swollen, shown

HEAD, TAG = 128, 8  # bytes
MATRIX, COMPRESSED = 14, 15
NUMBERS = frozenset({1, 2, 3, 4, 5, 6, 7, 9, 12, 13})  # types of elements
TYPES = NUMBERS | {MATRIX, 16, 17, 18}  # with texts and matrices
CLASSES = range(1, 18)  # cell, struct, object, char, sparse, numbers, function, opaque
CELL, CHAR, SPARSE, FUNCTION = 1, 4, 5, 16
OF_NUMBERS = range(5, FUNCTION)
CONTAINERS = (1, 2, 3)
SMALLEST = 8  # bytes of a member of a cell or struct
DEEPEST = 100  # matrices in one another
PIECE = 1 << 20
MOST_DIMENSIONS = 32

Read = Callable[[int], bytes]


def refuse_damaged(path: Path, form: LogForm = LogForm()) -> None:  # noqa: B008
    """Raises LogError where an element of a file is of no type that there is, or does not fit where it stands."""
    with open(path, "rb") as file:
        head = file.read(HEAD)
        if len(head) < HEAD or 0 in head[:4]:
            return  # too short, or version 4, which is read by plain Python
        order = "<" if head[126:128] == b"IM" else ">"
        size = path.stat().st_size
        try:
            while (left := size - file.tell()) >= TAG:
                kind, length = struct.unpack(f"{order}II", _exactly(file.read, TAG))
                end, read = file.tell() + length, file.read
                if end > size:
                    raise _Damaged(f"an element of {length} bytes stands where {left - TAG} are left")
                if kind == COMPRESSED:
                    read = _Inflated(file, length)
                    kind, length = struct.unpack(f"{order}II", _exactly(read, TAG))
                    refuse_swollen(path, length, form, "one of its variables")
                _element(read, kind, length, order, 0)
                file.seek(end)
        except _Damaged as error:
            raise LogError(
                f"{shown(path)} cannot be read as a MATLAB file ({error}); save it with -v7, or as CSV"
            ) from error


class _Damaged(Exception):
    """What is wrong, in a few words."""


class _Inflated:
    """Bytes of a compressed element, as far as they are asked for."""

    def __init__(self, file: BinaryIO, length: int) -> None:
        self._file, self._left, self._inflate, self._have = file, length, zlib.decompressobj(), b""

    def __call__(self, count: int) -> bytes:
        while len(self._have) < count and not self._inflate.eof:
            piece = self._inflate.unconsumed_tail
            if not piece:
                piece = self._file.read(min(PIECE, self._left))
                self._left -= len(piece)
            if not piece:
                break
            try:
                self._have += self._inflate.decompress(piece, PIECE)
            except zlib.error as error:
                raise _Damaged(f"its data do not decompress: {error}") from error
        given, self._have = self._have[:count], self._have[count:]
        return given


def _element(read: Read, kind: int, length: int, order: str, depth: int) -> None:
    """One element with all that is in it; the last numbers of the outermost one are left unread."""
    if kind not in TYPES:
        raise _Damaged(f"an element is of type {kind}")
    if kind != MATRIX or not length:  # an empty member of a cell
        return
    if depth > DEEPEST:
        raise _Damaged(f"more than {DEEPEST} structures stand in one another")
    left, own, number, needed = length, 0, 0, 1  # bytes, class of the array, elements that were read and must be there
    while left >= TAG:
        word, size = struct.unpack(f"{order}II", tag := _exactly(read, TAG))
        left -= TAG
        data = b""
        if small := word >> 16:  # up to four bytes beside their type
            word, size, data = word & 0xFFFF, 0, tag[4 : 4 + small]
        if size > left or small > 4:
            raise _Damaged(f"an element of {size or small} bytes stands where {left if size else 4} are left")
        if word not in (NUMBERS if own in OF_NUMBERS and number > 2 else TYPES):  # a name may be of any text
            raise _Damaged(f"an element is of type {word}")
        padded = min(-(-size // 8) * 8, left)
        number += 1
        if number == 1:
            if size != 8 or word != 6:
                raise _Damaged("an array does not say what it is of")
            own, needed = _class_of(_exactly(read, padded), order)
        elif number == 2 and own < FUNCTION:  # a function and an object of a class have no size
            count = _count(data or _exactly(read, padded)[:size], own, left - padded, order)
            needed += count if own == CELL else 0
        elif word == MATRIX:
            _element(read, word, size, order, depth + 1)
            _skip(read, padded - size)
        elif padded == left and not depth and number >= needed:
            return  # the numbers themselves
        else:
            _skip(read, padded)
        left -= padded
    if number < needed:
        raise _Damaged("an array lacks some of its elements")


def _class_of(flags: bytes, order: str) -> tuple[int, int]:
    """Class of an array, and how many elements it has at least: flags, size, name, numbers, imaginary ones."""
    word = struct.unpack(f"{order}I", flags[:4])[0]
    own = word & 0xFF
    if own not in CLASSES:
        raise _Damaged("an array is of a class that there is not")
    if own not in OF_NUMBERS:
        return own, 4 if own == CHAR else 3
    return own, (6 if own == SPARSE else 4) + (word >> 11 & 1)


def _count(sizes: bytes, own: int, left: int, order: str) -> int:
    """Number of members. More dimensions than there can be, and more members of a cell or struct than the file has
    bytes for, are refused."""
    if len(sizes) % 4 or not 4 <= len(sizes) <= 4 * MOST_DIMENSIONS:
        raise _Damaged(f"{len(sizes)} bytes say how large an array is")
    count = 1
    for n in struct.unpack(f"{order}{len(sizes) // 4}i", sizes):
        count *= n
        if n < 0 or (own in CONTAINERS and count * SMALLEST > max(left, SMALLEST)):
            raise _Damaged(f"an array has {n} rows or columns")
    return count


def _exactly(read: Read, count: int) -> bytes:
    data = read(count)
    if len(data) < count:
        raise _Damaged("it ends before an element does")
    return data


def _skip(read: Read, count: int) -> None:
    while count > 0:
        count -= len(_exactly(read, min(count, PIECE)))
