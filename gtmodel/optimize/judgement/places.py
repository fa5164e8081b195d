"""Sentences with the line that they are about: of a declaration, an equation, a constraint, the objective."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from ...lang.slips import line_of
from ...lang.source import SourceLocation
from ..formulation.dynamic import DynamicProblem

BY_STATE = ("continuity of ", "rate of ")


@dataclass(frozen=True)
class Remark:
    """A sentence, or a part of one, and the place that it is about; None where nobody wrote one."""

    text: str
    where: SourceLocation | None = None

    def __bool__(self) -> bool:
        return bool(self.text)

    def __str__(self) -> str:
        """The sentence, which ends with its place, unless it names that already."""
        silent = self.where is None or f"{self.where})" in self.text
        return self.text if silent else f"{self.text} ({self.where})"


def joined(remarks: Iterable[Remark]) -> Remark:
    """Several remarks as one sentence, about the place of the first that has one."""
    said = [r for r in remarks if r]
    return Remark("; ".join(map(str, said)), next((r.where for r in said if r.where is not None), None))


def class_place(problem: DynamicProblem) -> SourceLocation | None:
    """Where the class of the problem begins."""
    return getattr(type(problem.flat.root), "_written", None)


def objective_place(problem: DynamicProblem) -> SourceLocation | None:
    """Where the objective is written."""
    return line_of(getattr(type(problem.flat.root), "objective", None)) or class_place(problem)


def final_time_place(problem: DynamicProblem) -> SourceLocation | None:
    """Where a free end of the horizon is declared."""
    ends = [q.where for name in ("final_time", "start_time") for q in problem.flat.parameters if q.name == name]
    return ends[0] if ends else class_place(problem)


def variable_place(problem: DynamicProblem, name: str) -> SourceLocation | None:
    """Where a state, control, unknown or free constant of this name is declared."""
    flat = problem.flat
    pairs = dict(zip(problem.state_names, problem.state_pairs, strict=False))
    pairs |= dict(zip([*problem.control_names, *problem.point_names], problem.input_pairs, strict=True))
    if name in pairs:
        return flat.variables[pairs[name][0]].where
    known = [v.where for v in (*flat.variables, *flat.parameters) if v.name == name]
    return known[0] if known else objective_place(problem)  # integrals of its own are the objective's


def row_place(problem: DynamicProblem, label: str) -> SourceLocation | None:
    """Where what a row of the discretised problem says is written: a constraint, an equation, a variable."""
    label = label.removeprefix("at the edge: ")
    if label.startswith("delay of "):
        return variable_place(problem, label.removeprefix("delay of ").partition(" in element ")[0])
    for row in (*problem.points, *problem.path):
        if row.label == label and row.where is not None:
            return row.where
    for begin in BY_STATE:
        if label.startswith(begin):
            return variable_place(problem, label.removeprefix(begin))
    for e in (*problem.flat.equations, *problem.flat.initial):
        if f"{e.label} ({e.where})" in label:
            return e.where
    for v in problem.flat.variables:
        if label in (f"{v.name} by the motion", f"bounds of {v.name}") or f"'{v.name}'" in label:
            return v.where
    return final_time_place(problem) if "horizon" in label else class_place(problem)
