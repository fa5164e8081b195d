"""What a study returns: status, numbers, checks, notes, pictures and files, from one declaration."""

from __future__ import annotations

import copy
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, TypeVar, get_type_hints

from .._lazy import hint
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
else:
    Figure = hint("matplotlib.figure", "Figure")


def to_inherit(cls: type[S]) -> type[S]:
    """A dataclass with types in place of the texts of its annotations: the __init__ of a subclass repeats them, in a
    module that need not know their names."""
    hints = get_type_hints(cls, include_extras=True)
    for own in fields(cls):  # type: ignore[arg-type]  # of any dataclass
        own.type = hints[own.name]
    return cls


@to_inherit
@dataclass(frozen=True, kw_only=True)
class Study:
    """What a study of any library returns; a subclass declares its quantities as annotated attributes.

    status, message: how it ended, the message in a sentence; objective, iterations: where a solver ran.
    estimate: fitted quantities with their covariance, where something was fitted; `interval` asks it.
    checks: numbers that were tested, by name. notes: what a person is to know besides.
    trajectory: the motion, where there is one.
    figures: name -> function that draws it, a matplotlib figure; `figure` calls one.
    files: file name -> content of what is written besides result.json, such as map.csv.
    machine_files: names of those that a machine or another program takes over, such as a robot program; they are not
        written unless the result may be used. TRAJECTORY is one of them where it is what the machine follows; of the
        other studies it is written, and marked.

    Solved with a failed check is no state of a study: it becomes CHECK_FAILED, with a message that names the checks.

    >>> checks = {"residual_m": gt.results.at_most(2e-3, 1e-3, "measure again")}
    >>> study = gt.results.Study(status=gt.SolveStatus.SOLVED, checks=checks)
    >>> study.status.value
    'check_failed'
    >>> study.message
    '1 of 1 checks failed: residual_m (0.002 m, at most 0.001 m); measure again'
    """

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
        """The declared quantities by their names in result.json, which carry the units; `notes` where there are any."""
        values = {q.name(attribute): q.value(getattr(self, attribute)) for attribute, q in self.quantities().items()}
        own = () if "notes" in self.quantities() else values.get("notes") or ()
        return values | ({"notes": [*own, *self.notes]} if self.notes else {})

    @property
    def rows(self) -> list[Row]:
        """The table for people: every quantity with a label that has a value."""
        labelled = ((q, getattr(self, attribute)) for attribute, q in self.quantities().items() if q.label)
        return [q.row(value) for q, value in labelled if value is not None]

    def interval(self, name: str, level: float = 0.95) -> tuple[float, float]:
        """Confidence interval of an estimated quantity [SI], infinite where the data do not determine it. Raises
        ArgumentError where nothing was estimated, or not this."""
        if self.estimate is None:
            raise ArgumentError("nothing was estimated here: there are no intervals", "name")
        return self.estimate.interval(name, level)

    def with_(self, **changes: Any) -> Self:
        """The same study with other attributes."""
        changed = copy.copy(self)
        for name, value in changes.items():
            object.__setattr__(changed, name, value)
        changed.__post_init__()
        return changed

    def judged(self, more: Mapping[str, Check]) -> Self:
        """The same study with further checks. What was not solved before keeps its message, with their advice."""
        advice = [check.advice for check in failed_of(more).values() if check.advice]
        message = self.message if self.status.ok or not advice else "; ".join([self.message, *advice])
        return self.with_(checks={**self.checks, **more}, message=message) if more else self

    def figure(self, name: str = "") -> Figure:
        """A picture by name, the first if left out. Raises ArgumentError for a name that is not there."""
        there = ", ".join(self.figures) or "none"
        if not self.figures or (name and name not in self.figures):
            raise ArgumentError(f"there is no picture '{name}'; there are {there}", "name")
        return self.figures[name or next(iter(self.figures))]()

    def write(self, folder: str | Path, *, plot: bool = False, write_failed: bool = False) -> list[Path]:
        """Write result.json, the files and with `plot` the pictures into a folder of its own; returns the paths.

        What goes to a machine is written only of a result that may be used, or marked with `write_failed`. Raises
        ArgumentError for a folder with files that gtmodel did not write, and for what names no folder.
        """
        from .written import write

        if not isinstance(folder, (str, Path)):
            raise ArgumentError(f"expected the name of a folder; found {type(folder).__name__}", "folder")
        return write(self, Path(folder), plot=plot, write_failed=write_failed)

    def __str__(self) -> str:
        from .table import text  # here, as the others: a schema shows no study and writes none

        return text(self)

    def _repr_html_(self) -> str:
        from .table import html

        return html(self)

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.status.value}>"
