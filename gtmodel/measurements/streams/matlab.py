"""MATLAB files of all versions, and HDF5: variables, members of structs and rows of matrices; elements are looked at
before SciPy reads them."""

from __future__ import annotations

import struct
import warnings
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np

from .form import LogError, LogForm, needed, refuse_swollen, shown
from .heads import Attributes, Heads, attributes_of
from .stream import ArrayStream

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


MOST_COMPONENTS = 64  # of a signal; a matrix with more both ways is a picture or a map
SHORTEST = 3  # samples: shorter vectors are parameters
MOST_STRUCTS = 100  # of an array of structs
NO_NUMBERS = "holds no numbers; of a text, a cell or an object such as a timetable save the numbers as arrays"


class MatVariable(NamedTuple):
    """An array of numbers in a file: its shape as MATLAB shows it, what reads it, and what the file says of it."""

    shape: tuple[int, ...]
    load: Callable[[], np.ndarray]
    attributes: Attributes = Attributes()


class MatFile:
    """The numeric arrays of a MATLAB file by their names, `rec.q` for a member of a struct.

    The components of a matrix of matrices, (4, 4, n), are numbered row by row.

    `skipped`: by the name of what is no array of numbers, what it is. Raises LogError for what cannot be read.
    """

    def __init__(self, path: Path, form: LogForm) -> None:
        self.source, self.form = shown(path), form
        self.skipped: dict[str, str] = {}
        read = _of_hdf5 if is_hdf5(path) else _of_old
        self.variables: dict[str, MatVariable] = dict(self._kept(read(path, form)))
        if not self.variables:
            linked = next((f"; '{name}' {said}" for name, said in self.skipped.items() if said != NO_NUMBERS), "")
            raise LogError(f"{self.source} holds no array of numbers{linked}")

    def streams(self) -> list[ArrayStream]:
        """The variables of each length as a table, the longest one first; what is shorter than a recording is no
        stream."""
        lengths: dict[int, None] = {}
        for variable in self.variables.values():
            lengths[self._length(variable)] = None
        return [self.stream(n) for n in sorted(lengths, reverse=True) if n >= SHORTEST]

    def of_time(self, time: str) -> ArrayStream:
        """The table of the variables that have a sample for each of this one, which is the time."""
        variable = self.variables.get(time)
        if variable is None:
            raise LogError(
                Heads(list(self.variables), self.source).missing(time)
                + (f"; '{time}' {self.skipped[time]}" if time in self.skipped else "")
            )
        if not _is_vector(variable.shape):
            raise LogError(f"{self.source}: the time '{time}' is a matrix {_size(variable.shape)}; expected a vector")
        return self.stream(int(np.prod(variable.shape)))

    def stream(self, length: int) -> ArrayStream:
        """The table of the variables with so many samples."""
        columns: dict[str, tuple[str, int, int]] = {}  # variable, axis of the samples, component
        for name, variable in self.variables.items():
            axis = self._axis(variable, length)
            if axis is None:
                continue
            width = int(np.prod(variable.shape)) // length
            if width == 1:
                columns[name] = name, axis, 0
            elif width <= MOST_COMPONENTS or self.form.samples is not None:
                columns |= {f"{name}[{k}]": (name, axis, k) for k in range(width)}

        def load(column: str) -> np.ndarray:
            name, axis, component = columns[column]
            variable = self.variables[name]
            return variable.attributes.numbers(np.moveaxis(variable.load(), axis, 0).reshape(length, -1)[:, component])

        return ArrayStream(self.source, f"{length} samples", _MatHeads(columns, self, length), load)

    def _length(self, variable: MatVariable) -> int:
        """The number of samples of a variable, as far as it can be seen without a time."""
        shape = variable.shape
        if _is_vector(shape):
            return int(np.prod(shape))
        if len(shape) > 2 or self.form.samples is not None:
            return shape[self._stated(shape)]
        vectors = {int(np.prod(v.shape)) for v in self.variables.values() if _is_vector(v.shape)}
        short, long = sorted(shape)
        # samples are more than components, but for a short table
        return short if short in vectors and long not in vectors and long <= MOST_COMPONENTS else long

    def _stated(self, shape: tuple[int, ...]) -> int:
        """The axis of the samples, as it is said or as MATLAB has it."""
        return 0 if self.form.samples == "rows" else len(shape) - 1

    def _axis(self, variable: MatVariable, length: int) -> int | None:
        """Along which axis a variable has so many samples, None for none; of a matrix of matrices along the last one
        that has."""
        shape = variable.shape
        if _is_vector(shape):
            return int(np.argmax(shape)) if int(np.prod(shape)) == length else None
        if self.form.samples is not None:
            axis = self._stated(shape)
            return axis if shape[axis] == length else None
        return max((k for k, n in enumerate(shape) if n == length), default=None)

    def _kept(self, arrays: Iterator[tuple[str, MatVariable | str]]) -> Iterator[tuple[str, MatVariable]]:
        for name, variable in arrays:
            if isinstance(variable, str):
                self.skipped[name] = variable
            elif int(np.prod(variable.shape)):
                yield name, variable

    def refuse_length(self, name: str, length: int) -> None:
        """Raises LogError where a variable of this name has another number of samples."""
        variable = self.variables.get(name)
        if variable is not None:
            raise LogError(
                f"{self.source}: the variable '{name}' holds {_size(variable.shape)} values; expected {length} samples "
                "as the time has"
            )
        if name in self.skipped:
            raise LogError(f"{self.source}: the variable '{name}' {self.skipped[name]}")


class _MatHeads(Heads):
    """The columns of one length of a file; a variable of another length is not missing."""

    def __init__(self, columns: Mapping[str, tuple[str, int, int]], file: MatFile, length: int) -> None:
        units = [file.variables[name].attributes.unit for name, _, _ in columns.values()]
        super().__init__(list(columns), file.source, units)
        self._file, self._samples = file, length

    def place(self, name: str) -> int:
        if name not in self.names:
            self._file.refuse_length(name, self._samples)
        elif (variable := self._file.variables.get(name.rpartition("[")[0])) is not None and (
            variable.shape == (self._samples, self._samples) and self._file.form.samples is None
        ):
            raise LogError(
                f"{self._file.source}: '{name}' is of a square matrix; say with samples whether they run along its "
                "rows or its columns"
            )
        return super().place(name)


def is_hdf5(path: Path) -> bool:
    """Whether it is HDF5, with or without the head of a MATLAB 7.3 file."""
    with open(path, "rb") as file:
        head = file.read(520)
    return head.startswith(b"\x89HDF") or head[512:516] == b"\x89HDF"


def _of_old(path: Path, form: LogForm) -> Iterator[tuple[str, MatVariable | str]]:
    from scipy.io import loadmat

    refuse_damaged(path, form)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of objects without a name, which are no numbers
            content = loadmat(str(path))
    except FileNotFoundError:
        raise
    except Exception as error:
        reason = " ".join(str(error).split())[:80]
        raise LogError(
            f"{shown(path)} cannot be read as a MATLAB file ({reason}); save it with -v7, or as CSV"
        ) from error
    for name, value in content.items():
        if not str(name).startswith("__") and name:
            yield from _flat(str(name), value)


def _flat(name: str, value: Any) -> Iterator[tuple[str, MatVariable | str]]:
    from scipy.io.matlab import MatlabFunction, MatlabObject, MatlabOpaque

    if isinstance(value, (MatlabFunction, MatlabObject, MatlabOpaque)):  # their fields are not what the object shows
        yield name, NO_NUMBERS
        return
    value = np.asarray(value)
    if value.dtype.names and value.size <= MOST_STRUCTS:
        for k, record in enumerate(value.ravel()):
            for member in value.dtype.names:
                yield from _flat(f"{name}.{member}" if value.size == 1 else f"{name}[{k}].{member}", record[member])
    elif value.dtype.kind in "biuf":
        yield name, MatVariable(value.shape or (1,), lambda: value)
    else:
        yield name, NO_NUMBERS


_NUMBERS = {b"double", b"single", b"logical"} | {f"{u}int{n}".encode() for u in ("u", "") for n in (8, 16, 32, 64)}


def _of_hdf5(path: Path, form: LogForm) -> Iterator[tuple[str, MatVariable | str]]:
    h5py = needed("h5py", f"{shown(path)} is a MATLAB 7.3 or HDF5 file")
    try:
        with h5py.File(path) as file:
            names: list[str] = []
            file.visit(names.append)
            yield from _links(h5py, file, names)
            for name in names:
                node = file[name]
                if name.startswith("#") or not hasattr(node, "shape"):
                    continue
                own = node.attrs.get("MATLAB_class")
                dotted = name.replace("/", ".")
                other = own is not None and (own not in _NUMBERS or "MATLAB_object_decode" in node.attrs)
                if node.dtype.kind not in "biuf" or node.attrs.get("MATLAB_empty") or other or node.shape is None:
                    yield dotted, NO_NUMBERS
                    continue
                said = {key: node.attrs[key] for key in node.attrs if own is None}
                attributes = attributes_of(said, f"{shown(path)}, variable '{dotted}'")
                shape = tuple(node.shape[::-1] if own is not None else node.shape) or (1,)
                yield dotted, MatVariable(shape, _loader(h5py, path, form, name, own is not None), attributes)
    except _DAMAGED as error:
        raise _damaged(path, error) from error


def _links(h5py: Any, file: Any, names: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Names that stand for something else, and what each leads to; an array of this file is read under its own name."""
    for group in ("", *names):
        node = file[group] if group else file
        if not isinstance(node, h5py.Group):
            continue
        for name in node:
            link = node.get(name, getlink=True)
            if isinstance(link, h5py.HardLink):
                continue
            dotted, path = f"{group}/{name}".strip("/").replace("/", "."), str(link.path)
            if isinstance(link, h5py.ExternalLink):
                said = f"is a link to '{path}' of {link.filename}"
                yield dotted, f"{said}; read that file, or write the numbers into this one"
            elif _leads(node, name):
                own = (path if path.startswith("/") else f"{group}/{path}").strip("/").replace("/", ".")
                yield dotted, f"is a link to '{own}' of this file; take that name"
            else:
                yield dotted, f"is a link to '{path}', where this file holds nothing; write the numbers into it"


def _leads(group: Any, name: str) -> bool:
    """Whether a link leads anywhere; links in a circle do not."""
    try:
        return name in group and group.get(name) is not None
    except _DAMAGED:
        return False


_DAMAGED = (OSError, RuntimeError, KeyError, ValueError, TypeError)  # what h5py raises of damaged files


def _damaged(path: Path, error: Exception) -> LogError:
    reason = " ".join(str(error).split())[:80]
    return LogError(f"{shown(path)} cannot be read as a MATLAB 7.3 file ({reason}); save it again")


def _loader(h5py: Any, path: Path, form: LogForm, name: str, turned: bool) -> Callable[[], np.ndarray]:
    def load() -> np.ndarray:
        try:
            with h5py.File(path) as file:
                node, what = file[name], f"the variable '{name}'"
                if node.external or node.is_virtual:
                    raise LogError(f"{shown(path)}: {what} stands in another file; write the numbers into this one")
                refuse_swollen(path, 8.0 * node.size, form, what)
                value = np.atleast_1d(np.asarray(node))
        except LogError:
            raise
        except _DAMAGED as error:
            raise _damaged(path, error) from error
        return value.T if turned else value

    return load


def _is_vector(shape: tuple[int, ...]) -> bool:
    return sum(n > 1 for n in shape) < 2


def _size(shape: tuple[int, ...]) -> str:
    return " x ".join(map(str, shape))
