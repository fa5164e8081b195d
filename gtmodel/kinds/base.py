"""What all kinds share: the base of their schemas, what solving gets (`Context`) and gives (`Outcome`)."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import pydantic

from gtmodel.results import SolveStatus, Trajectory

from .verdict import failed_of, is_marked, verdict

if TYPE_CHECKING:
    from matplotlib.figure import Figure


TRAJECTORY = "trajectory.csv"  # of every outcome with a trajectory


class InputError(ValueError):
    """What a person gave is wrong: one plain sentence, with the file and its key where they are known."""

    def __init__(self, sentence: str, key: str = "", file: str = "") -> None:
        super().__init__(sentence, key, file)
        self.sentence = sentence
        self.key = key
        self.file = file

    def __str__(self) -> str:
        return ": ".join(part for part in (self.file, self.key, self.sentence) if part)

    def within(self, file: str, key: str = "") -> InputError:
        """The same fault seen from outside: in this file, at this key, unless it says so itself."""
        return InputError(self.sentence, self.key or key, self.file or file)


class Section(pydantic.BaseModel):
    """A table of a problem file. Unknown keys are errors, numbers are finite and not written as text."""

    model_config = pydantic.ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, frozen=True)


class Problem(Section):
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


class Check(NamedTuple):
    """A number that was tested, and the verdict on the whole result: where it fails, nobody is to rely on it.

    What only informs is no check but a value. bound: what the value must not exceed, or must reach where `least`
    is set; None without a bound. advice: what a person does when it fails, as "use more mesh.elements".
    """

    value: float | None
    bound: float | None
    passed: bool
    advice: str = ""
    least: bool = False


def at_most(value: float, bound: float, advice: str = "") -> Check:
    """The check value <= bound; a value that is not finite fails and is told as none."""
    return Check(value if math.isfinite(value) else None, bound, value <= bound, advice)


def at_least(value: float, bound: float, advice: str = "") -> Check:
    """The check value >= bound; a value that is not finite fails and is told as none."""
    return Check(value if math.isfinite(value) else None, bound, value >= bound, advice, least=True)


class Row(NamedTuple):
    """One row of the table that people see."""

    label: str
    value: Any
    unit: str = ""


@dataclass(kw_only=True)
class Outcome:
    """What solving a problem of any kind gives back.

    values: numbers, lists and texts by name, as the kind's VALUES announces them; NaN becomes null.
    rows: the table for people; made from `values` when empty. A plain tuple (label, value, unit) will do.
    figures: file name without ending -> function that draws it; called only with --plot.
    files: file name -> content of what the kind writes besides, such as report.html.
    machine_files: names of those of them that a machine or another program takes over, such as a robot program;
        they are not written unless the result may be used, or --write-failed is given. TRAJECTORY is one of them where
        it is what the machine follows; of the other kinds it is written, and marked.

    Solved with a failed check is no state of an outcome: it becomes CHECK_FAILED, with a message that names the
    checks.
    """

    status: SolveStatus
    message: str = ""
    objective: float | None = None
    iterations: int | None = None
    checks: Mapping[str, Any] = field(default_factory=dict)
    values: Mapping[str, Any] = field(default_factory=dict)
    trajectory: Trajectory | None = None
    rows: list[Any] = field(default_factory=list)
    figures: Mapping[str, Callable[[], Figure]] = field(default_factory=dict)
    files: Mapping[str, str | bytes] = field(default_factory=dict)
    machine_files: Collection[str] = ()

    def __post_init__(self) -> None:
        if self.status.ok and (failed := failed_of(self.checks)):
            self.status, self.message = SolveStatus.CHECK_FAILED, verdict(failed, len(self.checks))


class Progress(Protocol):
    """Shows how far the work is: what is being done, the fraction done from 0 to 1 if known, and numbers."""

    def __call__(
        self,
        stage: str | None = None,
        fraction: float | None = None,
        numbers: Mapping[str, float] | None = None,
    ) -> object: ...


def silent(stage: str | None = None, fraction: float | None = None, numbers: Mapping[str, float] | None = None) -> None:
    """Shows nothing."""


def unheard(sentence: str) -> None:
    """Tells nobody."""


@dataclass(kw_only=True)
class Context:
    """What a kind knows besides its problem.

    name: of the problem, its file name without ending.
    folder: of the problem file; relative paths in the file start there.
    notice: tells a person one sentence beside the result, such as what an earlier run left undone.
    max_seconds: time limit [s] from the making of the context on; None for none.
    start: an earlier result.json to start from.
    inputs: files that were read besides the problem, name -> path; a kind enters them by `take`, run.toml keeps their
        hash.
    notes: sentences that stay in the result, said by `note`.
    distrusted: names of files among `inputs` that say of themselves that they are not to be used.
    models: those that the problem names; what is to be said of them is told with the result.
    """

    name: str = "problem"
    folder: Path = field(default_factory=Path)
    progress: Progress = silent
    notice: Callable[[str], object] = unheard
    max_seconds: float | None = None
    start: Mapping[str, Any] | None = None
    inputs: dict[str, Path] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    distrusted: list[str] = field(default_factory=list)
    models: list[Any] = field(default_factory=list)
    stop_requested: bool = False
    began: float = field(default_factory=time.monotonic)

    def request_stop(self) -> None:
        """Ask the running solve to end with its best iterate, as Ctrl-C does."""
        self.stop_requested = True

    def note(self, sentence: str) -> None:
        """Tell a person one sentence that stays in the result; said again it is not heard."""
        if sentence not in self.notes:
            self.notes.append(sentence)
            self.notice(sentence)

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
        return self.stop_requested or self.seconds_left() == 0.0

    def seconds_left(self) -> float | None:
        """Time left [s], never negative; None without a limit."""
        if self.max_seconds is None:
            return None
        return max(0.0, self.max_seconds - (time.monotonic() - self.began))

    def guess(self) -> Trajectory | None:
        """The trajectory of the earlier result, to start from; None without one."""
        stored = None if self.start is None else self.start.get("trajectory")
        return None if stored is None else Trajectory(stored["time_s"], stored["values"], stored["units"])


class Kind(Protocol):
    """What a module of this package offers; see `gtmodel.kinds`."""

    NAME: str
    Schema: type[Problem]
    VALUES: dict[str, str]

    def solve(self, problem: Any, context: Context) -> Outcome: ...
