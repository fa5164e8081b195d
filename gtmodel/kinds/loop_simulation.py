"""Kind "loop_simulation": a robot in continuous time under a sampled control law."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field, PositiveFloat

from gtmodel import control, lang, problem_files
from gtmodel.control import Move, loop_options
from gtmodel.lang import ModelError
from gtmodel.problem_files.base import Call, Context, FileSection, InputError
from gtmodel.problem_files.from_options import Made
from gtmodel.problem_files.keys import RobotProblem
from gtmodel.results import Trajectory, TrajectoryError

RESULT = "gtmodel.control.LoopSimulationStudy"


class LawSection(FileSection):
    """The control law, based on the robot of the problem."""

    name: Literal["computed_torque", "feedforward", "feedback"] = Field(
        default="computed_torque",
        description="computed_torque: inverse dynamics at the measured state; feedforward: inverse dynamics of the "
        "reference plus feedback; feedback: only feedback",
    )
    stiffness: float | list[float] = Field(
        description="gain of the position error, one or one per actuator: 1/s2 with computed_torque, otherwise N/m"
    )
    damping: float | list[float] = Field(
        description="gain of the velocity error: 1/s with computed_torque, otherwise N.s/m"
    )


class ReferenceSection(FileSection):
    """A motion from a file, instead of [move]."""

    file: str = Field(
        description='CSV file in the format that gtmodel writes, with the tool centre point "T" or the positions "q" '
        "at equal steps; the path starts at the problem's folder"
    )


class PlantFrictionSection(FileSection):
    """Friction of the controlled robot, which may stick."""

    smoothing: Literal["tanh", "piecewise_linear", "stiction"] | None = Field(
        default=None,
        description="smoothing of the sign of the velocity; stiction: no smoothing, friction that sticks, with events; "
        "as in [friction] if left out",
    )
    velocity_scale_m_s: PositiveFloat | None = Field(
        default=None,
        description="velocity over which the sign changes, in m/s, and in rad/s at revolute joints; "
        "as in [friction] if left out",
    )


class PlantSection(FileSection):
    """Differences between the controlled robot and the law's model."""

    parameters: dict[str, Any] = Field(default={}, description="further values of parameters by name, in SI")
    inertia: str | None = Field(default=None, description="different masses and friction of a catalogue robot")
    payload_kg: float | None = Field(default=None, ge=0, description="different mass on the plate")
    friction: PlantFrictionSection = PlantFrictionSection.left_out()


class Schema(RobotProblem):
    """A robot in continuous time under a sampled control law. Give one of [move] and [reference]."""

    law: LawSection
    sampling: Made[loop_options.LoopSampling] = Made[loop_options.LoopSampling].left_out()
    move: Made[loop_options.Move] | None = Field(default=None, description="a straight motion of the tool")
    reference: ReferenceSection | None = Field(default=None, description="a motion from a file")
    plant: PlantSection = PlantSection.left_out()
    limits: Made[loop_options.TrackingLimits] = Made[loop_options.TrackingLimits].left_out()
    tolerance: float = Field(default=1e-9, ge=1e-14, le=0.1, description="tolerance of the integrator")


def arguments(problem: Schema) -> dict[str, str]:
    """Return the key of the study's reference."""
    return {"reference": "move" if problem.move is not None else "reference.file"}


def call(problem: Schema, context: Context) -> Call:
    """Return the call of the simulation of the plant under the law."""
    if context.start is not None:
        raise InputError("--start: the simulation starts on its reference; leave it out")
    if (problem.move is None) == (problem.reference is None):
        present = "both" if problem.move else "neither"
        raise InputError(f"expected one of [move] and [reference]; found {present}", "move")
    law = law_of(problem.law, problem.model(context))
    return Call(
        control.loop_simulation, _plant(problem, context), law, _reference(problem, context),
        sampling=problem.sampling.options(), limits=problem.limits.options(), tolerance=problem.tolerance,
        title=problem.title or f"sampled {problem.law.name}: {problem.robot}",
    )  # fmt: skip


def explain(problem: Schema, context: Context) -> str:
    """Describe the timing and the measurements of the controller."""
    s = problem.sampling.options()
    text = f"{problem.heading}: {problem.law.name} every {1e3 * s.period:g} ms"
    lines = [text, f"  forces act {1e3 * s.delay:g} ms after their sample, with zero-order hold"]
    lines.append(f"  positions {'to ' + format(1e6 * s.resolution, 'g') + ' um' if s.resolution else 'exact'}")
    lines.append(f"  velocities {'of the plant' if s.velocity == 'measured' else 'from differences'}")
    changes = problem.plant.model_dump(exclude_defaults=True)
    lines.append(f"  the plant differs from the law's model in {', '.join(changes) or 'nothing'}")
    return "\n".join(lines)


def law_of(section: LawSection, model: lang.Model) -> control.Law:
    """Return the control law of a table, based on a model. Raises InputError."""
    gains = [_gain(g) for g in (section.stiffness, section.damping)]
    laws = {"computed_torque": control.ComputedTorque, "feedforward": control.Feedforward}
    try:
        # pyrefly: ignore[bad-argument-type]
        return control.Feedback(*gains) if section.name == "feedback" else laws[section.name](model, *gains)
    except (ValueError, ModelError) as error:
        raise InputError(str(error), "law") from error


def _gain(value: float | list[float]) -> control.feedforward.Gain:
    return tuple(value) if isinstance(value, list) else value


def _plant(problem: Schema, context: Context) -> lang.Model:
    changes, friction = problem.plant, problem.plant.friction
    return problem_files.robots.resolve(
        problem.robot,
        context,
        parameters=problem.parameters | changes.parameters,
        inertia=changes.inertia or problem.inertia,
        smoothing=friction.smoothing or problem.friction.smoothing,
        velocity_scale=friction.velocity_scale_m_s or problem.friction.velocity_scale_m_s,
        payload=problem.payload_kg if changes.payload_kg is None else changes.payload_kg,
    )


def _reference(problem: Schema, context: Context) -> Move | Trajectory:
    if problem.move is not None:
        return problem.move.options()
    assert problem.reference is not None
    path = context.file(problem.reference.file, "reference.file", "reference")
    try:
        return Trajectory.from_csv(path)
    except TrajectoryError as error:
        raise InputError(str(error), "reference.file") from error
