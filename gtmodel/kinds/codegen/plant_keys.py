"""The keys of [plant]: a functional mock-up unit that `gtmodel loop` moves in place of its own simulated robot."""

from __future__ import annotations

import os
from pathlib import Path

from pydantic import Field

from gtmodel.fmu.plant_unit import PlantUnit
from gtmodel.problem_files.base import Context, InputError
from gtmodel.problem_files.from_options import Made, made_from
from gtmodel.results import ArgumentError


@made_from(PlantUnit, "file")
class PlantUnitSection(Made):
    """For gtmodel loop: a functional mock-up unit in place of the simulated robot, and what its variables are."""

    file: str = Field(
        default="", description="the archive; the path starts at the problem's folder; --plant of gtmodel loop if empty"
    )

    def unit(self, path: Path | str) -> PlantUnit:
        """The plant, of an archive. Raises ArgumentError at its key."""
        try:
            return PlantUnit(file=path, **self.given())
        except ArgumentError as error:
            raise ArgumentError(error.message, f"plant.{error.argument}") from error

    def written(self, context: Context, out: Path) -> str:
        """The path of the archive from a generated folder. Raises InputError where there is none."""
        return os.path.relpath(context.file(self.file, "plant.file", what="unit"), out) if self.file else ""


def plant_of(section: PlantUnitSection | None, folder: Path, plant: Path | None) -> PlantUnit | None:
    """The plant of `gtmodel loop`: the unit that --plant names, or the one of the problem from which a folder was made.

    Raises InputError where one of both is missing, ArgumentError for numbers that do not fit.
    """
    if section is None:
        if plant is not None:
            raise InputError(
                f"--plant {plant}: the problem of this folder has no table [plant], which says what its variables are"
            )
        return None
    path = plant or (folder / section.file if section.file else None)
    if path is None:
        raise InputError("--plant is missing: the problem of this folder names the variables of a unit, not its file")
    if not path.is_file():
        raise InputError(f"--plant {path}: there is no such file" if plant else
                         f"plant.file '{path}': there is no such file; give it by --plant")  # fmt: skip
    return section.unit(path)
