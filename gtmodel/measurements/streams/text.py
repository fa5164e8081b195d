"""Text files with columns: recognises delimiter and header, and reads the numbers in blocks."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np

from .form import SIGNS, Delimiter, FormError, LogError, LogForm, shown
from .heads import MOST_NAMES, Heads, is_unit, spelled
from .stream import RowBlock, Stream
from .text_lines import Chunk, chunks, encoding_of, is_row

LOOKED_AT = 50  # first rows, from which the delimiter and the header are recognised
LIKE = 3  # rows below a line with as many cells that make it the header
MINUS = "\N{MINUS SIGN}"  # typographic minus
# cells without a measurement; any other word in a column of numbers is reported
_ABSENT = {"", "nan", "na", "n/a", "#n/a", "null", "none", "nil", "-", "--", "?", "inf", "-inf", "+inf", "infinity"}
_NOTES = ("title", "synthetic", "provenance", "scalar")
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")
_WITH_COMMA = re.compile(r"[+-]?\d+(,\d+)?([eE][+-]?\d+)?")
_QUOTED = re.compile(r'"\s*([+-]?\d+,\d+(?:[eE][+-]?\d+)?)\s*"')  # a quoted number with a comma
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")
_POINT = re.compile(r"(?:^|[,\s\"])[+-]?\d*\.\d")
_STAMP = re.compile(r"(\d{4}-\d\d-\d\d|\d{1,2}\.\d{1,2}\.\d{4})[T ]\d\d:\d\d(:\d\d([.,]\d{1,9})?)?Z?")
_DAY_FIRST = re.compile(r"(\d{1,2})\.(\d{1,2})\.(\d{4})(?=[T ])")  # 12.11.2026
_DATE = re.compile(r"\d{4}-\d\d-\d\d.*|\d{1,2}[./]\d{1,2}[./]\d{2,4}.*|\d{1,2}:\d\d([:.]\d.*)?")


class TextStream(Stream):
    """A text file with columns, such as CSV. Raises LogError with the line if the file is not a table."""

    row: ClassVar[str] = "line"
    cell: ClassVar[str] = "column"

    def __init__(self, path: Path, form: LogForm) -> None:
        self.path, self.layout = path, _layout(path, form)
        layout = self.layout
        stamps = {layout.heads.names[place]: zero for place, zero in layout.stamps.items()}
        super().__init__(shown(path), "", layout.heads, next(iter(stamps), ""), stamps, layout.remarks, layout.comments)

    def blocks(self, columns: Sequence[str], *, gaps: bool = False) -> Iterator[RowBlock]:
        """See `Stream.blocks`."""
        places = [self.heads.place(name) for name in columns]
        for chunk in chunks(self.path, self.layout.encoding):
            lines, numbers = self._rows(chunk)
            if not lines:
                continue
            values = self._fast(lines, places, gaps)
            if values is None:
                values = self._slow(lines, numbers, places, columns, gaps, cut=chunk.fraction >= 1 and not chunk.ended)
            yield RowBlock(values, numbers, chunk.fraction)

    def texts(self, column: str) -> list[str]:
        """See `Stream.texts`."""
        place = self.heads.place(column)
        return [row[place] for _, row in self.cells()]

    def above(self) -> list[str]:
        """See `Stream.above`."""
        first = next(chunks(self.path, self.layout.encoding), None)
        return [] if first is None else first.lines[: self.layout.first_row - 1]

    def cells(self) -> Iterator[tuple[int, list[str]]]:
        """Yield line number and cells of each row."""
        for chunk in chunks(self.path, self.layout.encoding):
            lines, numbers = self._rows(chunk)
            for n, line in zip(numbers.tolist(), lines, strict=True):
                yield n, self._split(line, n)

    def _rows(self, chunk: Chunk) -> tuple[list[str], np.ndarray]:
        """Return the rows below the header, and their line numbers."""
        layout, first, lines = self.layout, chunk.first, chunk.lines
        if first < layout.first_row:
            lines = lines[layout.first_row - first :]
            first = layout.first_row
        if any(mark in chunk.text for mark in ("#", "%", "//", "\n\n", "\n \n")) or not all(map(str.strip, lines)):
            rows = [(first + k, line) for k, line in enumerate(lines) if is_row(line)]
            return [line for _, line in rows], np.array([n for n, _ in rows], dtype=np.int64)
        return lines, np.arange(first, first + len(lines))

    def _fast(self, lines: list[str], places: list[int], gaps: bool) -> np.ndarray | None:
        """Return the numbers of plain rows; None if rows must be parsed one by one."""
        layout, sign = self.layout, self.layout.sign
        if sign == " ":
            if any(len(line.split()) != layout.width for line in lines):
                return None
        elif any(line.count(sign) != layout.width - 1 for line in lines):
            return None
        if any('"' in line for line in lines):
            return None
        values = np.full((len(lines), len(places)), np.nan)
        try:
            for j, place in enumerate(places):
                if place in layout.stamps:
                    values[:, j] = self._seconds(lines, place)
        except ValueError:
            return None
        plain = [j for j, p in enumerate(places) if p not in layout.stamps and not (gaps and p in layout.words)]
        if layout.decimal_comma or (gaps and sign != " "):
            text = "\n".join(["", *lines, ""])
            if layout.decimal_comma:
                if "." in text:  # a thousands separator or a mistake
                    return None
                text = text if sign == "," else text.replace(",", ".")  # such numbers are quoted
            if gaps and sign != " ":
                empty = f"{sign}nan{sign}"
                text = text.replace(sign * 2, empty).replace(sign * 2, empty)
                text = text.replace(f"\n{sign}", f"\nnan{sign}").replace(f"{sign}\n", f"{sign}nan\n")
            lines = text.split("\n")[1:-1]
        cut, used = None if sign == " " else sign, [places[j] for j in plain]
        try:
            if plain:
                values[:, plain] = np.loadtxt(lines, delimiter=cut, usecols=used, comments=None, ndmin=2)
        except ValueError:
            return None
        if gaps:
            values[~np.isfinite(values)] = np.nan
        elif not np.isfinite(values).all():
            return None
        return values

    def _seconds(self, lines: list[str], place: int) -> np.ndarray:
        """Return a column of dates in seconds after the first date. Raises ValueError for a cell that is not a date."""
        sign = self.layout.sign
        cells = (line.split(None if sign == " " else sign, place + 1)[place] for line in lines)
        stamps = np.array([_iso(cell) for cell in cells], dtype="datetime64[ns]")
        return np.where(np.isnat(stamps), np.nan, (stamps.astype(np.int64) - self.layout.stamps[place]) * 1e-9)

    def _slow(
        self, lines: list[str], numbers: np.ndarray, places: list[int], columns: Sequence[str], gaps: bool, cut: bool
    ) -> np.ndarray:
        """Parse rows one by one. Raises LogError for the first cell that is not a number."""
        values = np.empty((len(lines), len(places)))
        for k, (line, n) in enumerate(zip(lines, numbers.tolist(), strict=True)):
            cells = self._split(line, n, cut and k == len(lines) - 1, gaps)
            for j, place in enumerate(places):
                try:
                    if place in self.layout.stamps:
                        values[k, j] = _nanoseconds(cells[place], self.layout.stamps[place]) * 1e-9
                    else:
                        values[k, j] = number(cells[place], self.layout.decimal_comma)
                except ValueError:
                    values[k, j] = math.nan
                if not math.isfinite(values[k, j]):
                    values[k, j] = math.nan
                    word = cells[place].strip()
                    if gaps and place not in self.layout.words and word.lower() not in _ABSENT:
                        self.words.setdefault(columns[j], (n, word, self._advice(word)))
                    if not gaps:
                        advice = self._advice(cells[place])
                        if not advice and _only_words(cells, self.layout):
                            advice = '; if the line is no row, empty_rows = "drop" leaves it out'
                        raise self.no_number(n, columns[j], cells[place], advice)
        return values

    def _split(self, line: str, n: int, cut: bool = False, gaps: bool = False) -> list[str]:
        """Return the cells of a row. Raises LogError for a wrong number of cells.

        cut: the file may end within the row. gaps: cells may be empty, and all cells of an unfinished row are.
        """
        width, where = self.layout.width, f"{self.source} line {n}"
        cells = split(line, self.layout.sign, where)
        if len(cells) == width + 1 and not cells[-1]:
            cells.pop()
        if len(cells) == width - 1 and not self.heads.names[-1]:
            cells.append("")
        if len(cells) != width:
            ends = f"the file ends within this row, with {len(cells)} of {width} cells"
            if cut and gaps and len(cells) < width:
                self.remarks.append(f"line {n}: {ends}; they count as empty")
                return [""] * width
            if cut:
                raise LogError(f'{where}: {ends}; delete the line, or set empty_rows = "drop"')
            count = "one cell" if len(cells) == 1 else f"{len(cells)} cells"
            wordy = width > 1 and _only_words(cells, self.layout)
            if gaps and wordy:
                if sum("holds no number" in remark for remark in self.remarks) < MOST_NAMES:
                    self.remarks.append(
                        f'line {n}, {line.strip()[:40]!r}, holds no number: empty_rows = "drop" leaves it out'
                    )
                return [""] * width
            other = '; empty_rows = "drop" leaves such lines out' if wordy else ""
            if width == 1 and all(_like_number(cell, self.layout) for cell in cells):
                other = "; if the table begins here without column names, begin the lines above it with #"
            elif width == 1:
                other = f"; if line {n} holds the column names, set header = {n}"
            raise LogError(f"{where}: found {count}; expected {width}, one for each column of the header{other}")
        return cells

    def _advice(self, cell: str) -> str:
        if not self.layout.decimal_comma and _DECIMAL_COMMA.fullmatch(cell.strip()):
            return '; if the file has decimal commas, set decimal = "comma"'
        if _DATE.fullmatch(cell.strip()):
            return (
                "; it is a date or a time of day: write seconds or dates such as 2026-11-12T08:14:27, or set the "
                "sample time instead of the column"
            )
        if self.layout.decimal_comma and re.fullmatch(r"[+-]?\d+\.\d+.*", cell.strip()):
            return '; decimal = "comma" is set, but this number has a point'
        return ""


@dataclass
class _Layout:
    """Recognised layout of a text file."""

    encoding: str
    sign: str = ","
    decimal_comma: bool = False
    heads: Heads = field(default_factory=lambda: Heads([], ""))
    width: int = 0
    first_row: int = 1  # line of the first row
    stamps: dict[int, int] = field(default_factory=dict)  # columns of dates -> first date [ns since 1970]
    words: set[int] = field(default_factory=set)  # columns without numbers
    commas: list[str] = field(default_factory=list)  # columns that seem to contain decimal commas
    remarks: list[str] = field(default_factory=list)
    comments: dict[str, list[str]] = field(default_factory=lambda: {key: [] for key in _NOTES})


def number(cell: str, decimal_comma: bool = False) -> float:
    """Parse a number, nan or inf. Raises ValueError for anything else, also for Python's 1_000."""
    if "_" in cell or (decimal_comma and "." in cell):
        raise ValueError(f"'{cell}' is not a number")
    return float((cell.replace(",", ".") if decimal_comma else cell).replace(MINUS, "-"))


def split(line: str, sign: str, where: str) -> list[str]:
    """Return the stripped cells of a line. Raises LogError for a quote that is not closed."""
    if '"' not in line:
        return line.split() if sign == " " else [cell.strip() for cell in line.split(sign)]
    try:
        reader = csv.reader([line], delimiter=sign, strict=True, skipinitialspace=sign == " ")
        return [cell.strip() for cell in next(reader)]
    except csv.Error as error:
        raise LogError(
            f'{where}: a quote (") is not closed before the next delimiter or the end of the line; close or remove it'
        ) from error


def _layout(path: Path, form: LogForm) -> _Layout:
    layout = _Layout(encoding_of(path, form), decimal_comma=form.decimal == "comma")
    rows, comments = _head(path, layout, form)
    if not rows and form.header:
        raise LogError(f"{shown(path)} has no line {form.header} with column names and rows below it")
    if not rows:
        raise LogError(f"{shown(path)} is empty; expected a header such as 'time [s],q[0] [m]' and rows")
    layout.sign = _sign([line for _, line in rows], form, layout)
    _refuse_blanks_and_commas([line for _, line in rows], layout, path, form)
    quoted = [cell for _, line in rows for cell in _QUOTED.findall(line)] if layout.sign == "," else []
    if not layout.decimal_comma and _with_decimal_commas(quoted, [line for _, line in rows]):
        layout.decimal_comma = True
        layout.remarks.append(f'quoted numbers have decimal commas, such as "{quoted[0]}"')
    if layout.sign == "," and layout.decimal_comma and not quoted:
        raise LogError(f"{shown(path)}: a comma cannot be both decimal separator and delimiter; name the delimiter")
    tables = [(n, _header_cells(line, layout.sign, f"{shown(path)} line {n}")) for n, line in rows]
    n, cells = tables[0]
    where = f"{shown(path)} line {n}"
    has_header = not _numeric(cells, layout.decimal_comma) if form.header is None else form.header > 0
    if has_header and form.header is None:
        _refuse_row_of_words(tables, layout, path)
        _refuse_preamble(tables, layout, path)
        _refuse_prose(tables, layout, path)
    if has_header:
        if all(_like_number(cell, layout) for cell in cells):
            layout.remarks.append(f"the column names in line {n} are numbers; if the line is a row, set header = 0")
        units, layout.first_row = [], n + 1
        if len(tables) > 1 and (units := _units(tables[1][1], len(cells))):
            layout.first_row = tables[1][0] + 1
            layout.remarks.append(f"the units are in line {tables[1][0]}")
        layout.heads = Heads(cells, where, units)
    else:
        while len(cells) > 1 and not cells[-1]:
            cells.pop()
        layout.first_row, where = n, f"{shown(path)} line {n}"
        names = [str(k + 1) for k in range(len(cells))]
        labels = _header_cells(comments[1], layout.sign, where) if comments else []
        if comments and len(labels) == len(cells) and not _numeric(labels, layout.decimal_comma):
            names, where = labels, f"{shown(path)} line {comments[0]}"
            layout.remarks.append(f"the column names are in the comment in line {comments[0]}")
        else:
            layout.remarks.append(f"there is no header: the columns are called 1 to {len(cells)}")
        layout.heads = Heads(names, where)
    layout.width = len(layout.heads.names)
    _recognise_cells([cells for n, cells in tables if n >= layout.first_row], layout)
    return layout


def _recognise_cells(rows: Sequence[list[str]], layout: _Layout) -> None:
    """Recognise columns of dates, which are read as seconds after the first date, and columns of words."""
    for place, name in enumerate(layout.heads.names):
        cells = [row[place] for row in rows if len(row) > place and row[place]]
        dated = [_STAMP.fullmatch(cell) is not None for cell in cells]
        if cells and dated[0] and 2 * sum(dated) > len(dated):
            layout.stamps[place] = _nanoseconds(cells[0])
            layout.heads.units[place] = layout.heads.units[place] or "s"
            layout.remarks.append(f"the dates in '{name}' are read as seconds after the first date")
        elif cells and not any(_numeric([cell], layout.decimal_comma) for cell in cells):
            layout.words.add(place)
            if all(map(_DATE.fullmatch, cells)):
                layout.remarks.append(
                    f"'{name}' holds dates or times of day that are not read; dates are read as 2026-11-12T08:14:27 or "
                    "12.11.2026 08:14:27"
                )
        if not layout.decimal_comma and "," in "".join(cells) and all(map(_WITH_COMMA.fullmatch, cells)):
            layout.commas.append(name)
    if commas := layout.commas:
        names = ", ".join(f"'{name}'" for name in commas[:MOST_NAMES]) + (", ..." if len(commas) > MOST_NAMES else "")
        layout.remarks.append(f'{names} seem to contain decimal commas; if they do, set decimal = "comma"')


def _with_decimal_commas(quoted: Sequence[str], lines: Sequence[str]) -> bool:
    """Whether the quoted numbers of a table with commas between its columns have decimal commas: no number has a point,
    and not all commas can separate thousands."""
    point = any(_POINT.search(line) for line in lines)
    return bool(quoted) and not point and not all(map(_THOUSANDS.fullmatch, quoted))


def date_in(text: str) -> str:
    """Return the first date with a time of day in a text, and its zone, as in ISO 8601, "" if there is none."""
    if (stamp := _STAMP.search(text)) is None:
        return ""
    zone = re.match(r" ?([+-]\d\d:\d\d)", text[stamp.end() :])
    return _iso(stamp[0]) + (zone[1] if zone else "")


def _nanoseconds(cell: str, zero: int = 0) -> int:
    """Return the time from `zero` to a date [ns]. Raises ValueError if the cell is not a date."""
    stamp = np.datetime64(_iso(cell), "ns")
    if np.isnat(stamp):
        raise ValueError(f"'{cell}' is not a date")
    return int(stamp.astype(np.int64)) - zero


def _iso(cell: str) -> str:
    """Return a date in the order of ISO 8601: 12.11.2026 08:14:27,5 becomes 2026-11-12 08:14:27.5."""
    text = cell.strip().removesuffix("Z").replace(",", ".")
    return _DAY_FIRST.sub(lambda m: f"{m[3]}-{m[2]:0>2}-{m[1]:0>2}", text, count=1)


def _head(path: Path, layout: _Layout, form: LogForm) -> tuple[list[tuple[int, str]], tuple[int, str] | None]:
    """Return the first rows, including the header, and the last comment above them; comments with a key are stored."""
    rows: list[tuple[int, str]] = []
    above: tuple[int, str] | None = None
    for chunk in chunks(path, layout.encoding):
        for n, line in enumerate(chunk.lines, chunk.first):
            if form.header and n < form.header:
                continue
            if is_row(line) or n == form.header:
                rows.append((n, line.lstrip("#% ") if n == form.header else line))
                continue
            key, colon, note = line[1:].partition(":")
            if colon and key.strip().lower() in layout.comments:
                layout.comments[key.strip().lower()].append(note.strip())
            elif line.strip() and not rows:
                above = n, line.lstrip("#%/ ")
        if len(rows) >= LOOKED_AT:
            break
    return rows[:LOOKED_AT], above


def _sign(lines: list[str], form: LogForm, layout: _Layout) -> str:
    """Return the declared delimiter, else the first of tab, semicolon, comma and bar that occurs in most lines, at best
    as often in each as in the first line, else the blank."""
    if form.delimiter is not None:
        return SIGNS[form.delimiter]
    plain = [re.sub(r'"[^"]*"', "", line) for line in lines]
    candidates: list[Delimiter] = ["tab", "semicolon", "comma", "bar"]
    if layout.decimal_comma and not any(_QUOTED.search(line) for line in lines):
        candidates.remove("comma")
    counts: dict[Delimiter, list[int]] = {name: [line.count(SIGNS[name]) for line in plain] for name in candidates}
    tests: list[Callable[[list[int]], int]] = [
        lambda count: bool(count[0]) * count.count(count[0]),
        lambda count: max(count.count(k) for k in {*count} - {0}),  # the first line may be of another kind
        lambda count: bool(count[0]) * sum(map(bool, count)),
        lambda count: sum(map(bool, count)),
    ]
    for test in tests:
        for name, count in counts.items():
            if any(count) and 2 * test(count) > len(plain):
                if name != "comma":
                    layout.remarks.append(f"the columns are separated by a {name}")
                return SIGNS[name]
    below = plain[1:] or plain
    if 2 * sum(len(line.split()) > 1 for line in below) > len(below):
        layout.remarks.append("the columns are separated by blanks")
        return " "
    return ";" if layout.decimal_comma else ","


def _header_cells(line: str, sign: str, where: str) -> list[str]:
    if sign == " ":
        # a blank before a unit does not separate columns
        return [cell.replace("\0", " ") for cell in re.sub(r"\s+(?=\[)", "\0", line.strip()).split()]
    return split(line, sign, where)


def _numeric(cells: Sequence[str], decimal_comma: bool) -> bool:
    """Return whether a line is a row of numbers instead of a header; dates and missing values are not names."""
    kinds = {_kind(cell, decimal_comma) for cell in filter(None, cells)}
    return "number" in kinds and "word" not in kinds


def _kind(cell: str, decimal_comma: bool) -> Literal["number", "absent", "word"]:
    try:
        number(cell, decimal_comma)
    except ValueError:
        absent = cell.lower() in _ABSENT or _STAMP.fullmatch(cell) is not None
        return "absent" if absent else "word"
    return "number"


def _refuse_blanks_and_commas(lines: list[str], layout: _Layout, path: Path, form: LogForm) -> None:
    """Raise LogError if blanks separate numbers with commas: then the comma is not the delimiter."""
    if layout.sign != "," or form.delimiter is not None or layout.decimal_comma:
        return
    parts = [line.split() for line in lines]
    matches = [len(row) > 1 and all(_WITH_COMMA.fullmatch(cell) for cell in row) for row in parts]
    if 2 * sum(matches) > len(lines):
        raise FormError(
            f"{shown(path)}: blanks seem to separate numbers with decimal commas, as in "
            f'\'{lines[matches.index(True)].strip()[:40]}\'; if so, set decimal = "comma", else delimiter = "comma"',
            decimal="comma",
        )


def _refuse_row_of_words(tables: Sequence[tuple[int, list[str]]], layout: _Layout, path: Path) -> None:
    """Raise LogError if the first line has words and numbers in the same columns as the rows below."""
    (n, cells), rest = tables[0], [row for _, row in tables[1:]]
    kinds = [_kind(cell, layout.decimal_comma) for cell in cells]
    matches = [row for row in rest if [_kind(cell, layout.decimal_comma) for cell in row] == kinds]
    if "number" in kinds and rest and len(matches) == len(rest):
        if layout.sign != "," and all(map(_WITH_COMMA.fullmatch, filter(None, cells))):
            raise FormError(
                f'{shown(path)} line {n}: the numbers seem to have decimal commas; if so, set decimal = "comma"',
                decimal="comma",
            )
        raise LogError(
            f"{shown(path)} line {n}: {kinds.count('word')} words and {kinds.count('number')} numbers are arranged as "
            f"in the rows below; if it is a row, set header = 0; if it holds the column names, set header = {n}"
        )


def _units(cells: Sequence[str], width: int) -> list[str]:
    """Return the units of a line that contains only units, else an empty list. An unknown one in brackets is empty."""
    units = [spelled(cell) if cell else "" for cell in cells]
    bracketed = [cell.startswith(("[", "(")) for cell in cells if cell]
    if all(bracketed):
        units = [unit if is_unit(unit) else "" for unit in units]
    if len(units) != width or not any(units) or not all(is_unit(unit) for unit in units if unit):
        return []
    # digits without brackets are numbers, not units
    return units if all(bracketed) or not any(cell.isdigit() for cell in cells) else []


def _refuse_preamble(tables: Sequence[tuple[int, list[str]]], layout: _Layout, path: Path) -> None:
    """Raise FormError if lines of another kind precede the header."""
    (n, cells), rest = tables[0], tables[1:]
    if 2 * sum(len(row) == len(cells) for _, row in rest) >= len(rest):
        return
    for k, (line, names) in enumerate(rest):
        below = rest[k + 1 : k + 1 + LIKE]
        matches = len(below) == LIKE and len(names) > 1 and all(len(row) == len(names) for _, row in below)
        holds_numbers = all(any(_like_number(cell, layout) for cell in row) for _, row in below)
        if matches and holds_numbers and not any(_like_number(cell, layout) for cell in names):
            while k and len(rest[k - 1][1]) == len(names) and (_units(names, len(names)) or _described(names)):
                k -= 1  # units, or lines about the channels, stand below the column names
                line, names = rest[k]
            count = "one cell" if len(cells) == 1 else f"{len(cells)} cells"
            raise FormError(
                f"{shown(path)} line {n}: found {count} above a table of {len(names)} columns; if line {line} is its "
                f"header, set header = {line}",
                header=line,
            )


def _described(cells: Sequence[str]) -> bool:
    """Return whether a line tells one thing about each of several channels: "Offset", 0, "Offset", 1."""
    return len(cells) > 2 and len(set(cells[::2])) == 1 and not cells[0].isdigit()


def _refuse_prose(tables: Sequence[tuple[int, list[str]]], layout: _Layout, path: Path) -> None:
    """Raise LogError if hardly any line consists of numbers, and the lines differ in their number of cells."""
    rows = ["\0".join(cells).rstrip("\0").split("\0") for _, cells in tables]
    of_numbers = sum(3 * sum(not cell or _like_number(cell, layout) for cell in row) >= 2 * len(row) for row in rows)
    if len(rows) > LIKE and 4 * of_numbers < len(rows) and len({len(row) for row in rows}) > 1:
        count = {0: "none consists", 1: "one consists"}.get(of_numbers, f"{of_numbers} consist")
        raise LogError(
            f"{shown(path)} is a text without a table: of its first {len(rows)} lines {count} of numbers; name "
            "the log, or give the line of its column names as header"
        )


def _only_words(cells: Sequence[str], layout: _Layout) -> bool:
    return not any(not cell or _like_number(cell, layout) for cell in cells)


def _like_number(cell: str, layout: _Layout) -> bool:
    return _kind(cell, layout.decimal_comma) == "number" or _WITH_COMMA.fullmatch(cell) is not None
