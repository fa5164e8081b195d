"""A stream: one table of a file, read in blocks, so that a file larger than the memory can be read."""

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

MOST_SHOWN = 40  # letters of a cell in a message
_GROWTH = 1.25


class RowBlock(NamedTuple):
    """Some rows: values (m, k), the number of each in the file, and the part of the file read so far, 0 to 1."""

    values: Array
    lines: np.ndarray
    fraction: float


class Lines:
    """The number of each row in its file, from 1: runs of consecutive numbers take no memory.

    >>> from gtmodel.measurements.streams.stream import Lines
    >>> lines = Lines()
    >>> lines.extend(np.array([3, 4, 7]))
    >>> lines[2], lines.array().tolist()
    (7, [3, 4, 7])
    """

    def __init__(self) -> None:
        self._rows, self._offsets, self._count = [0], [1], 0

    def extend(self, lines: np.ndarray) -> None:
        """Further rows behind those that are there."""
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
        """All of them."""
        runs = np.diff([*self._rows, self._count])
        return np.arange(self._count) + np.repeat(self._offsets, runs)


@dataclass(frozen=True, eq=False)
class TableRows:
    """What was read: values by name, (n, k) or (n,), all with one row for each of `lines`."""

    values: dict[str, Array]
    lines: Lines


@dataclass(eq=False)
class Stream(ABC):
    """One table of a file: a CSV file, the variables of equal length of a MATLAB file, a topic of a bag.

    name: "" where the file has only one. heads: its columns. clock: the column that the file itself has for time [s],
    "" for none. stamps: columns that count from an instant, and that instant [ns since 1970]. remarks: what was
    recognised, in sentences. comments: of a text file, what its lines "# title:", "# synthetic:" say. words: of columns
    that were read with `gaps`, where a word stands among numbers: the line of the first, the word, and what to do.
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
    """what a row is called"""
    cell: ClassVar[str] = "variable"
    """what a column is called where a cell is wrong"""

    @abstractmethod
    def blocks(self, columns: Sequence[str], *, gaps: bool = False) -> Iterator[RowBlock]:
        """The rows of these columns, in order.

        gaps: what is no finite number is NaN; otherwise it raises LogError with its line.
        """

    def texts(self, column: str) -> list[str]:
        """The cells of a column; numbers as short as they can be written."""
        return [f"{x:.17g}" for block in self.blocks([column]) for x in block.values[:, 0]]

    def read(
        self,
        groups: Mapping[str, Sequence[str]],
        change: Callable[[str, Array], Array] | None = None,
        *,
        gaps: bool = False,
        progress: Progress = silent,
    ) -> TableRows:
        """Columns by group, (n, k).

        change: makes (group, (m, k) as written) the numbers that are kept, such as SI.

        Raises LogError for a file without rows and as `blocks` does.
        """
        flat = [column for members in groups.values() for column in members]
        ends = np.cumsum([len(members) for members in groups.values()]).tolist()
        places = dict(zip(groups, map(slice, [0, *ends[:-1]], ends), strict=True))
        kept = {name: np.empty((0, len(members))) for name, members in groups.items()}
        lines, capacity = Lines(), 0
        for block in self.blocks(flat, gaps=gaps):
            begin, end = len(lines), len(lines) + len(block.values)
            if end > capacity:
                # what is left grows with it, so that a small file takes no more than it needs
                capacity = max(end, int(_GROWTH * begin), int(1.02 * end / max(block.fraction, 0.02)))
                for values in kept.values():
                    values.resize((capacity, values.shape[1]), refcheck=False)
            for name, values in kept.items():
                part = block.values[:, places[name]]
                values[begin:end] = part if change is None else change(name, part)
            lines.extend(block.lines)
            progress(f"reading {self.source}", block.fraction)
        if not lines:
            raise LogError(f"{self.heads.where} has a header but no rows; expected a row of numbers for each time")
        for values in kept.values():
            values.resize((len(lines), values.shape[1]), refcheck=False)
        return TableRows(kept, lines)

    def no_number(self, line: int, column: str, cell: object, advice: str = "") -> LogError:
        """What is said of a cell that is no finite number."""
        text = str(cell).strip()
        kind = NoNumberError if text.lower() in ("", "nan", "nothing") else LogError
        text = repr(text if len(text) <= MOST_SHOWN else f"{text[:MOST_SHOWN]}...") if text else "nothing"
        return kind(
            f"{self.source} {self.row} {line}, {self.cell} '{column}': found {text}; "
            f"expected a finite number such as 1.5e-3{advice}"
        )


class ArrayStream(Stream):
    """Columns that are in memory, or read one by one.

    load: column -> (n,) numbers.
    """

    def __init__(self, source: str, name: str, heads: Heads, load: Callable[[str], np.ndarray]) -> None:
        super().__init__(source, name, heads)
        self._load = load

    def blocks(self, columns: Sequence[str], *, gaps: bool = False) -> Iterator[RowBlock]:
        """All rows at once, see `Stream.blocks`."""
        values = np.column_stack([self._numbers(column, gaps) for column in columns])
        yield RowBlock(values, np.arange(1, len(values) + 1), 1.0)

    def _numbers(self, column: str, gaps: bool) -> Array:
        raw = self._load(self.heads.names[self.heads.place(column)])
        if raw.dtype.kind in "iu" and raw.size and max(abs(int(raw.max())), abs(int(raw.min()))) > 2**53:
            raise LogError(
                f"{self.source}, {self.cell} '{column}': {int(raw.max())} has more digits than a double; "
                "subtract the first one before it is written"
            )
        values = raw.astype(float)
        if not gaps and (bad := np.flatnonzero(~np.isfinite(values))).size:
            raise self.no_number(int(bad[0]) + 1, column, float(values[bad[0]]))
        return values
