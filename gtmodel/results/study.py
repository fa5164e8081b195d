"""Result of a study: status, quantities, checks, notes, pictures and files."""

from __future__ import annotations

import copy
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self, TypeVar, get_type_hints

from .._lazy import hint
from .._pickling import Portable
from .check import Check, failed_of, verdict
from .estimate import Estimate
from .quantity import Quantity, Row, quantities
from .refusal import ArgumentError
from .status import SolveStatus
from .trajectory import Trajectory

S = TypeVar("S")
_OWN = frozenset(s.message for s in SolveStatus)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from .page.page import Sections
else:
    Figure = hint("matplotlib.figure", "Figure")
    Sections = hint("gtmodel.results.page.page", "Sections")


def to_inherit(cls: type[S]) -> type[S]:
    """Evaluate the annotations of a dataclass: a subclass repeats them in its __init__, and its module may not know
    their names."""
    hints = get_type_hints(cls, include_extras=True)
    for attribute in fields(cls):  # type: ignore[arg-type]  # of any dataclass
        attribute.type = hints[attribute.name]
    return cls


@to_inherit
@dataclass(frozen=True, kw_only=True)
class Study(Portable):
    """Result of a study of any library; a subclass declares its quantities as annotated attributes.

    status, message: outcome, and a sentence about it. objective, iterations: of the solver, if one ran.
    estimate: fitted quantities with their covariance, if there are any; `interval` uses it.
    checks: tested numbers, by name. notes: remarks for the reader.
    trajectory: the motion, if there is one.
    figures: name -> function that draws a matplotlib figure; `figure` calls it.
    scenes: name -> function that returns a `gtmodel.view.RobotScene`; `view` calls it.
    about: function that returns what a problem file asked for, for the report; None without a file.
    files: file name -> content of files besides result.json, such as map.csv.
    machine_files: names of files that a machine or another program uses, such as a robot program; they are written only
        if the result may be used. TRAJECTORY is one of them if a machine follows it; otherwise a failed study writes it
        with a mark.

    A solved study with a failed check gets the status CHECK_FAILED and a message that names the checks.

    >>> checks = {"residual_m": gt.results.at_most(2e-3, 1e-3, "measure again")}
    >>> study = gt.results.Study(status=gt.SolveStatus.SOLVED, checks=checks)
    >>> study.status.value
    'check_failed'
    >>> study.message
    '1 of 1 checks failed: residual_m (0.002 m, at most 0.001 m); measure again'
    """

    done: ClassVar[str] = SolveStatus.SOLVED.value
    """Word for the status SOLVED in the table; a study that solves nothing has another one."""
    captions: ClassVar[Mapping[str, str]] = {}
    """Captions of pictures in the report, by their name; the others are called by their name."""
    draws_residuals: ClassVar[bool] = False
    """Whether `figures` show distribution and autocorrelation of the residuals; otherwise the report does."""

    status: SolveStatus
    message: str = ""
    title: str = ""
    notes: Sequence[str] = ()
    estimate: Estimate | None = None
    objective: float | None = None
    iterations: int | None = None
    checks: Mapping[str, Check] = field(default_factory=dict)
    trajectory: Trajectory | None = None
    figures: Mapping[str, Callable[[], Any]] = field(default_factory=dict)
    scenes: Mapping[str, Callable[[], Any]] = field(default_factory=dict)
    about: Callable[[], Any] | None = field(default=None, init=False)
    files: Mapping[str, str | bytes] = field(default_factory=dict)
    machine_files: Collection[str] = ()

    def __post_init__(self) -> None:
        if not self.message or self.message in _OWN:
            object.__setattr__(self, "message", self.status.message)
        if self.status.ok and (failed := failed_of(self.checks)):
            object.__setattr__(self, "status", SolveStatus.CHECK_FAILED)
            object.__setattr__(self, "message", verdict(failed, len(self.checks)))

    @classmethod
    def quantities(cls) -> dict[str, Quantity]:
        """The declared quantities by attribute."""
        return quantities(cls)

    @property
    def values(self) -> Mapping[str, Any]:
        """The declared quantities by their names in result.json, with units; and `notes`, if there are any."""
        values = {q.name(attribute): q.value(getattr(self, attribute)) for attribute, q in self.quantities().items()}
        notes = () if "notes" in self.quantities() else values.get("notes") or ()
        return values | ({"notes": [*notes, *self.notes]} if self.notes else {})

    @property
    def rows(self) -> list[Row]:
        """The table: every quantity that has a label and a value."""
        labelled = ((q, getattr(self, attribute)) for attribute, q in self.quantities().items() if q.label)
        return [q.row(value) for q, value in labelled if value is not None]

    @property
    def sections(self) -> Sections:
        """Further parts of the report by heading: sentences, lists and tables."""
        return {}

    def interval(self, name: str, level: float = 0.95) -> tuple[float, float]:
        """Return the confidence interval of an estimated quantity [SI], infinite if the data do not determine it.
        Raises ArgumentError if it was not estimated."""
        if self.estimate is None:
            raise ArgumentError("this study has no estimates and so no intervals", "name")
        return self.estimate.interval(name, level)

    def with_(self, **changes: Any) -> Self:
        """Return a copy with other attributes."""
        changed = copy.copy(self)
        for name, value in changes.items():
            object.__setattr__(changed, name, value)
        changed.__post_init__()
        return changed

    def judged(self, more: Mapping[str, Check]) -> Self:
        """Return a copy with further checks. An unsolved study keeps its message and adds their advice."""
        advice = [check.advice for check in failed_of(more).values() if check.advice]
        message = self.message if self.status.ok or not advice else "; ".join([self.message, *advice])
        return self.with_(checks={**self.checks, **more}, message=message) if more else self

    def figure(self, name: str = "") -> Figure:
        """Return a picture by name, the first if left out. Raises ArgumentError for an unknown name."""
        return _chosen(self.figures, name, "picture")()

    def view(self, name: str = "") -> Any:
        """Return the robot in space with its motion, by name, the first if left out: a `gtmodel.view.RobotScene`. A
        notebook shows it, and it writes a page, whose note says so if the result must not be used. Raises ArgumentError
        for an unknown name, and if there is none."""
        return cautioned(_chosen(self.scenes, name, "view")(), self.status)

    def write(
        self, folder: str | Path, *, plot: bool = False, report: bool = False, write_failed: bool = False
    ) -> list[Path]:
        """Write result.json and the files into a folder, and return the paths.

        plot: write the pictures and scenes too. report: write report.html too, one page with all pictures, to be sent
        to others.

        Files for a machine are written only if the result may be used or, with `write_failed`, with a mark. Raises
        ArgumentError for a folder with files that gtmodel did not write.
        """
        from .written import write

        if not isinstance(folder, (str, Path)):
            raise ArgumentError(f"expected the name of a folder; found {type(folder).__name__}", "folder")
        return write(self, Path(folder), plot=plot, report=report, write_failed=write_failed)

    def __str__(self) -> str:
        from .table import text  # here, as below: a schema needs neither tables nor files

        return text(self)

    def _repr_html_(self) -> str:
        from .table import html

        return html(self)

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.status.value}>"


def cautioned(scene: Any, status: SolveStatus) -> Any:
    """The scene of a result, with a note that begins with the reason why it must not be used, if there is one."""
    return scene if status.ok else scene.with_(note=f"Not to be used: {status.message}. {scene.note}".strip())


def _chosen(made: Mapping[str, Callable[[], Any]], name: str, what: str) -> Callable[[], Any]:
    """The maker of that name, or the first. Raises ArgumentError."""
    if not made or (name and name not in made):
        raise ArgumentError(f"there is no {what} '{name}'; there are {', '.join(made) or 'none'}", "name")
    return made[name or next(iter(made))]
