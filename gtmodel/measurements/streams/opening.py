"""Open any supported file as streams; the file type is recognised from the first bytes."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

from ...results.disk import path_of
from ...results.trajectory_files import PathLike
from .form import LogError, LogForm, shown
from .matlab import MatFile
from .stream import Stream
from .text import TextStream

if TYPE_CHECKING:
    from .bags import Bag

_TABLES = (".xlsx", ".xls", ".ods", ".mdf", ".mf4", ".dat.gz", ".zip")
_PACKED = {
    b"PK": "an Excel workbook or a zip archive; save the table as CSV, or unpack it",
    b"\xd0\xcf\x11\xe0": "an old Excel workbook; save the table as CSV",
    b"\x1f\x8b": "compressed (gzip); unpack it",
}
_POINTER = b"version https://git-lfs"
_PROGRAMS = {  # recognised from the first line that is not a comment
    "RAPID": re.compile(
        rb"\A\xef?\xbb?\xbf?(\s|![^\n]*\n|%%%.*?%%%)*(MODULE\s+\w+\s*(\(|\n|\r|!|$)|((LOCAL|GLOBAL)\s+)?PROC\s+\w+\s*\()",
        re.S | re.I,
    ),
    "URScript": re.compile(rb"\A\s*(#[^\n]*\n\s*)*def\s+\w+\s*\([^\n]*\)\s*:"),
    "TP": re.compile(rb"\A\s*/PROG\s+\w+"),
    "KRL": re.compile(rb"\A\s*(&\w+[^\n]*\n\s*|;[^\n]*\n\s*)*(DEF\s+\w+\s*\(|DEFDAT\s+\w+|DEFFCT\s+\w+)", re.I),
}
_TREES = {  # text formats without a table, recognised from their beginning
    "XML": re.compile(rb"\A\xef?\xbb?\xbf?\s*<[?!A-Za-z]"),
    "JSON": re.compile(rb"\A\xef?\xbb?\xbf?\s*(\{\s*[\"}]|\[\s*[\[{])"),
}
_PROGRAM_WITHIN = 4096  # bytes of a file that are examined
_BAGS = (b"#ROSBAG", b"\x89MCAP", b"SQLite format 3")
MOST_STREAMS = 6  # streams listed in a message


def open_log(path: PathLike, form: LogForm = LogForm()) -> list[Stream]:  # noqa: B008
    r"""Return the tables of a log file as streams; only the names and units of the columns are read.

    A text file or a Parquet file is one stream. A MATLAB file has one stream for each number of samples, a ROS bag (ROS
    1, ROS 2, MCAP) one for each topic. Raises LogError for any other file; FileNotFoundError passes through.

    Parquet, MATLAB 7.3 and bags need `pip install 'gtmodel[logs]'`.

    >>> from pathlib import Path
    >>> written = Path("run.csv").write_text("# synthetic: seed 1\nt [ms];pos [mm]\n0;10\n4;12\n8;15\n")
    >>> (stream,) = gt.measurements.open_log("run.csv")
    >>> stream.heads.names, stream.heads.units
    (['t', 'pos'], ['ms', 'mm'])
    >>> stream.read({"q": ["pos"]}).values["q"].tolist()
    [[10.0], [12.0], [15.0]]
    >>> stream.remarks
    ['the columns are separated by a semicolon']
    """
    content = content_of(path, form)
    return [content] if isinstance(content, Stream) else list(content.streams())


def stream_of(path: PathLike, form: LogForm, name: str = "", time: str = "", holding: str = "") -> Stream:
    """Return the table with this name, or with this time column, or the only table of a file.

    holding: a column or vector that identifies a table without time.

    Raises LogError if no table or several tables match.
    """
    content = content_of(path, form)
    name = name or form.stream or form.of(path).stream
    if isinstance(content, MatFile) and time and not name:
        return content.of_time(time)
    streams = [content] if isinstance(content, Stream) else content.streams()
    if name:
        chosen = [s for s in streams if s.name == name]
    elif len(streams) > 1:
        chosen = [s for s in streams if {time, holding, f"{holding}[0]"} & {*s.heads.names}]
    else:
        chosen = streams
    if len(chosen) == 1:
        return chosen[0]
    names = ", ".join(s.name for s in streams[:MOST_STREAMS])
    more = f" and {len(streams) - MOST_STREAMS} more" if len(streams) > MOST_STREAMS else ""
    if name:
        raise LogError(f"{shown(path)}: there is no stream '{name[:40]}'; it has {names}{more}")
    raise LogError(f"{shown(path)} holds several streams, {names}{more}; name one of them")


def content_of(path: PathLike, form: LogForm) -> Stream | MatFile | Bag:
    """Open a file with the reader for its type."""
    path = path_of(path)
    form = form.of(path)
    if path.is_dir() or path.name == "metadata.yaml":
        if not path.is_dir() or (path / "metadata.yaml").is_file():
            return _bag(path, form)
        raise LogError(f"{shown(path)} is a folder without metadata.yaml, so it is not a ROS 2 bag; name a file")
    if path.exists() and not path.is_file():
        raise LogError(f"{shown(path)} is a pipe or a device, which can be read only once; write it to a file first")
    with open(path, "rb") as file:
        start = file.read(_PROGRAM_WITHIN)
    head = start[: len(_POINTER)]
    suffix = path.suffix.lower()
    if head.startswith(_BAGS):
        return _bag(path, form)
    if head.startswith(b"PAR1"):
        from .parquet import ParquetStream

        return ParquetStream(path, form)
    if head.startswith((b"MATLAB", b"\x89HDF")) or suffix == ".mat":
        return MatFile(path, form)
    if head == _POINTER:
        raise LogError(f"{shown(path)} is a Git LFS pointer instead of the file; fetch the file with git lfs pull")
    packed = next((what for mark, what in _PACKED.items() if head.startswith(mark)), "")
    if packed:
        raise LogError(f"{shown(path)} is {packed}")
    if head.startswith(b"MDF ") or suffix in _TABLES:
        raise LogError(f"{shown(path)} is not a text, MATLAB, Parquet or bag file; save the table as CSV")
    if suffix in (".parquet", ".bag", ".mcap", ".db3"):
        raise LogError(f"{shown(path)} does not begin like a {suffix} file; it is damaged or of another type")
    program = next((what for what, sign in _PROGRAMS.items() if sign.search(start)), "")
    if program:
        raise LogError(
            f"{shown(path)} is a program of a robot controller ({program}), a text without a table; name the log that "
            "was recorded during its run"
        )
    tree = next((what for what, sign in _TREES.items() if sign.search(start)), "")
    if tree:
        raise LogError(f"{shown(path)} is {tree}, a text without a table; save its numbers as CSV")
    return TextStream(path, form)


def _bag(path: Path, form: LogForm) -> Bag:
    from .bags import Bag

    return Bag(path, form)
