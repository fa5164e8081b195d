"""Keys of kind "identification"."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal

from pydantic import Field, PositiveFloat

from gtmodel.identify import Processing, options
from gtmodel.lang import ModelError
from gtmodel.measurements import Signal
from gtmodel.problem_files.base import Context, FileSection, InputError
from gtmodel.problem_files.from_options import Made, made_from
from gtmodel.problem_files.keys import LogFiles, MeasuredSignalSection, RobotProblem
from gtmodel.robots import entries

if TYPE_CHECKING:
    from gtmodel.lang import Model

RESULT = "gtmodel.identify.IdentificationStudy"


class SharpFriction(FileSection):
    """Friction of the fitted model."""

    smoothing: Literal["sign", "tanh", "piecewise_linear"] | None = Field(
        default=None, description="for catalogue robots and robot files; sign, exact except at standstill, if left out"
    )
    velocity_scale_m_s: PositiveFloat | None = Field(
        default=None,
        description="velocity over which a smoothed sign changes, in m/s, and in rad/s at revolute joints; "
        "0.1 for robots of the catalogue",
    )


class IdentificationLogSection(LogFiles):
    """Measured logs."""

    position: MeasuredSignalSection = Field(description="the known variable; scale and offset in its SI unit")
    effort: MeasuredSignalSection = Field(description="the measured efforts; scale and offset in their SI unit")
    inputs: dict[str, MeasuredSignalSection] = Field(
        default={}, description="further measured variables of the model, by name, such as a second force or a payload"
    )
    held_out: list[str] = Field(default=[], description="logs of other motions, for validation only")


@made_from(options.SyntheticLog)
class SyntheticLogSection(Made):
    """A synthetic log of a plant, to test the identification: sines, tracking, sensors, noise."""

    reference_file: str | None = Field(
        default=None,
        description="CSV file of the motion, such as the trajectory.csv of an excitation, instead of sines; the "
        "held-out motion still consists of sines",
    )
    parameters: dict[str, Any] = Field(
        default={}, description="parameters of the plant that differ from the model, by name, in SI"
    )


@made_from(options.ClosedLoop, "model", "inputs")
class ClosedLoopSection(Made):
    """Simulation of the controlled model from the measured reference, with the identified parameters."""

    model: str = Field(
        description="controlled model in Python, file.py:Class; gets [parameters] and the estimated parameters"
    )
    inputs: dict[str, MeasuredSignalSection] = Field(description="inputs by name, such as the reference")

    def loop(self, parameters: Mapping[str, Any], context: Context) -> options.ClosedLoop:
        """Return the options of the study; the model gets these parameters and the estimates."""

        from gtmodel.problem_files import python_models  # here, as below: the keys alone need no model

        def model(**estimates: Any) -> Model:
            return python_models.resolve(self.model, context, "closed_loop.model", {**parameters, **estimates})

        fields = {field: getattr(self, key) for key, field in self.attributes.items()}
        return options.ClosedLoop(model, list(self.inputs), **fields)

    def signals(self, context: Context) -> dict[str, Signal]:
        """Return the inputs as measured signals, in the units of the model. Raises InputError."""
        from gtmodel.compiler.causal import flat_of
        from gtmodel.problem_files import python_models

        flat = flat_of(python_models.resolve(self.model, context, "closed_loop.model"))
        signals = {}
        for name, signal in self.inputs.items():
            key = f"closed_loop.inputs.{name}"
            try:
                unit = flat.variables[flat.lookup(name)[1][0]].unit
            except ModelError as error:
                raise InputError(str(error), key) from error
            for what in ("scale", "offset", "delay_s"):
                if getattr(signal, what) == "estimate":
                    raise InputError("the fit does not use this signal; give a number", f"{key}.{what}")
            signals[name] = signal.signal(key, unit)
        return signals


@made_from(options.Fitting, "inputs")
class Schema(RobotProblem, Made):
    """Masses and friction of a robot, or any parameters in which its efforts are linear, from measured motion."""

    free: list[str] | None = Field(default=None, description="parameters to estimate; those of the variant if left out")
    variant: str | None = Field(
        default=None,
        description="for a three-link robot: model_1 to model_4 of Table 6.3, or links, with thirteen parameters",
    )
    friction: SharpFriction = SharpFriction()  # pyrefly: ignore[bad-override]
    filter: Made[Processing] = Made[Processing].left_out()
    log: IdentificationLogSection | None = Field(default=None, description="measured logs")
    synthetic: SyntheticLogSection | None = Field(default=None, description="a synthetic log")
    published: dict[str, float] = Field(default={}, description="numbers to compare with, by parameter, in SI")
    closed_loop: ClosedLoopSection | None = Field(
        default=None, description="validation with a simulation of the controlled model"
    )

    def fitting(self) -> options.Fitting:
        """Return the options of the study, with the further inputs of the log."""
        return replace(self.options(), inputs=list(self.log.inputs if self.log else {}))

    def fitted(self, context: Context) -> tuple[Model, list[str]]:
        """Return the model to fit and the names of its free parameters. Raises InputError."""
        if self.variant is None:
            if not self.free and self.options().inertias is None:
                raise InputError("is missing; name the parameters to estimate, or a variant", "free")
            return self.with_parameters(self.parameters, context), list(self.free or [])
        from gtmodel.robots.by_direction import inertia_variant

        if self.options().inertias is not None:
            raise InputError("is for serial arms; a variant defines the masses", "inertias")
        self._check_variant()
        scale = self.friction.velocity_scale_m_s
        keywords: dict[str, Any] = {} if scale is None else {"velocity_scale": scale}
        try:
            variant = inertia_variant(
                self.variant, self.robot, self.friction.smoothing or "sign", **keywords, **self.parameters
            )
        except ModelError as error:
            raise InputError(str(error), "parameters" if self.parameters else "variant") from error
        return variant.robot, list(self.free or variant.free)

    def with_parameters(self, parameters: dict[str, Any], context: Context) -> Model:
        """Return the robot, without its variant, with these parameters. Raises InputError."""
        from gtmodel.problem_files import python_models, robots

        in_python = python_models.is_reference(self.robot)
        return robots.resolve(
            self.robot,
            context,
            parameters=parameters,
            inertia=self.inertia,
            smoothing=self.friction.smoothing or (None if in_python else "sign"),
            velocity_scale=self.friction.velocity_scale_m_s,
            payload=self.payload_kg,
        )

    def _check_variant(self) -> None:
        from gtmodel.robots.by_direction import VARIANTS

        entry = entries().get(self.robot)
        if self.variant not in VARIANTS:
            raise InputError(f"there is no variant '{self.variant}'; there are {', '.join(VARIANTS)}", "variant")
        if entry is None or entry.family != "three_link":
            raise InputError(f"applies to three-link robots of the catalogue only; found '{self.robot}'", "variant")
        for key in ("inertia", "payload_kg"):
            if getattr(self, key) is not None:
                raise InputError("a variant defines the masses; leave one of the two out", key)
        if self.friction.smoothing == "piecewise_linear":
            raise InputError('a variant needs "sign" or "tanh"', "friction.smoothing")
