"""Common parts of all kinds: the base of their schemas, `Context`, and the `Call` of the study that a problem file
describes."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Protocol, Self, runtime_checkable

import pydantic

from gtmodel.results import ArgumentError, Check, Row, Study, Trajectory, TrajectoryError, at_least, at_most
from gtmodel.results.disk import is_marked
from gtmodel.results.reading import document
from gtmodel.results.trajectory_files import TRAJECTORY
from gtmodel.results.work import Progress, RunClock, silent

from .._pickling import Portable
from .files import InputError


class Call(Portable):
    """A study with its arguments; calling it runs the study and accepts the study's progress=, max_seconds= and stop=.

    study: the function of the library. arguments, options: its positional and keyword arguments; they can be changed
    before the call. finish: function that completes the result, for example with a report that names the input files.
    """

    def __init__(self, study: Callable[..., Study], *arguments: Any, **options: Any) -> None:
        self.study = study
        self.arguments = list(arguments)
        self.options = options
        self.finish: Callable[[Any], Study] | None = None
        self.rows_of: Callable[[], Any] | None = None  # of a file: what `gt.sweep.study` runs for rows of keys

    def then(self, finish: Callable[[Any], Study]) -> Call:
        """Set the function that completes the result, and return this call."""
        self.finish = finish
        return self

    def __call__(self, **work: Any) -> Any:
        """Run the study. Raises ArgumentError if the caller must pass an argument, such as a folder, that no key
        sets."""
        try:
            inspect.signature(self.study).bind(*self.arguments, **self.options, **work)
        except TypeError as error:
            name = str(error).rpartition("'")[0].rpartition("'")[2]
            raise ArgumentError(f"{self.study.__name__}(): {error}", name) from None
        study = self.study(*self.arguments, **self.options, **work)
        # a run that stopped before it had values is a plain Study: there is nothing to complete
        return study if self.finish is None or type(study) is Study else self.finish(study)

    def __repr__(self) -> str:
        name = f"{self.study.__module__}.{self.study.__qualname__}"
        arguments = [*map(_short, self.arguments), *(f"{k}={_short(v)}" for k, v in self.options.items())]
        return f"{name}({', '.join(arguments)})"


def _short(value: Any) -> str:
    text = " ".join(repr(value).split())
    return text if len(text) <= 200 else f"<{type(value).__name__}>"


class FileSection(pydantic.BaseModel):
    """A table of a problem file. Unknown keys, infinite numbers and numbers written as text are errors."""

    model_config = pydantic.ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, frozen=True, defer_build=True)

    @classmethod
    def left_out(cls) -> Self:
        """Return the table with all defaults, for a file without it; without pydantic's validator, which is slow to
        build."""
        return cls.model_construct()


# accompanies keys that name files of measurements
Source = Annotated[
    str,
    pydantic.Field(description="where to get files that are not shipped: project, file name, address"),
]


class Problem(FileSection):
    """A problem file. The schema of a kind adds keys, each with a description and, in its name, the unit."""

    kind: str = pydantic.Field(description="kind of the problem; gtmodel schema lists the kinds")
    title: str = pydantic.Field(default="", description="one line for tables and pictures")

    @property
    def heading(self) -> str:
        """The title, or the kind if the file has none."""
        return self.title or self.kind

    @pydantic.field_validator("title")
    @classmethod
    def _one_line(cls, title: str) -> str:
        # files and pictures refuse it too, but only after the work
        if not title.strip().isprintable():
            raise ValueError("expected one line of printable characters")
        return title


def unnoticed(sentence: str) -> None:
    """Ignore a notice."""


@dataclass(kw_only=True)
class Context(RunClock):
    """Everything that a kind knows besides its problem, and the time limit of the run.

    name: name of the problem file without ending.
    folder: folder of the problem file; relative paths in the file start there.
    notice: prints one sentence that is not part of the result, such as "an earlier run did not finish".
    start: an earlier result.json to start from.
    inputs: files read besides the problem, name -> path; `take` adds them, run.toml stores their hashes.
    notes: sentences that `note` added to the result.
    distrusted: names of files among `inputs` that are marked as not to be used.
    models: models that the problem names; remarks about them go to the notes of the result.
    full: whether `explain` of a kind lists everything, or a summary of about 40 lines.
    """

    name: str = "problem"
    folder: Path = field(default_factory=Path)
    notice: Callable[[str], object] = unnoticed
    start: Mapping[str, Any] | None = None
    inputs: dict[str, Path] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    distrusted: list[str] = field(default_factory=list)
    models: list[Any] = field(default_factory=list)
    full: bool = True

    def note(self, sentence: str) -> None:
        """Print one sentence and add it to the notes of the result, once."""
        if sentence not in self.notes:
            self.notes.append(sentence)
            self.notice(sentence)

    def find(self, name: str | Path) -> Path | None:
        """Return a file by its path from the problem's folder or from the working directory; None if there is none. For
        a folder that is a ROS 2 bag, return its metadata.yaml."""
        places = [p for start in (self.folder / name, Path(name)) for p in (start, start / "metadata.yaml")]
        return next((p for p in places if p.is_file()), None)

    def file(self, name: str, key: str, entered: str = "", what: str = "file", source: str = "") -> Path:
        """Return the file that `key` names and add it to the inputs as `entered`. Raises InputError if there is no such
        file; the message quotes `source`."""
        path = self.find(name)
        if path is None:
            if any(p.is_dir() for p in (self.folder / name, Path(name))):
                raise InputError(f"'{name}' is a folder; expected a {what}", key)
            if not str(name).isprintable():  # in double quotes TOML reads \n and \t as line break and tab
                hint = "in double quotes a backslash starts an escape sequence; write / instead"
                raise InputError(f"there is no {what} {str(name)!r}; {hint}", key)
            advice = f"; get it from {' '.join(source.split())} and put it there" if source.strip() else ""
            raise InputError(f"there is no {what} '{name}' in {self.folder} or here{advice}", key)
        self.take(entered or key, path)
        return path

    def take(self, key: str, path: Path) -> None:
        """Add a file that is read for `key` to the inputs; note it if the file is marked as not to be used."""
        self.inputs[key] = path
        if is_marked(path):
            self.distrust(path)

    def distrust(self, path: Path) -> None:
        """Note that the run uses a file that is marked as not to be used."""
        if path.name not in self.distrusted:
            self.distrusted.append(path.name)
            self.note(f"the first line of {path.name} says that it is not to be used; it is used nevertheless")

    def interrupted(self) -> bool:
        """Return True after a stop request or the time limit; engines call it once per iteration."""
        return self.clock().interrupted()

    def guess(self) -> Trajectory | None:
        """Return the trajectory of the earlier result to start from, or None."""
        stored = None if self.start is None else self.start.get("trajectory")
        return None if stored is None else Trajectory(stored["time_s"], stored["values"], stored["units"])


class Kind(Protocol):
    """Interface of the module of a kind; see `registry`."""

    Schema: type[Problem]

    def call(self, problem: Any, context: Context) -> Call: ...


@runtime_checkable
class Generating(Protocol):
    """Further interface of a kind whose study writes its own folder, for ``gtmodel codegen``."""

    def write(
        self, problem: Any, context: Context, out: Path, *, verify: bool, write_failed: bool, fmu: str | None,
        costs: bool, certify: bool,
    ) -> Study: ...  # fmt: skip


__all__ = [
    "TRAJECTORY", "Check", "Context", "FileSection", "Generating", "InputError", "Kind", "Problem",
    "Progress", "Row", "Source", "at_least", "at_most", "silent", "unnoticed",
]  # fmt: skip


def earlier_result(path: Path, kind: str) -> Mapping[str, Any]:
    """Return the data of a result.json, or of the result.json in a folder. Raises InputError for any other file."""
    file = path / "result.json" if path.is_dir() else path
    if not file.is_file():
        raise InputError(f"--start {path}: there is no such file; name the result.json of an earlier --out")
    try:
        data = document(file.read_bytes())
        stored_kind = data["kind"]
    except OSError as error:
        raise InputError(f"--start {path} cannot be read: {error.strerror}") from None
    except (ValueError, KeyError, TypeError):
        raise InputError(f"--start {path} is not a result.json of gtmodel") from None
    if stored_kind != kind:
        raise InputError(f"--start {path} is a result of kind '{stored_kind}'; this problem is of kind '{kind}'")
    stored = data.get("trajectory")
    try:
        if stored is not None:
            Trajectory(stored["time_s"], stored["values"], stored["units"])
    except (TrajectoryError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"--start {path}: its trajectory cannot be read: {error}") from None
    return data
