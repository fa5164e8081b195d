"""The keys by which a problem file names its robot; shared by the kinds that have one."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

from pydantic import Field, PositiveFloat

from .base import Context, FileSection, Problem

if TYPE_CHECKING:
    from gtmodel.lang import Model


class FrictionSection(FileSection):
    """Friction, smoothed around zero velocity."""

    smoothing: Literal["tanh", "piecewise_linear"] | None = Field(
        default=None, description="how the sign of the velocity is smoothed; the catalogue's own is tanh"
    )
    velocity_scale_m_s: PositiveFloat | None = Field(
        default=None, description="velocity over which the sign changes; the catalogue's own is 0.1"
    )


class RobotProblem(Problem):
    """A problem about one robot."""

    robot: str = Field(
        description="catalogue name, TOML robot file, URDF file (arm.urdf, arm.urdf:tip), or a model in Python: "
        "package.module:Class, file.py:Class"
    )
    inertia: str | None = Field(
        default=None, description="identified masses and friction of a catalogue robot; the catalogue's own is model_2"
    )
    payload_kg: float | None = Field(default=None, ge=0, description="mass added to the plate")
    parameters: dict[str, Any] = Field(
        default={}, description="modifiers of the model, by its own parameter names, in SI"
    )
    friction: FrictionSection = FrictionSection.left_out()

    def model(self, context: Context) -> Model:
        """The robot, configured. Raises InputError."""
        from . import robots  # here: the keys alone need no robot

        return robots.resolve(
            self.robot,
            context,
            parameters=self.parameters,
            inertia=self.inertia,
            smoothing=self.friction.smoothing,
            velocity_scale=self.friction.velocity_scale_m_s,
            payload=self.payload_kg,
        )
