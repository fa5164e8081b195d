"""How a log file is written, where it does not say so itself, and the libraries of the extra "logs" that some files
need."""

from __future__ import annotations

from dataclasses import dataclass
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
LONGEST_PATH = 80  # letters of a path in a message


class LogError(TrajectoryError):
    """A log that is not as declared. The message is one sentence with the file and its line.

    >>> from pathlib import Path
    >>> written = Path("run.csv").write_text("time,pos\\n0.0,1.0\\n0.1,off\\n")
    >>> gt.measurements.read_log("run.csv", {"q": gt.measurements.Column("pos", "mm")})
    Traceback (most recent call last):
        ...
    gtmodel.measurements.streams.form.LogError: run.csv line 3, column 'pos': found 'off'; expected a finite number ...
    """


class NoNumberError(LogError):
    """A cell in which nothing was measured: it is empty, or holds nan."""


@dataclass(frozen=True)
class LogForm(Options):
    """How a log file is written, where that is not to be recognised from the file.

    The kind of file is recognised from its first bytes, the delimiter and the header of a text file from its first
    lines. A decimal comma is never guessed.

    >>> from pathlib import Path
    >>> written = Path("run.csv").write_text("t;pos\\n0,0;1,5\\n0,1;1,7\\n0,2;1,6\\n")
    >>> form = gt.measurements.LogForm(decimal="comma")
    >>> Column = gt.measurements.Column
    >>> (session,) = gt.measurements.read_log("run.csv", {"q": Column("pos", "m")}, time=Column("t", "s"), form=form)
    >>> session.trajectory["q"].tolist()
    [1.5, 1.7, 1.6]
    """

    delimiter: Annotated[Delimiter | None, "what stands between the columns of a text file; recognised if left out"] = (
        None
    )
    decimal: Annotated[Literal["point", "comma"], "what stands before the decimals of a text file"] = "point"
    header: Annotated[
        int | None,
        Within(least=0),
        "line of a text file with the names of its columns, from 1; 0 where there is none and columns are called 1, 2 "
        "and so on; recognised if left out",
    ] = None
    encoding: Annotated[str | None, "of a text file, such as cp1252; UTF-8 or by its byte-order mark if left out"] = (
        None
    )
    stream: Annotated[str, "which table of a file that holds several, such as the topic of a bag"] = ""
    samples: Annotated[
        Literal["rows", "columns"] | None,
        "along what the samples of a MATLAB matrix run; by the length of the time if left out",
    ] = None
    most_growth: Annotated[
        float,
        Within(above=0),
        "how many times larger than its file what is read of it may be, where that is more than 268 MB: a damaged file "
        "may declare any size",
    ] = GROWTH


def refuse_swollen(path: PathLike, size: float, form: LogForm, what: str) -> None:
    """Raises LogError for numbers that take so many bytes that the file cannot really hold them.

    what: whose numbers, for the message.
    """
    if said := swollen(path, size, form.most_growth):
        times = 2 * size / max(Path(path).stat().st_size, 1)
        raise LogError(f"{shown(path)}: {what} {said}; if it is right, say most_growth = {times:.2g}")


def shown(path: PathLike) -> str:
    """A path as a message names it: as given where that is short, else the file's name."""
    text = str(path)
    return text if len(text) <= LONGEST_PATH and not Path(path).is_absolute() else Path(path).name[-LONGEST_PATH:]


def needed(module: str, what: str) -> ModuleType:
    """A module of the extra. Raises LogError where it is not installed.

    what: the file that needs it, as "x.parquet is a Parquet file".
    """
    try:
        return import_module(module)
    except ImportError as error:
        package = module.partition(".")[0]
        raise LogError(f"{what}, and {package} is not installed; pip install 'gtmodel[logs]'") from error
