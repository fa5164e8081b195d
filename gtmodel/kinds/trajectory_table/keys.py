"""Keys of kind "trajectory_table": the keys of a motion, and the changes of each row."""

from __future__ import annotations

from typing import Any

import tomli_w
from pydantic import Field

from gtmodel.motion import Published as PublishedOptions, TableRow
from gtmodel.problem_files.base import Context, FileSection, InputError
from gtmodel.problem_files.from_options import Made
from gtmodel.problem_files.load import apply, validate

from ..trajectory import keys as trajectory

RESULT = "gtmodel.motion.MotionTable"


class RowKeys(FileSection):
    """One motion: its changes of the problem."""

    name: str = Field(description="name of the row")
    set: dict[str, Any] = Field({}, description='keys that this row changes, such as {"cost.energy" = 0.01}')
    most_iterations: int | None = Field(None, description="largest number of iterations of the successful attempt")
    published: Made[PublishedOptions] | None = Field(None, description="published numbers")


class Schema(trajectory.Schema):
    """Several optimal motions of one robot, one row each."""

    row: list[RowKeys] = Field(min_length=2, description="the rows; the last row is the reference for the others")

    def problems(self) -> list[trajectory.Schema]:
        """Return the problem of each row. Raises InputError."""
        return [self._problem(n) for n in range(len(self.row))]

    def _problem(self, n: int) -> trajectory.Schema:
        data = self.model_dump(mode="json", exclude={"row"}, exclude_unset=True) | {"kind": "trajectory"}
        row = self.row[n]
        try:
            changed = apply(data, [f"{key}={_text(value)}" for key, value in row.set.items()])
            return validate(trajectory.Schema, changed | {"title": row.name})
        except InputError as error:
            raise InputError(str(error), f"row[{n}].set") from error

    def rows(self, context: Context) -> list[TableRow]:
        """Return the rows of the study. Raises InputError and ArgumentError."""
        rows = []
        for row, problem in zip(self.row, self.problems(), strict=True):
            published = None if row.published is None else row.published.options()
            rows.append(TableRow(row.name, problem.motion(context), row.most_iterations, published))
        return rows


def _text(value: Any) -> str:
    """A value as TOML."""
    return tomli_w.dumps({"value": value}).partition("=")[2].strip()
