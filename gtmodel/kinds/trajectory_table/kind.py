"""Kind "trajectory_table": several motions, compared with published numbers, such as Dressler 2012, Table 3.1."""

from __future__ import annotations

from gtmodel.motion import table_study
from gtmodel.problem_files.base import Call, Context, InputError

from ..trajectory.keys import PATH_ARGUMENTS
from ..trajectory.kind import explained
from .keys import Schema

ARGUMENTS = {**PATH_ARGUMENTS, "rows[].problem.path.points": "path.file", "rows[].problem": "", "rows": "row"}


def call(problem: Schema, context: Context) -> Call:
    """Return the call of the study of all rows."""
    if context.start is not None:
        raise InputError("--start: each row of a table starts from its own guess; leave it out")
    return Call(table_study, problem.rows(context), title=problem.title)


def explain(problem: Schema, context: Context) -> str:
    """Return the description of each row."""
    rows = zip(problem.rows(context), problem.problems(), strict=True)
    return "\n\n".join(f"{row.name}\n{explained(row.problem, keys, context.full)}" for row, keys in rows)
