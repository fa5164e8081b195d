"""Format options of log files, and the optional libraries (extra "logs") that some formats need."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Annotated, Literal

from ...results.options import Options, Within
from ...results.read_bounds import GROWTH, swollen
from ...results.trajectory_checks import TrajectoryError
from ...results.trajectory_files import PathLike

Delimiter = Literal["comma", "semicolon", "tab", "blank", "bar"]
SIGNS: dict[Delimiter, str] = {"comma": ",", "semicolon": ";", "tab": "\t", "blank": " ", "bar": "|"}
LONGEST_PATH = 80  # characters of a path in a message


class LogError(TrajectoryError):
    """An error in a log. The message is one sentence with the file and the line.

    >>> from pathlib import Path
    >>> written = Path("run.csv").write_text("time,pos\\n0.0,1.0\\n0.1,off\\n")
    >>> gt.measurements.read_log("run.csv", {"q": gt.measurements.Column("pos", "mm")})
    Traceback (most recent call last):
        ...
    gtmodel.measurements.streams.form.LogError: run.csv line 3, column 'pos': found 'off'; expected a finite number ...
    """


class FormError(LogError):
    """A file that seems to have another format than declared. form: the fields of `LogForm` that it seems to have."""

    def __init__(self, message: str, **form: str | int) -> None:
        super().__init__(message)
        self.form = form


class NoNumberError(LogError):
    """A cell without a measurement: empty or nan, in the row at `line`."""

    line: int = 0


@dataclass(frozen=True)
class LogForm(Options):
    """Format of a log file, as far as it cannot be recognised from the file.

    The file type is recognised from the first bytes; the delimiter and the header of a text file from its first lines.
    A decimal comma must be declared.

    >>> from pathlib import Path
    >>> written = Path("run.csv").write_text("t;pos\\n0,0;1,5\\n0,1;1,7\\n0,2;1,6\\n")
    >>> form = gt.measurements.LogForm(decimal="comma")
    >>> Column = gt.measurements.Column
    >>> (session,) = gt.measurements.read_log("run.csv", {"q": Column("pos", "m")}, time=Column("t", "s"), form=form)
    >>> session.trajectory["q"].tolist()
    [1.5, 1.7, 1.6]
    """

    delimiter: Annotated[Delimiter | None, "column delimiter of a text file; default: recognised"] = None
    decimal: Annotated[Literal["point", "comma"], "decimal separator of a text file"] = "point"
    header: Annotated[
        int | None,
        Within(least=0),
        "line of a text file with the column names, from 1; 0: no header, the columns are called 1, 2 and so on; "
        "default: recognised",
    ] = None
    encoding: Annotated[
        str | None, "encoding of a text file, such as cp1252; default: from the byte-order mark, else UTF-8"
    ] = None
    stream: Annotated[str, "table of a file with several tables, such as a topic of a bag"] = ""
    samples: Annotated[
        Literal["rows", "columns"] | None,
        "direction of the samples in a MATLAB matrix; default: the dimension that matches the time",
    ] = None
    most_growth: Annotated[
        float,
        Within(above=0),
        "largest ratio of the data in memory to the file size, if the data exceed 268 MB; protects against damaged "
        "files",
    ] = GROWTH
    by_file: Annotated[
        Mapping[str, LogForm], "format of the files with this name, path or pattern, instead of the other fields"
    ] = field(default_factory=dict)

    def of(self, path: PathLike) -> LogForm:
        """Return the format of one file."""
        return next((form for name, form in self.by_file.items() if matching([Path(path)], name)), self)


def matching(files: Sequence[Path], name: str) -> list[Path]:
    """Return the files with this name, path or pattern."""
    return [file for file in files if name in (str(file), file.name) or file.match(name)]


def refuse_swollen(path: PathLike, size: float, form: LogForm, what: str) -> None:
    """Raise LogError if the data take many more bytes than the file.

    what: name of the data, for the message.
    """
    if reason := swollen(path, size, form.most_growth):
        times = 2 * size / max(Path(path).stat().st_size, 1)
        raise LogError(f"{shown(path)}: {what} {reason}; if this is correct, set most_growth = {times:.2g}")


def shown(path: PathLike) -> str:
    """Return a path for a message: unchanged if it is short and relative, else the name of the file."""
    text = str(path)
    return text if len(text) <= LONGEST_PATH and not Path(path).is_absolute() else Path(path).name[-LONGEST_PATH:]


def needed(module: str, what: str) -> ModuleType:
    """Import an optional module. Raises LogError if it is not installed.

    what: the reason, such as "x.parquet is a Parquet file".
    """
    try:
        return import_module(module)
    except ImportError as error:
        package = module.partition(".")[0]
        raise LogError(f"{what}, and {package} is not installed; pip install 'gtmodel[logs]'") from error
