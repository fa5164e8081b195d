"""Read MATLAB files of all versions, and HDF5. The elements of older files are checked before SciPy reads them."""

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
TYPES = NUMBERS | {MATRIX, 16, 17, 18}  # and matrices and texts
CLASSES = range(1, 18)  # cell, struct, object, char, sparse, numbers, function, opaque
CELL, CHAR, SPARSE, FUNCTION = 1, 4, 5, 16
OF_NUMBERS = range(5, FUNCTION)
CONTAINERS = (1, 2, 3)
SMALLEST = 8  # least bytes of a member of a cell or struct
DEEPEST = 100  # nesting depth
PIECE = 1 << 20
MOST_DIMENSIONS = 32

Read = Callable[[int], bytes]


def refuse_damaged(path: Path, form: LogForm = LogForm()) -> None:  # noqa: B008
    """Raise LogError if an element of a file has an unknown type, or is longer than the space for it."""
    with open(path, "rb") as file:
        head = file.read(HEAD)
        if len(head) < HEAD or 0 in head[:4]:
            return  # too short, or version 4, for which SciPy uses plain Python
        order = "<" if head[126:128] == b"IM" else ">"
        size = path.stat().st_size
        try:
            while (remaining := size - file.tell()) >= TAG:
                kind, length = struct.unpack(f"{order}II", _exactly(file.read, TAG))
                end, read = file.tell() + length, file.read
                if end > size:
                    raise _Damaged(f"an element of {length} bytes exceeds the remaining {remaining - TAG}")
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
    """The fault in a few words."""


class _Inflated:
    """Reads the bytes of a compressed element; decompresses only as much as is read."""

    def __init__(self, file: BinaryIO, length: int) -> None:
        self._file, self._unread, self._inflate, self._buffer = file, length, zlib.decompressobj(), b""

    def __call__(self, count: int) -> bytes:
        while len(self._buffer) < count and not self._inflate.eof:
            piece = self._inflate.unconsumed_tail
            if not piece:
                piece = self._file.read(min(PIECE, self._unread))
                self._unread -= len(piece)
            if not piece:
                break
            try:
                self._buffer += self._inflate.decompress(piece, PIECE)
            except zlib.error as error:
                raise _Damaged(f"its data do not decompress: {error}") from error
        data, self._buffer = self._buffer[:count], self._buffer[count:]
        return data


def _element(read: Read, kind: int, length: int, order: str, depth: int) -> None:
    """Check an element and its contents; the numbers at the end of the outermost element are not read."""
    if kind not in TYPES:
        raise _Damaged(f"an element has the unknown type {kind}")
    if kind != MATRIX or not length:  # an empty member of a cell
        return
    if depth > DEEPEST:
        raise _Damaged(f"structures are nested more than {DEEPEST} deep")
    remaining, array, number, needed = length, 0, 0, 1  # bytes, class of the array, elements read and required
    while remaining >= TAG:
        word, size = struct.unpack(f"{order}II", tag := _exactly(read, TAG))
        remaining -= TAG
        data = b""
        if small := word >> 16:  # up to four bytes within the tag
            word, size, data = word & 0xFFFF, 0, tag[4 : 4 + small]
        if size > remaining or small > 4:
            raise _Damaged(f"an element of {size or small} bytes exceeds the remaining {remaining if size else 4}")
        if word not in (NUMBERS if array in OF_NUMBERS and number > 2 else TYPES):  # a name may have any text type
            raise _Damaged(f"an element has the wrong type {word}")
        padded = min(-(-size // 8) * 8, remaining)
        number += 1
        if number == 1:
            if size != 8 or word != 6:
                raise _Damaged("an array does not state its class")
            array, needed = _class_of(_exactly(read, padded), order)
        elif number == 2 and array < FUNCTION:  # functions and objects have no size
            count = _count(data or _exactly(read, padded)[:size], array, remaining - padded, order)
            needed += count if array == CELL else 0
        elif word == MATRIX:
            _element(read, word, size, order, depth + 1)
            _skip(read, padded - size)
        elif padded == remaining and not depth and number >= needed:
            return  # the numbers themselves
        else:
            _skip(read, padded)
        remaining -= padded
    if number < needed:
        raise _Damaged("an array lacks some of its elements")


def _class_of(flags: bytes, order: str) -> tuple[int, int]:
    """Return the class of a MATLAB array, and how many elements its record has at least: flags, size, name, data."""
    word = struct.unpack(f"{order}I", flags[:4])[0]
    array = word & 0xFF
    if array not in CLASSES:
        raise _Damaged(f"an array has the unknown class {array}")
    if array not in OF_NUMBERS:
        return array, 4 if array == CHAR else 3
    return array, (6 if array == SPARSE else 4) + (word >> 11 & 1)


def _count(sizes: bytes, array: int, remaining: int, order: str) -> int:
    """Return the number of members of an array. Raises _Damaged for too many dimensions, and if the remaining bytes
    cannot hold so many members of a cell or struct."""
    if len(sizes) % 4 or not 4 <= len(sizes) <= 4 * MOST_DIMENSIONS:
        raise _Damaged(f"the size of an array takes {len(sizes)} bytes")
    count = 1
    for n in struct.unpack(f"{order}{len(sizes) // 4}i", sizes):
        count *= n
        if n < 0 or (array in CONTAINERS and count * SMALLEST > max(remaining, SMALLEST)):
            raise _Damaged(f"an array has {n} rows or columns")
    return count


def _exactly(read: Read, count: int) -> bytes:
    data = read(count)
    if len(data) < count:
        raise _Damaged("it ends within an element")
    return data


def _skip(read: Read, count: int) -> None:
    while count > 0:
        count -= len(_exactly(read, min(count, PIECE)))


MOST_COMPONENTS = 64  # of a signal; a matrix with more rows and columns is a picture or a map
SHORTEST = 3  # samples; shorter vectors are parameters
MOST_STRUCTS = 100  # in an array of structs
NO_NUMBERS = "holds no numbers; save the numbers of a text, a cell or an object such as a timetable as arrays"


class MatVariable(NamedTuple):
    """An array of numbers in a file: its shape in MATLAB, the function that loads it, and its attributes."""

    shape: tuple[int, ...]
    load: Callable[[], np.ndarray]
    attributes: Attributes = Attributes()


class MatFile:
    """The numeric arrays of a MATLAB file by name; `rec.q` is a member of a struct.

    The components of an array of matrices, (4, 4, n), are numbered row by row.

    `skipped`: name -> reason why a variable is not an array of numbers. Raises LogError if the file cannot be read.
    """

    def __init__(self, path: Path, form: LogForm) -> None:
        self.source, self.form = shown(path), form
        self.skipped: dict[str, str] = {}
        read = _of_hdf5 if is_hdf5(path) else _of_old
        self.variables: dict[str, MatVariable] = dict(self._numeric(read(path, form)))
        if not self.variables:
            link = next((f"; '{name}' {reason}" for name, reason in self.skipped.items() if reason != NO_NUMBERS), "")
            raise LogError(f"{self.source} holds no array of numbers{link}")

    def streams(self) -> list[ArrayStream]:
        """Return one table for each number of samples, the longest first, without variables of fewer than 3 samples."""
        lengths: dict[int, None] = {}
        for variable in self.variables.values():
            lengths[self._length(variable)] = None
        return [self.stream(n) for n in sorted(lengths, reverse=True) if n >= SHORTEST]

    def of_time(self, time: str) -> ArrayStream:
        """Return the table of the variables that have as many samples as this time."""
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
        """Return the table of the variables with this number of samples."""
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
        """Return the probable number of samples of a variable, without knowledge of the time."""
        shape = variable.shape
        if _is_vector(shape):
            return int(np.prod(shape))
        if len(shape) > 2 or self.form.samples is not None:
            return shape[self._stated(shape)]
        vectors = {int(np.prod(v.shape)) for v in self.variables.values() if _is_vector(v.shape)}
        short, long = sorted(shape)
        # usually there are more samples than components
        return short if short in vectors and long not in vectors and long <= MOST_COMPONENTS else long

    def _stated(self, shape: tuple[int, ...]) -> int:
        """Return the axis of the samples as declared; default: the last axis."""
        return 0 if self.form.samples == "rows" else len(shape) - 1

    def _axis(self, variable: MatVariable, length: int) -> int | None:
        """Return the last axis along which a variable has this number of samples, or None."""
        shape = variable.shape
        if _is_vector(shape):
            return int(np.argmax(shape)) if int(np.prod(shape)) == length else None
        if self.form.samples is not None:
            axis = self._stated(shape)
            return axis if shape[axis] == length else None
        return max((k for k, n in enumerate(shape) if n == length), default=None)

    def _numeric(self, arrays: Iterator[tuple[str, MatVariable | str]]) -> Iterator[tuple[str, MatVariable]]:
        for name, variable in arrays:
            if isinstance(variable, str):
                self.skipped[name] = variable
            elif int(np.prod(variable.shape)):
                yield name, variable

    def refuse_length(self, name: str, length: int) -> None:
        """Raise LogError if the variable has another number of samples, or is not an array of numbers."""
        variable = self.variables.get(name)
        if variable is not None:
            raise LogError(
                f"{self.source}: the variable '{name}' holds {_size(variable.shape)} values; expected {length} "
                "samples, as many as the time"
            )
        if name in self.skipped:
            raise LogError(f"{self.source}: the variable '{name}' {self.skipped[name]}")


class _MatHeads(Heads):
    """The columns with one number of samples; the message about a variable of another length states its size."""

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
                f"{self._file.source}: '{name}' belongs to a square matrix; set samples to the direction of its samples"
            )
        return super().place(name)


def is_hdf5(path: Path) -> bool:
    """Return whether the file is HDF5, with or without the header of MATLAB 7.3."""
    with open(path, "rb") as file:
        head = file.read(520)
    return head.startswith(b"\x89HDF") or head[512:516] == b"\x89HDF"


def _of_old(path: Path, form: LogForm) -> Iterator[tuple[str, MatVariable | str]]:
    from scipy.io import loadmat

    refuse_damaged(path, form)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about objects without a name
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

    if isinstance(value, (MatlabFunction, MatlabObject, MatlabOpaque)):  # their fields are internal
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
                matlab = node.attrs.get("MATLAB_class")
                dotted = name.replace("/", ".")
                other = matlab is not None and (matlab not in _NUMBERS or "MATLAB_object_decode" in node.attrs)
                if node.dtype.kind not in "biuf" or node.attrs.get("MATLAB_empty") or other or node.shape is None:
                    yield dotted, NO_NUMBERS
                    continue
                stored = {key: node.attrs[key] for key in node.attrs if matlab is None}
                attributes = attributes_of(stored, f"{shown(path)}, variable '{dotted}'")
                shape = tuple(node.shape[::-1] if matlab is not None else node.shape) or (1,)
                yield dotted, MatVariable(shape, _loader(h5py, path, form, name, matlab is not None), attributes)
    except _DAMAGED as error:
        raise _damaged(path, error) from error


def _links(h5py: Any, file: Any, names: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Yield the names of links, each with a description of its target; arrays are read under their own names only."""
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
                target = f"'{path}' of {link.filename}"
                yield dotted, f"is a link to {target}; read that file, or write the numbers into this one"
            elif _leads(node, name):
                target = (path if path.startswith("/") else f"{group}/{path}").strip("/").replace("/", ".")
                yield dotted, f"is a link to '{target}' of this file; use that name"
            else:
                yield dotted, f"is a link to '{path}', which this file does not contain; write the numbers into it"


def _leads(group: Any, name: str) -> bool:
    """Return whether a link has a target; circular links have none."""
    try:
        return name in group and group.get(name) is not None
    except _DAMAGED:
        return False


_DAMAGED = (OSError, RuntimeError, KeyError, ValueError, TypeError)  # exceptions of h5py for damaged files


def _damaged(path: Path, error: Exception) -> LogError:
    reason = " ".join(str(error).split())[:80]
    return LogError(f"{shown(path)} cannot be read as a MATLAB 7.3 file ({reason}); save it again")


def _loader(h5py: Any, path: Path, form: LogForm, name: str, turned: bool) -> Callable[[], np.ndarray]:
    def load() -> np.ndarray:
        try:
            with h5py.File(path) as file:
                node, label = file[name], f"the variable '{name}'"
                if node.external or node.is_virtual:
                    raise LogError(f"{shown(path)}: {label} is stored in another file; write the numbers into this one")
                refuse_swollen(path, 8.0 * node.size, form, label)
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
