"""Read Parquet files with pyarrow: flattens nested columns, reads fixed-size lists as vectors and time stamps as
seconds."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from .form import LogError, LogForm, needed, refuse_swollen, shown
from .heads import Attributes, Heads, attributes_of
from .stream import RowBlock, Stream


class ParquetStream(Stream):
    """The table of a Parquet file. The first column of time stamps is the clock, in seconds after its first stamp."""

    row: ClassVar[str] = "row"
    cell: ClassVar[str] = "column"

    def __init__(self, path: Path, form: LogForm) -> None:
        self._path, self._form = path, form
        self._arrow = needed("pyarrow", f"{shown(path)} is a Parquet file")
        self._compute = needed("pyarrow.compute", f"{shown(path)} is a Parquet file")
        parquet = needed("pyarrow.parquet", f"{shown(path)} is a Parquet file")
        with self._sound(shown(path)):
            self._file = parquet.ParquetFile(path)
            first = next(self._file.iter_batches(batch_size=1), None)
            columns = [] if first is None else list(_flat(self._arrow, self._compute, first, shown(path)))
        names: list[str] = []
        units: list[str] = []
        self._first, clock, stamps = 0, "", list[str]()
        for name, column, attributes in columns:
            names.append(name)
            units.append(attributes.unit)
            if self._arrow.types.is_timestamp(column.type):
                if not clock:  # common origin: nanoseconds since 1970 have more digits than a double
                    self._first = self._nanoseconds(shown(path), name, column)[0].as_py() or 0
                clock, units[-1] = clock or name, "s"
                stamps.append(name)
        super().__init__(
            shown(path), "", Heads(names, shown(path), units), clock, stamps=dict.fromkeys(stamps, self._first)
        )
        if clock:
            self.remarks.append(f"the time stamps '{clock}' are read as seconds after the first stamp")

    def blocks(self, columns: Sequence[str], *, gaps: bool = False) -> Iterator[RowBlock]:
        """See `Stream.blocks`."""
        places = [self.heads.place(name) for name in columns]
        total, begin = max(self._file.metadata.num_rows, 1), 0
        refuse_swollen(self._path, 8.0 * total * len(columns), self._form, "the declared columns")
        batches = self._file.iter_batches(batch_size=65_536)
        while True:
            with self._sound(self.source):
                batch = next(batches, None)
                parts = [] if batch is None else list(_flat(self._arrow, self._compute, batch, self.source))
            if batch is None:
                return
            values = np.empty((batch.num_rows, len(columns)))
            for j, (name, place) in enumerate(zip(columns, places, strict=True)):
                _, column, attributes = parts[place]
                values[:, j] = attributes.numbers(self._numbers(name, column, gaps))
                if not gaps and (bad := np.flatnonzero(~np.isfinite(values[:, j]))).size:
                    raise self.no_number(begin + int(bad[0]) + 1, name, values[bad[0], j])
            lines = np.arange(begin + 1, begin + 1 + len(values))
            begin += len(values)
            yield RowBlock(values, lines, begin / total)

    @contextmanager
    def _sound(self, source: str) -> Iterator[None]:
        """Turn exceptions of pyarrow about a damaged file into LogError."""
        try:
            yield
        except LogError:
            raise
        except (OSError, ValueError, self._arrow.ArrowException) as error:  # ValueError for damaged names
            reason = " ".join(str(error).split())[:80]
            raise LogError(f"{source} cannot be read as a Parquet file ({reason}); save it again") from error

    def _nanoseconds(self, source: str, name: str, column: Any) -> Any:
        """Return time stamps [ns since 1970]. Raises LogError if they do not fit in 64 bits."""
        try:
            return column.cast("timestamp[ns]").cast("int64")
        except self._arrow.ArrowInvalid:
            raise self._too_far(source, name) from None

    def _too_far(self, source: str, name: str) -> LogError:
        return LogError(
            f"{source}: the column '{name}' holds a time stamp beyond the years 1678 to 2261, or more than 292 years "
            "from the first one; remove such rows"
        )

    def _numbers(self, name: str, column: Any, gaps: bool) -> np.ndarray:
        types = self._arrow.types
        if types.is_timestamp(column.type):
            try:
                since = self._compute.subtract_checked(
                    self._nanoseconds(self.source, name, column), self._arrow.scalar(self._first, "int64")
                )
            except self._arrow.ArrowInvalid:
                raise self._too_far(self.source, name) from None
            return since.to_numpy(zero_copy_only=False).astype(float) * 1e-9  # empty cells become nan
        if not (types.is_integer(column.type) or types.is_floating(column.type) or types.is_boolean(column.type)):
            if gaps:
                return np.full(len(column), np.nan)
            raise LogError(f"{self.source}: the column '{name}' holds {column.type}; expected numbers")
        if types.is_boolean(column.type):
            column = column.cast("uint8")
        return column.cast("float64", safe=False).to_numpy(zero_copy_only=False)


def _flat(arrow: Any, compute: Any, batch: Any, source: str) -> Iterator[tuple[str, Any, Attributes]]:
    """Yield name, column and attributes; members of structs get dotted names, elements of fixed-size lists an index."""
    table = arrow.Table.from_batches([batch])
    while any(arrow.types.is_struct(t.type) for t in table.schema):
        table = table.flatten()
    for field, column in zip(table.schema, table.columns, strict=True):
        stored = {key.decode(errors="replace"): value for key, value in (field.metadata or {}).items()}
        attributes = attributes_of(stored, f"{source}, column '{field.name}'")
        array = column.combine_chunks()
        if arrow.types.is_fixed_size_list(field.type):
            for k in range(field.type.list_size):  # for a row without a list the element is empty, too
                yield f"{field.name}[{k}]", compute.list_element(array, k), attributes
        else:
            yield field.name, array, attributes
