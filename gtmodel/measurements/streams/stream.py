"""A stream: one table of a file, read in blocks, so that the file may be larger than the memory."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar, NamedTuple

import numpy as np

from ...results.trajectory_checks import Array
from ...results.work import Progress, silent
from .form import LogError, NoNumberError
from .heads import Heads

MOST_SHOWN = 40  # characters of a cell in a message
_GROWTH = 1.25


class RowBlock(NamedTuple):
    """A block of rows: values (m, k), line numbers, and the fraction of the file read so far, 0 to 1."""

    values: Array
    lines: np.ndarray
    fraction: float


class Lines:
    """Line numbers of the rows of a file, from 1, stored as runs of consecutive numbers.

    >>> from gtmodel.measurements.streams.stream import Lines
    >>> lines = Lines()
    >>> lines.extend(np.array([3, 4, 7]))
    >>> lines[2], lines.array().tolist()
    (7, [3, 4, 7])
    """

    def __init__(self) -> None:
        self._rows, self._offsets, self._count = [0], [1], 0

    def extend(self, lines: np.ndarray) -> None:
        """Append line numbers."""
        offsets = lines - np.arange(self._count, self._count + len(lines))
        stops = np.flatnonzero(np.diff(offsets, prepend=self._offsets[-1]))
        self._rows += (stops + self._count).tolist()
        self._offsets += offsets[stops].tolist()
        self._count += len(lines)

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, row: int) -> int:
        return int(row) + self._offsets[int(np.searchsorted(self._rows, row, side="right")) - 1]

    def array(self) -> np.ndarray:
        """Return all line numbers."""
        runs = np.diff([*self._rows, self._count])
        return np.arange(self._count) + np.repeat(self._offsets, runs)


@dataclass(frozen=True, eq=False)
class TableRows:
    """Values by name, (n, k) or (n,), with one row for each of `lines`."""

    values: dict[str, Array]
    lines: Lines


@dataclass(eq=False)
class Stream(ABC):
    """One table of a file: a CSV file, the variables of equal length of a MATLAB file, a topic of a bag.

    name: "" if the file has a single table. heads: the columns. clock: time column [s] defined by the file format, or
    "". stamps: columns of absolute times -> their origin [ns since 1970]. remarks: sentences on what was
    recognised. comments: comments of a text file such as "# title:" and "# synthetic:". words: for columns read with
    `gaps` that contain words: line of the first word, the word, and advice.
    """

    source: str
    name: str
    heads: Heads
    clock: str = ""
    stamps: dict[str, int] = field(default_factory=dict)
    remarks: list[str] = field(default_factory=list)
    comments: dict[str, list[str]] = field(default_factory=dict)
    words: dict[str, tuple[int, str, str]] = field(default_factory=dict)

    row: ClassVar[str] = "sample"
    """term for a row"""
    cell: ClassVar[str] = "variable"
    """term for a column in messages"""

    @abstractmethod
    def blocks(self, columns: Sequence[str], *, gaps: bool = False) -> Iterator[RowBlock]:
        """Yield the rows of these columns, in order.

        gaps: read cells without a finite number as NaN; otherwise they raise LogError with the line.
        """

    def above(self) -> list[str]:
        """Return the lines of a text file above its table."""
        return []

    def texts(self, column: str) -> list[str]:
        """Return the cells of a column as text."""
        return [f"{x:.17g}" for block in self.blocks([column]) for x in block.values[:, 0]]

    def read(
        self,
        groups: Mapping[str, Sequence[str]],
        change: Callable[[str, Array], Array] | None = None,
        *,
        gaps: bool = False,
        progress: Progress = silent,
    ) -> TableRows:
        """Read columns by group, (n, k).

        change: converts (group, values (m, k) as stored) to the returned values, for example to SI units.

        Raises LogError if the file has no rows, and as `blocks` does.
        """
        flat = [column for members in groups.values() for column in members]
        ends = np.cumsum([len(members) for members in groups.values()]).tolist()
        places = dict(zip(groups, map(slice, [0, *ends[:-1]], ends), strict=True))
        buffers = {name: np.empty((0, len(members))) for name, members in groups.items()}
        lines, capacity = Lines(), 0
        for block in self.blocks(flat, gaps=gaps):
            begin, end = len(lines), len(lines) + len(block.values)
            if end > capacity:
                # extrapolate from the fraction read, so that small files take little memory
                capacity = max(end, int(_GROWTH * begin), int(1.02 * end / max(block.fraction, 0.02)))
                for values in buffers.values():
                    values.resize((capacity, values.shape[1]), refcheck=False)
            for name, values in buffers.items():
                part = block.values[:, places[name]]
                values[begin:end] = part if change is None else change(name, part)
            lines.extend(block.lines)
            progress(f"reading {self.source}", block.fraction)
        if not lines:
            raise LogError(f"{self.heads.where} has a header but no rows; expected at least one row of numbers")
        for values in buffers.values():
            values.resize((len(lines), values.shape[1]), refcheck=False)
        return TableRows(buffers, lines)

    def no_number(self, line: int, column: str, cell: object, advice: str = "") -> LogError:
        """Return the error for a cell without a finite number."""
        text = str(cell).strip()
        absent = text.lower() in ("", "nan", "nothing")
        description = (
            f"found {text[:MOST_SHOWN]!r}" if len(text) <= MOST_SHOWN else f"found {text[:MOST_SHOWN] + '...'!r}"
        )
        error = (NoNumberError if absent else LogError)(
            f"{self.source} {self.row} {line}, {self.cell} '{column}': {description if text else 'the cell is empty'}; "
            f"expected a finite number such as 1.5e-3{advice}"
        )
        if isinstance(error, NoNumberError):
            error.line = line
        return error


class ArrayStream(Stream):
    """Columns in memory, or loaded one by one.

    load: column -> (n,) numbers.
    """

    def __init__(self, source: str, name: str, heads: Heads, load: Callable[[str], np.ndarray]) -> None:
        super().__init__(source, name, heads)
        self._load = load

    def blocks(self, columns: Sequence[str], *, gaps: bool = False) -> Iterator[RowBlock]:
        """Yield all rows in one block, see `Stream.blocks`."""
        values = np.column_stack([self._numbers(column, gaps) for column in columns])
        yield RowBlock(values, np.arange(1, len(values) + 1), 1.0)

    def _numbers(self, column: str, gaps: bool) -> Array:
        raw = self._load(self.heads.names[self.heads.place(column)])
        if raw.dtype.kind in "iu" and raw.size and max(abs(int(raw.max())), abs(int(raw.min()))) > 2**53:
            raise LogError(
                f"{self.source}, {self.cell} '{column}': {int(raw.max())} has more digits than a double; "
                "subtract the first value before you write the file"
            )
        values = raw.astype(float)
        if not gaps and (bad := np.flatnonzero(~np.isfinite(values))).size:
            raise self.no_number(int(bad[0]) + 1, column, float(values[bad[0]]))
        return values
