"""Keys of kind "codegen"."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, PositiveFloat

from gtmodel import cgen, predictive
from gtmodel.certify import InputSpeed
from gtmodel.cgen import Verification
from gtmodel.fmu.plant_unit import PlantUnit
from gtmodel.loop.disturbed import Disturbances
from gtmodel.loop.lead_through.options import Guiding
from gtmodel.predictive.options import AxisServo, ControlHorizon, Measurement
from gtmodel.problem_files.base import Context, FileSection, InputError
from gtmodel.problem_files.from_options import Made, made_from
from gtmodel.problem_files.keys import Free, RobotProblem
from gtmodel.results.reading import document
from gtmodel.results.refusal import naming

ESTIMATE: Free = "estimate"
RESULT = "gtmodel.cgen.CodeStudy"


class Function(FileSection):
    """A function that computes these targets from these known variables."""

    name: str = Field(min_length=1, description="C name of the function")
    known: list[str] = Field(default=[], description="names of variables prescribed with their derivatives")
    targets: list[str] = Field(min_length=1, description='names such as "T", "der(q)", "der(T,2)"')
    prefer: list[str] = Field(default=[], description="names to keep as states")
    branches: dict[str, Literal[-1, 1]] = Field(default={}, description="sign by name of a declared branch")
    trajectory: bool = Field(default=False, description="also generate NAME_at, along a sampled reference")
    jacobian: bool = Field(
        default=False,
        description="also generate NAME_jacobian, the derivatives of the targets by the inputs; not in units, which "
        "have them",
    )
    regular: bool = Field(default=False, description="for --certify: prove also that its Jacobian has full rank")
    start: dict[str, float | list[float]] = Field(
        default={},
        description="for --fmu: input or state = start value in SI; at rest at home if empty",
    )
    tunable: list[str] = Field(default=[], description="for --fmu: known variables that become tunable parameters")
    parameters: list[str] = Field(
        default=[], description='for --fmu: parameters of the model, such as "m_p", that stay tunable parameters'
    )

    @property
    def names(self) -> list[str]:
        """Names of all functions of this table."""
        return [self.name, f"{self.name}_jacobian"] if self.jacobian else [self.name]

    def with_jacobian(self, f: Any) -> dict[str, Any]:
        """Return the functions of `names`, of which `f` is the first."""
        return dict(zip(self.names, [f, cgen.jacobian_function(f)] if self.jacobian else [f], strict=True))


class FmuSection(FileSection):
    """Options of --fmu."""

    step_s: PositiveFloat | None = Field(
        default=None, description="longest step of the unit's integrator; chosen by its error if left out"
    )
    tolerance: PositiveFloat = Field(
        default=1e-6, description="largest error of a state, relative to its size or 1, compared with half the step"
    )
    stop_s: PositiveFloat = Field(default=1.0, description="end of the default experiment, used for the comparison")
    on_fault: Literal["discard", "hold"] = Field(
        default="discard",
        description="behaviour if there is no solution; hold: keep the last outputs and set an output status; not with "
        "states",
    )


class FilterSensorSection(FileSection):
    """A sensor of a filter: a variable of the model, its noise, and limits for plausible readings."""

    name: str = Field(min_length=1, description="name of the sensor; reading and flag NAME_valid are inputs in C")
    signal: str = Field(default="", description="measured variable; the sensor's name if empty")
    deviation: float | list[float] | Free | None = Field(
        default=None,
        description='standard deviation of one reading, in the unit of the signal, for angles in rad; "estimate": that '
        "of from_result",
    )
    density: float | list[float] | None = Field(
        default=None, description="instead of deviation: deviation times the root of the period [unit / sqrt(Hz)]"
    )
    period_s: PositiveFloat | None = Field(default=None, description="time between two readings, for a density")
    kind: Literal["vector", "quaternion", "direction"] = Field(default="vector", description="kind of reading")
    delay_s: float = Field(default=0.0, ge=0, description="delay of a reading: a multiple of the filter's period")
    gate: float | None = Field(
        default=None, gt=0, lt=1, description="reject readings beyond this quantile of chi-squared, such as 0.999"
    )
    stale_cycles: int | None = Field(default=None, ge=1, description="more cycles without a reading: GT_STALE_INPUT")
    closed_cycles: int | None = Field(
        default=None, ge=1, description="more consecutive readings beyond the gate: GT_OUT_OF_RANGE"
    )


class FilterStartSection(FileSection):
    """Start of a filter, set by NAME_defaults."""

    mean: dict[str, float | list[float]] = Field(
        default={}, description="state = value; other states start at zero or, if quaternions, without rotation"
    )
    deviation: dict[str, float | list[float]] = Field(
        description="state = standard deviation; required for every state"
    )


class FilterSection(FileSection):
    """A step function: the error-state Kalman filter of the model, driven by noise."""

    name: str = Field(min_length=1, description="C name: gt_<name>_<this>_init and _step")
    period_s: PositiveFloat = Field(description="period of the loop that calls it")
    from_result: str = Field(
        default="",
        description='result.json, or its folder, of kind "filtering": the noise that is "estimate" here, and the start '
        "if it is left out",
    )
    noise: dict[str, float | list[float] | Free] = Field(
        description='input = density of its white noise, in its unit squared times seconds; "estimate": that of '
        "from_result"
    )
    states: list[str] = Field(default=[], description="states; the model chooses if empty")
    inputs: list[str] = Field(default=[], description="known inputs of the model")
    quaternions: list[str] = Field(default=[], description="states that are unit quaternions, scalar first")
    sensors: list[FilterSensorSection] = Field(min_length=1, description="sensors, one table for each")
    start: FilterStartSection | None = Field(
        default=None, description="start of the filter; left out only with from_result"
    )

    def key_of(self, argument: str) -> str:
        """Return the key of an argument; "NAME.deviation" of a sensor gives "sensors[n].deviation"."""
        units = {"period": "period_s", "delay": "delay_s"}
        owner, _, what = argument.partition(".")
        places = {s.name: n for n, s in enumerate(self.sensors)}
        if what and owner in places:
            return f"sensors[{places[owner]}].{units.get(what, what)}"
        return units.get(argument, argument)


def from_result(section: FilterSection, context: Context, key: str) -> FilterSection:
    """Return the section with the numbers of its `from_result` in place of "estimate" and of a start that is left out.

    Raises InputError if a number is missing, and for a file that is not a usable result of kind "filtering".
    """
    free = {f"{name}.density": f"noise.{name}" for name, value in section.noise.items() if value == ESTIMATE}
    sensors = [(n, s.name) for n, s in enumerate(section.sensors) if s.deviation == ESTIMATE]
    free |= {f"{name}.deviation": f"sensors[{n}].deviation" for n, name in sensors}
    if not section.from_result:
        if free:
            place = next(iter(free.values()))
            raise InputError(
                'is "estimate"; name the result of kind "filtering" with the estimate in from_result', f"{key}.{place}"
            )
        if section.start is None:
            raise InputError("is missing; give the deviation of every state, or from_result", f"{key}.start")
        return section
    values = _values(context, section.from_result, f"{key}.from_result")
    noise = values.get("noise") or {}
    for name, place in free.items():
        if name not in noise:
            estimates = ", ".join(noise) or "none"
            raise InputError(f"the result holds no estimate of {name}; its estimates are {estimates}", f"{key}.{place}")
    for name in values.get("noise_undetermined") or ():
        if name in free:
            context.note(f"{section.from_result}: the log did not determine {name}, which the C code uses")
    start = section.start
    if start is None:
        start = FilterStartSection(mean=values["start"], deviation=values["start_deviation"])
    return section.model_copy(
        update={
            "noise": {n: _one(noise[f"{n}.density"]) if v == ESTIMATE else v for n, v in section.noise.items()},
            "sensors": [
                s.model_copy(update={"deviation": _one(noise[f"{s.name}.deviation"])}) if s.deviation == ESTIMATE else s
                for s in section.sensors
            ],
            "start": start,
        }
    )


def _one(numbers: list[float]) -> float | list[float]:
    return numbers[0] if len(numbers) == 1 else numbers


def _values(context: Context, name: str, key: str) -> Mapping[str, Any]:
    """Values of a result.json, or of the result.json in a folder."""
    folder = next((p for p in (context.folder / name, Path(name)) if p.is_dir()), None)
    path = context.file(f"{name}/result.json" if folder else name, key, what="result")
    try:
        data = document(path.read_bytes())
        kind, values, status = data["kind"], data["values"], data["status"]
    except (OSError, ValueError, KeyError, TypeError):
        raise InputError(f"'{name}' is not a result.json of gtmodel", key) from None
    if kind not in ("filtering", None):  # a study that Python wrote names no kind
        raise InputError(f"expected a result of kind 'filtering'; '{name}' is of kind '{kind}'", key)
    if not isinstance(values, Mapping) or not values.get("start"):
        raise InputError(f"the filter of '{name}' did not run to its end (status {status}); solve it again", key)
    if status != "solved":
        context.note(f"{name} has the status {status}, so its numbers are not to be used")
        context.distrusted.append(path.name)
    return values


@made_from(PlantUnit, "file")
class PlantUnitSection(Made):
    """For gtmodel loop: a functional mock-up unit instead of the simulated robot, and the meaning of its variables."""

    file: str = Field(
        default="", description="FMU file, from the problem's folder; set by --plant of gtmodel loop if empty"
    )

    def unit(self, path: Path | str) -> PlantUnit:
        """Return the plant from an FMU file. Raises ArgumentError with its key."""
        with naming("plant."):
            return PlantUnit(file=path, **self.given())

    def of_folder(self, context: Context, out: Path) -> dict[str, str]:
        """Return the entry for the manifest of a generated folder: the path of the FMU from there.

        Raises InputError if there is no such file, and ArgumentError if it cannot be a plant.
        """
        self.unit(self.file)
        return {"file": os.path.relpath(context.file(self.file, "plant.file", what="unit"), out)} if self.file else {}


@made_from(ControlHorizon)
class PredictiveSection(Made):
    """A step function: predictive control of the model, an optimum over a horizon solved again in every cycle."""

    name: str = Field(min_length=1, description="C name: gt_<name>_<this>_init and _step")
    tolerances: dict[str, float | list[float]] = Field(
        description="variable = deviation from its reference that counts 1 in the cost, in its SI unit"
    )
    targets: dict[str, float | list[float]] = Field(
        default={}, description="variable = reference; derivatives: 0; inputs: the value that holds the targets"
    )
    references: list[str] = Field(default=[], description="variables whose reference is an input of the C code")
    limits: dict[str, list[float] | list[list[float]]] = Field(
        default={}, description="variable = [low, high], or one pair for each entry; exact for inputs, else soft"
    )
    prices: dict[str, list[float]] = Field(
        default={}, description="limited variable = [linear, quadratic] price of exceeding its limit by its own size"
    )
    measured: dict[str, Made[Measurement]] = Field(
        default={}, description="measured variables and their noise; all states if left out"
    )
    disturbance: dict[str, PositiveFloat] = Field(
        default={}, description="input = standard deviation of its random change in one second; for `measured`"
    )
    servo: Made[AxisServo] | None = Field(
        default=None, description="the plant takes positions: servo of its axes, which the controller predicts with"
    )
    outputs: list[str] = Field(default=[], description="further outputs, at the end of a period")
    prefer: list[str] = Field(default=[], description="names to keep as states")

    def made(self, model: Any, context: Context, key: str) -> predictive.Controller:
        """Return the controller of the model. Raises ArgumentError and ModelError."""
        with naming("measured."):
            measured = {name: m.options() for name, m in self.measured.items()}
        names = ("tolerances", "targets", "references", "limits", "prices", "disturbance", "outputs", "prefer")
        given = {name: getattr(self, name) for name in names}
        with naming("servo."):
            servo = None if self.servo is None else self.servo.options()
        return predictive.controller(model, self.options(), measured=measured, servo=servo, **given)

    def key_of(self, argument: str) -> str:
        """Return the key of an argument."""
        return {"period": "period_s", "length": "length_s"}.get(argument, argument)


class Schema(RobotProblem):
    """C code of functions, filters and predictive controllers of one robot."""

    real: Literal["double", "float"] = Field(default="double", description="floating-point type in C")
    name: str = Field(default="", description="prefix of the C names; the name of the problem file if empty")
    functions: list[Function] = Field(default=[], description="functions to generate")
    filters: list[FilterSection] = Field(default=[], description="filters to generate, as step functions")
    predictive: list[PredictiveSection] = Field(default=[], description="predictive controllers, as step functions")
    box: dict[str, list[list[float]]] = Field(
        default={},
        description='intervals by input, such as "der(T)" = [[-1.5, 1.5]], where every function must have a solution',
    )
    moving: Made[InputSpeed] | None = Field(
        default=None, description="for --certify: motion of the inputs between two calls of functions with a state"
    )
    fmu: FmuSection = FmuSection.left_out()
    check: Made[Verification] = Made[Verification].left_out()
    lead_through: Made[Guiding] | None = Field(
        default=None, description="for gtmodel loop --law lead_through: law, force sensors and a synthetic scene"
    )
    disturbances: Made[Disturbances] | None = Field(
        default=None, description="for gtmodel loop: delay, noise and saturation of the simulated robot"
    )
    plant: PlantUnitSection | None = Field(
        default=None, description="for gtmodel loop: a unit (FMI) instead of the simulated robot"
    )

    @property
    def jacobians(self) -> list[str]:
        """Names of the functions that are Jacobians."""
        return [name for f in self.functions for name in f.names[1:]]

    @property
    def wanted(self) -> tuple[InputSpeed | None, list[str]]:
        """What --certify proves beside the status."""
        return None if self.moving is None else self.moving.options(), [f.name for f in self.functions if f.regular]

    def robot_from(self, context: Context, out: Path) -> str:
        """Return the robot as the manifest of a generated folder names it: the path of its file from there."""
        name, colon, part = self.robot.partition(":")
        file = next((p for p in (context.folder / name, Path(name)) if p.is_file()), None)
        return self.robot if file is None else os.path.relpath(file, out) + colon + part

    def plant_unit(self, folder: Path, plant: Path | None, timeout: float | None = None) -> PlantUnit | None:
        """Return the plant of `gtmodel loop`: the unit that --plant or the table [plant] names.

        timeout: value of --plant-timeout [s]. Raises InputError if the table or the file is missing, ArgumentError if
        the unit does not fit.
        """
        if self.plant is None:
            for option, value in (("--plant", plant), ("--plant-timeout", timeout)):
                if value is not None:
                    raise InputError(
                        f"{option} {value}: the folder's problem has no table [plant], which maps the unit's variables"
                    )
            return None
        path = plant or (folder / self.plant.file if self.plant.file else None)
        if path is None:
            raise InputError("--plant is missing: the folder's problem names the variables of a unit, but not its file")
        if not path.is_file():
            if plant:
                raise InputError(f"--plant {path}: there is no such file")
            raise InputError(f"plant.file '{path}': there is no such file; name it with --plant")
        unit = self.plant.unit(path)
        return unit if timeout is None else replace(unit, timeout=timeout)


def keys_of_units(problem: Schema) -> dict[str, str]:
    """Return the keys of the options for the export of units."""
    shared = {"stop": "stop_s", "on_fault": "on_fault", "tolerance": "tolerance", "step": "step_s"}
    keys = {f"options.{f.name}.{option}": f"fmu.{key}" for f in problem.functions for option, key in shared.items()}
    keys |= {f"options.{f.name}.box": "box" for f in problem.functions}
    keys |= {f"options.{f.name}": f"functions[{n}]" for n, f in enumerate(problem.functions)}
    keys |= {f"options.{f.name}": f"filters[{n}]" for n, f in enumerate(problem.filters)}
    return keys | {f"options.{f.name}": f"predictive[{n}]" for n, f in enumerate(problem.predictive)}
