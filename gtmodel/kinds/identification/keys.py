"""The keys of kind "identification"."""

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
    """Friction of the model that is fitted."""

    smoothing: Literal["sign", "tanh", "piecewise_linear"] | None = Field(
        default=None, description="of a catalogue robot or robot file: sign, exact away from standstill, if left out"
    )
    velocity_scale_m_s: PositiveFloat | None = Field(
        default=None, description="velocity over which a smoothed sign changes; the catalogue's own is 0.1"
    )


class IdentificationLogSection(LogFiles):
    """Measured logs."""

    position: MeasuredSignalSection = Field(description="the known variable; scale and offset in its SI unit")
    effort: MeasuredSignalSection = Field(description="the measured efforts; scale and offset in their SI unit")
    inputs: dict[str, MeasuredSignalSection] = Field(
        default={}, description="further measured variables of the model by name: a second force, a payload; all known"
    )
    held_out: list[str] = Field(default=[], description="logs of other motions, for validation only")


@made_from(options.SyntheticLog)
class SyntheticLogSection(Made):
    """A synthetic log of a plant, to see what identification gives back: sines, tracking, sensors, noise."""

    reference_file: str | None = Field(
        default=None,
        description="CSV file with its columns, such as the trajectory.csv of an excitation, in place of the sines; "
        "the motion held out is of sines still",
    )
    parameters: dict[str, Any] = Field(default={}, description="of the plant where other than the model's, in SI")


@made_from(options.ClosedLoop, "model", "inputs")
class ClosedLoopSection(Made):
    """Simulation of the controlled model from the measured reference, with the identified parameters."""

    model: str = Field(description="controlled model in Python, file.py:Class; takes [parameters] and what was found")
    inputs: dict[str, MeasuredSignalSection] = Field(description="its inputs by name, such as the reference")

    def loop(self, parameters: Mapping[str, Any], context: Context) -> options.ClosedLoop:
        """As the study takes it; the model with these parameters and what is found."""

        from gtmodel.problem_files import python_models  # here, as below: the keys alone need no model

        def made(**estimates: Any) -> Model:
            return python_models.resolve(self.model, context, "closed_loop.model", {**parameters, **estimates})

        own = {field: getattr(self, key) for key, field in self.attributes.items()}
        return options.ClosedLoop(made, list(self.inputs), **own)

    def signals(self, context: Context) -> dict[str, Signal]:
        """The inputs as measured signals, in the units of the model. Raises InputError."""
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
                    raise InputError("the fit does not see this signal; give a number", f"{key}.{what}")
            signals[name] = signal.signal(key, unit)
        return signals


@made_from(options.Fitting, "inputs")
class Schema(RobotProblem, Made):
    """Masses and friction of a robot, or any parameters in which its efforts are linear, from measured motion."""

    free: list[str] | None = Field(default=None, description="parameters to be estimated; those of the variant")
    variant: str | None = Field(
        default=None, description="of a three-link robot: model_1 to model_4 of Table 6.3, or links (thirteen)"
    )
    friction: SharpFriction = SharpFriction()  # pyright: ignore[reportIncompatibleVariableOverride]
    filter: Made[Processing] = Made[Processing].left_out()
    log: IdentificationLogSection | None = Field(default=None, description="measured logs")
    synthetic: SyntheticLogSection | None = Field(default=None, description="or a synthetic log")
    published: dict[str, float] = Field(default={}, description="numbers to compare with, by parameter, in SI")
    closed_loop: ClosedLoopSection | None = Field(
        default=None, description="validation by simulating the controlled model"
    )

    def fitting(self) -> options.Fitting:
        """As the study takes it, with what the log measures besides."""
        return replace(self.options(), inputs=list(self.log.inputs if self.log else {}))

    def fitted(self, context: Context) -> tuple[Model, list[str]]:
        """The model to be fitted, and the names of what is free. Raises InputError."""
        if self.variant is None:
            if not self.free and self.options().inertias is None:
                raise InputError("is missing; name the parameters to be estimated, or a variant", "free")
            return self.with_parameters(self.parameters, context), list(self.free or [])
        from gtmodel.robots.by_direction import inertia_variant

        if self.options().inertias is not None:
            raise InputError("is for serial arms; a variant says which masses there are", "inertias")
        self._check_variant()
        scale = self.friction.velocity_scale_m_s
        more: dict[str, Any] = {} if scale is None else {"velocity_scale": scale}
        try:
            variant = inertia_variant(
                self.variant, self.robot, self.friction.smoothing or "sign", **more, **self.parameters
            )
        except ModelError as error:
            raise InputError(str(error), "parameters" if self.parameters else "variant") from error
        return variant.robot, list(self.free or variant.free)

    def with_parameters(self, parameters: dict[str, Any], context: Context) -> Model:
        """The robot, no variant of it, with these parameters. Raises InputError."""
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
            raise InputError(f"applies to three-link robots of the catalogue; '{self.robot}' is none", "variant")
        for key in ("inertia", "payload_kg"):
            if getattr(self, key) is not None:
                raise InputError("a variant says which masses there are; leave one of the two out", key)
        if self.friction.smoothing == "piecewise_linear":
            raise InputError('a variant takes "sign" or "tanh"', "friction.smoothing")
