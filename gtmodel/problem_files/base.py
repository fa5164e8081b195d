"""What all kinds share: the base of their schemas, what solving gets, `Context`, and the call of a study that a
problem file means, as Python objects."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Protocol, Self, runtime_checkable

import pydantic

from gtmodel.results import ArgumentError, Check, Row, Study, Trajectory, at_least, at_most
from gtmodel.results.disk import is_marked
from gtmodel.results.trajectory_files import TRAJECTORY
from gtmodel.results.work import Progress, RunClock, silent

from .files import InputError


class Call:
    """A study with its arguments; calling it runs it, with progress=, max_seconds= and stop= as the study takes them.

    study: the function of the library. arguments, options: its positional and named arguments, which may be looked at
    and changed before the call. finish: what the file adds to the study, such as a report that names its inputs.
    """

    def __init__(self, study: Callable[..., Study], *arguments: Any, **options: Any) -> None:
        self.study = study
        self.arguments = list(arguments)
        self.options = options
        self.finish: Callable[[Any], Study] | None = None

    def then(self, finish: Callable[[Any], Study]) -> Call:
        """The same call, its study finished by a function."""
        self.finish = finish
        return self

    def __call__(self, **work: Any) -> Any:
        """Run it. Raises ArgumentError where an argument is missing that the file does not hold, such as a folder."""
        try:
            inspect.signature(self.study).bind(*self.arguments, **self.options, **work)
        except TypeError as error:
            name = str(error).rpartition("'")[0].rpartition("'")[2]
            raise ArgumentError(f"{self.study.__name__}(): {error}", name) from None
        study = self.study(*self.arguments, **self.options, **work)
        # what was ended before it had values is a plain study, to which a file has nothing to add
        return study if self.finish is None or type(study) is Study else self.finish(study)

    def __repr__(self) -> str:
        name = f"{self.study.__module__}.{self.study.__qualname__}"
        given = [*map(_short, self.arguments), *(f"{k}={_short(v)}" for k, v in self.options.items())]
        return f"{name}({', '.join(given)})"


def _short(value: Any) -> str:
    text = " ".join(repr(value).split())
    return text if len(text) <= 200 else f"<{type(value).__name__}>"


class FileSection(pydantic.BaseModel):
    """A table of a problem file. Unknown keys are errors, numbers are finite and not written as text."""

    model_config = pydantic.ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, frozen=True, defer_build=True)

    @classmethod
    def left_out(cls) -> Self:
        """The table of a file that does not have it: all defaults. pydantic needs no validator for it, which takes
        longer to make than a schema to show."""
        return cls.model_construct()


# a key beside those that name files of measurements
Source = Annotated[
    str,
    pydantic.Field(description="where to get files that do not come with the problem: project, file name, address"),
]


class Problem(FileSection):
    """A problem file. A kind's schema adds its keys, each with a description; names carry their units."""

    kind: str = pydantic.Field(description="kind of the problem; gtmodel schema lists the kinds")
    title: str = pydantic.Field(default="", description="one line for tables and pictures")

    @pydantic.field_validator("title")
    @classmethod
    def _one_line(cls, title: str) -> str:
        # files and pictures refuse it too, but only once the work is done
        if not title.strip().isprintable():
            raise ValueError("expected one line of printable characters")
        return title


def unnoticed(sentence: str) -> None:
    """Tells nobody."""


@dataclass(kw_only=True)
class Context(RunClock):
    """What a kind knows besides its problem, and when its run is to end.

    name: of the problem, its file name without ending.
    folder: of the problem file; relative paths in the file start there.
    notice: tells a person one sentence beside the result, such as what an earlier run left undone.
    start: an earlier result.json to start from.
    inputs: files that were read besides the problem, name -> path; a kind enters them by `take`, run.toml keeps their
        hash.
    notes: sentences that stay in the result, said by `note`.
    distrusted: names of files among `inputs` that say of themselves that they are not to be used.
    models: those that the problem names; what is to be said of them stands in the notes of the result.
    """

    name: str = "problem"
    folder: Path = field(default_factory=Path)
    notice: Callable[[str], object] = unnoticed
    start: Mapping[str, Any] | None = None
    inputs: dict[str, Path] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    distrusted: list[str] = field(default_factory=list)
    models: list[Any] = field(default_factory=list)

    def note(self, sentence: str) -> None:
        """Tell a person one sentence that stays in the result; said again it stays one."""
        if sentence not in self.notes:
            self.notes.append(sentence)
            self.notice(sentence)

    def find(self, name: str | Path) -> Path | None:
        """A file by its path from the problem's folder, or from the working directory; None where there is none. Of a
        folder that is a ROS 2 bag, the file that says what is in it."""
        places = [p for start in (self.folder / name, Path(name)) for p in (start, start / "metadata.yaml")]
        return next((p for p in places if p.is_file()), None)

    def file(self, name: str, key: str, entered: str = "", what: str = "file", source: str = "") -> Path:
        """A file that `key` names, entered among the inputs as `entered`. Raises InputError where there is none, with
        what the problem says of its `source`."""
        path = self.find(name)
        if path is None:
            if any(p.is_dir() for p in (self.folder / name, Path(name))):
                raise InputError(f"'{name}' is a folder; expected a {what}", key)
            if not str(name).isprintable():  # in double quotes TOML reads \n and \t as line and tab
                sign = "a backslash is a sign of its own in double quotes, write / in its place"
                raise InputError(f"there is no {what} {str(name)!r}; {sign}", key)
            get = f"; get it from {' '.join(source.split())} and put it there" if source.strip() else ""
            raise InputError(f"there is no {what} '{name}' in {self.folder} or here{get}", key)
        self.take(entered or key, path)
        return path

    def take(self, key: str, path: Path) -> None:
        """Enter a file that is read for `key`; one marked as not to be used is taken, but not without a word."""
        self.inputs[key] = path
        if is_marked(path):
            self.distrust(path)

    def distrust(self, path: Path) -> None:
        """Say that a file is taken which says of itself that it is not to be used."""
        if path.name not in self.distrusted:
            self.distrusted.append(path.name)
            self.note(f"{path.name} says in its first line that it is not to be used; it is taken all the same")

    def interrupted(self) -> bool:
        """True once a stop was requested or the time is over; engines ask once per iteration."""
        return self.clock().interrupted()

    def guess(self) -> Trajectory | None:
        """The trajectory of the earlier result, to start from; None without one."""
        stored = None if self.start is None else self.start.get("trajectory")
        return None if stored is None else Trajectory(stored["time_s"], stored["values"], stored["units"])


class Kind(Protocol):
    """What the module of a kind offers; see `registry`."""

    NAME: str
    Schema: type[Problem]

    def call(self, problem: Any, context: Context) -> Call: ...


@runtime_checkable
class Generating(Protocol):
    """What a kind offers besides whose study writes a folder of its own, by ``gtmodel codegen``."""

    def write(
        self, problem: Any, context: Context, out: Path, *, verify: bool, write_failed: bool, fmu: str | None
    ) -> Study: ...


__all__ = [
    "TRAJECTORY",
    "Check",
    "Context",
    "FileSection",
    "Generating",
    "InputError",
    "Kind",
    "Problem",
    "Progress",
    "Row",
    "Source",
    "at_least",
    "at_most",
    "silent",
    "unnoticed",
]
