"""The keys of kind "codegen"."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Literal

from pydantic import Field, PositiveFloat

from gtmodel.cgen import Verification
from gtmodel.fmu.plant_unit import PlantUnit
from gtmodel.loop.lead_through.options import Guiding
from gtmodel.problem_files.base import Context, FileSection, InputError
from gtmodel.problem_files.from_options import Made, made_from
from gtmodel.problem_files.keys import RobotProblem
from gtmodel.results.refusal import naming

RESULT = "gtmodel.cgen.CodeStudy"


class Function(FileSection):
    """One function: these targets, computed from these known variables."""

    name: str = Field(min_length=1, description="C name of the function")
    known: list[str] = Field(default=[], description="names of variables that are prescribed with their derivatives")
    targets: list[str] = Field(min_length=1, description='names such as "T", "der(q)", "der(T,2)"')
    prefer: list[str] = Field(default=[], description="names to keep as states")
    branches: dict[str, Literal[-1, 1]] = Field(default={}, description="sign by name of a declared branch")
    trajectory: bool = Field(default=False, description="offer it along a sampled reference too, as NAME_at")

    start: dict[str, float | list[float]] = Field(
        default={},
        description="of a unit, by --fmu: input or state = start value in SI; at rest at home if empty",
    )
    tunable: list[str] = Field(default=[], description="of a unit: known variables that become tunable parameters")
    parameters: list[str] = Field(
        default=[], description='of a unit: parameters of the model, such as "m_p", that stay tunable parameters'
    )


class FmuSection(FileSection):
    """What --fmu makes."""

    step_s: PositiveFloat | None = Field(
        default=None, description="longest step of the integrator inside; chosen by its error when left out"
    )
    tolerance: PositiveFloat = Field(
        default=1e-6, description="largest error of a state over its size or one, against half the step"
    )
    stop_s: PositiveFloat = Field(default=1.0, description="end of the default experiment, over which it is compared")
    on_fault: Literal["discard", "hold"] = Field(
        default="discard",
        description="where there is no answer; hold: last outputs and an output status; no states then",
    )


class FilterSensorSection(FileSection):
    """One sensor of a filter: a variable of the model, how uncertain a reading is, and when it is not believed."""

    name: str = Field(min_length=1, description="of the sensor; its reading and its flag NAME_valid are inputs in C")
    signal: str = Field(default="", description="variable that it measures; the sensor's name when empty")
    deviation: float | list[float] | None = Field(
        default=None, description="standard deviation of one reading, in the unit of the signal; of angles in rad"
    )
    density: float | list[float] | None = Field(
        default=None, description="in place of it, deviation times the root of the period [unit / sqrt(Hz)]"
    )
    period_s: PositiveFloat | None = Field(default=None, description="between two readings, where a density is given")
    kind: Literal["vector", "quaternion", "direction"] = Field(default="vector", description="of the reading")
    delay_s: float = Field(default=0.0, ge=0, description="how late a reading comes: a multiple of the filter's period")
    gate: float | None = Field(
        default=None, gt=0, lt=1, description="readings beyond this quantile of chi-squared are left out, as 0.999"
    )
    stale_cycles: int | None = Field(default=None, ge=1, description="more cycles without a reading: GT_STALE_INPUT")
    closed_cycles: int | None = Field(
        default=None, ge=1, description="more readings in a row beyond the gate: GT_OUT_OF_RANGE"
    )


class FilterStartSection(FileSection):
    """The declared start of a filter, which NAME_defaults writes."""

    mean: dict[str, float | list[float]] = Field(default={}, description="state = value; others are zero, or no turn")
    deviation: dict[str, float | list[float]] = Field(description="state = standard deviation; every state has one")


class FilterSection(FileSection):
    """A step function: the error-state Kalman filter of the model, driven by noise."""

    name: str = Field(min_length=1, description="C name: gt_<name>_<this>_init and _step")
    period_s: PositiveFloat = Field(description="of the loop that calls it")
    noise: dict[str, float | list[float]] = Field(
        description="input = density of its white noise, in its unit squared times seconds"
    )
    states: list[str] = Field(default=[], description="the model's own choice when empty")
    inputs: list[str] = Field(default=[], description="inputs of the model that are known")
    quaternions: list[str] = Field(default=[], description="states that are unit quaternions, scalar first")
    sensors: list[FilterSensorSection] = Field(min_length=1, description="what is measured")
    start: FilterStartSection = Field(description="where it begins")

    def key_of(self, argument: str) -> str:
        """The key of an argument; of a sensor's, "NAME.deviation", where the sensor stands."""
        units = {"period": "period_s", "delay": "delay_s"}
        owner, _, what = argument.partition(".")
        places = {s.name: n for n, s in enumerate(self.sensors)}
        if what and owner in places:
            return f"sensors[{places[owner]}].{units.get(what, what)}"
        return units.get(argument, argument)


@made_from(PlantUnit, "file")
class PlantUnitSection(Made):
    """For gtmodel loop: a functional mock-up unit in place of the simulated robot, and what its variables are."""

    file: str = Field(
        default="", description="the archive; the path starts at the problem's folder; --plant of gtmodel loop if empty"
    )

    def unit(self, path: Path | str) -> PlantUnit:
        """The plant, of an archive. Raises ArgumentError at its key."""
        with naming("plant."):
            return PlantUnit(file=path, **self.given())

    def of_folder(self, context: Context, out: Path) -> dict[str, str]:
        """What the manifest of a generated folder says instead: where the archive is from there.

        Raises InputError where there is none, ArgumentError for what cannot be a plant, before it is tried in the loop.
        """
        self.unit(self.file)
        return {"file": os.path.relpath(context.file(self.file, "plant.file", what="unit"), out)} if self.file else {}


class Schema(RobotProblem):
    """C code of functions of one robot, and of filters on its model."""

    real: Literal["double", "float"] = Field(default="double", description="the numbers that C computes with")
    name: str = Field(default="", description="prefix of the C names; the name of the problem file when empty")
    functions: list[Function] = Field(default=[], description="what to generate")
    filters: list[FilterSection] = Field(default=[], description="filters to generate, as step functions")
    box: dict[str, list[list[float]]] = Field(
        default={}, description='intervals by input, such as "der(T)" = [[-1.5, 1.5]]: inside every function answers'
    )
    fmu: FmuSection = FmuSection.left_out()
    check: Made[Verification] = Made[Verification].left_out()
    lead_through: Made[Guiding] | None = Field(
        default=None, description="for gtmodel loop --law lead_through: law, force sensors and a synthetic scene"
    )
    plant: PlantUnitSection | None = Field(
        default=None, description="for gtmodel loop: a unit (FMI) in place of the simulated robot"
    )

    def plant_unit(self, folder: Path, plant: Path | None, timeout: float | None = None) -> PlantUnit | None:
        """The plant of `gtmodel loop`: the unit that --plant names, or the one of the table [plant], from which this
        folder was made; timeout: that of --plant-timeout [s]. Raises InputError where one of both is missing,
        ArgumentError for what does not fit."""
        if self.plant is None:
            for option, value in (("--plant", plant), ("--plant-timeout", timeout)):
                if value is not None:
                    raise InputError(
                        f"{option} {value}: the folder's problem has no table [plant], which maps the unit's variables"
                    )
            return None
        path = plant or (folder / self.plant.file if self.plant.file else None)
        if path is None:
            raise InputError("--plant is missing: the folder's problem names the variables of a unit, not its file")
        if not path.is_file():
            said = (
                f"--plant {path}: there is no such file" if plant else f"plant.file '{path}': there is no such file; "
            )
            raise InputError(said if plant else f"{said}give it by --plant")
        unit = self.plant.unit(path)
        return unit if timeout is None else replace(unit, timeout=timeout)


def keys_of_units(problem: Schema) -> dict[str, str]:
    """Where the options stand that units are exported with."""
    shared = {"stop": "stop_s", "on_fault": "on_fault", "tolerance": "tolerance", "step": "step_s"}
    keys = {f"options.{f.name}.{option}": f"fmu.{key}" for f in problem.functions for option, key in shared.items()}
    keys |= {f"options.{f.name}.box": "box" for f in problem.functions}
    keys |= {f"options.{f.name}": f"functions[{n}]" for n, f in enumerate(problem.functions)}
    return keys | {f"options.{f.name}": f"filters[{n}]" for n, f in enumerate(problem.filters)}
