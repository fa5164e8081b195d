"""Kind "loop_simulation": a robot in continuous time under a control law that computes at samples."""

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
    """The control law, on the robot as the problem names it."""

    name: Literal["computed_torque", "feedforward", "feedback"] = Field(
        default="computed_torque",
        description="inverse dynamics at the measured state, inverse dynamics of the reference beside a feedback, or "
        "the feedback alone",
    )
    stiffness: float | list[float] = Field(
        description="gain of the position error, one or one for each actuator: 1/s2 with computed_torque, else N/m"
    )
    damping: float | list[float] = Field(description="gain of the velocity error: 1/s with computed_torque, else N.s/m")


class ReferenceSection(FileSection):
    """A motion from a file in place of [move]."""

    file: str = Field(
        description='CSV file as gtmodel writes it, with the tool centre point "T" or the positions "q" at equal '
        "steps; the path starts at the problem's folder"
    )


class PlantFrictionSection(FileSection):
    """Friction of the robot that is controlled, which may stick."""

    smoothing: Literal["tanh", "piecewise_linear", "stiction"] | None = Field(
        default=None,
        description="how the sign of the velocity is smoothed; stiction: not at all, it sticks, with events; left out: "
        "as [friction] has it",
    )
    velocity_scale_m_s: PositiveFloat | None = Field(
        default=None, description="velocity over which the sign changes; left out: as [friction] has it"
    )


class PlantSection(FileSection):
    """How the robot that is controlled differs from the one that the law knows."""

    parameters: dict[str, Any] = Field(default={}, description="modifiers beside those of the problem, in SI")
    inertia: str | None = Field(default=None, description="other masses and friction of a catalogue robot")
    payload_kg: float | None = Field(default=None, ge=0, description="another mass on the plate")
    friction: PlantFrictionSection = PlantFrictionSection.left_out()


class Schema(RobotProblem):
    """A robot in continuous time under a control law that computes at samples. One of [move] and [reference]."""

    law: LawSection
    sampling: Made[loop_options.LoopSampling] = Made[loop_options.LoopSampling].left_out()
    move: Made[loop_options.Move] | None = Field(default=None, description="a straight motion of the tool")
    reference: ReferenceSection | None = Field(default=None, description="a motion from a file")
    plant: PlantSection = PlantSection.left_out()
    limits: Made[loop_options.TrackingLimits] = Made[loop_options.TrackingLimits].left_out()
    tolerance: float = Field(default=1e-9, ge=1e-14, le=0.1, description="of the integrator")


NAME = "loop_simulation"


def arguments(problem: Schema) -> dict[str, str]:
    """Where the reference of the study stands."""
    return {"reference": "move" if problem.move is not None else "reference.file"}


def call(problem: Schema, context: Context) -> Call:
    """The motion of the plant under the law of the robot's model."""
    if context.start is not None:
        raise InputError("--start: a simulated loop begins at its reference; leave it out")
    if (problem.move is None) == (problem.reference is None):
        given = "both" if problem.move else "none of them"
        raise InputError(f"expected one of [move] and [reference]; found {given}", "move")
    law = law_of(problem.law, problem.model(context))
    return Call(
        control.loop_simulation, _plant(problem, context), law, _reference(problem, context),
        sampling=problem.sampling.options(), limits=problem.limits.options(), tolerance=problem.tolerance,
        title=problem.title or f"{problem.law.name} at samples: {problem.robot}",
    )  # fmt: skip


def explain(problem: Schema, context: Context) -> str:
    """What the controller does when."""
    s = problem.sampling.options()
    text = f"{problem.title or NAME}: {problem.law.name} every {1e3 * s.period:g} ms"
    lines = [text, f"  forces act {1e3 * s.delay:g} ms after their sample and are held until the next ones"]
    lines.append(f"  positions {'to ' + format(1e6 * s.resolution, 'g') + ' um' if s.resolution else 'exact'}")
    lines.append(f"  velocities {'as the plant has them' if s.velocity == 'measured' else 'by differences'}")
    own = problem.plant.model_dump(exclude_defaults=True)
    lines.append(f"  the plant differs from the law's model in {', '.join(own) or 'nothing'}")
    return "\n".join(lines)


def law_of(section: LawSection, model: lang.Model) -> control.Law:
    """The law that a table names, on a model. Raises InputError."""
    gains = [_gain(g) for g in (section.stiffness, section.damping)]
    laws = {"computed_torque": control.ComputedTorque, "feedforward": control.Feedforward}
    try:
        return control.Feedback(*gains) if section.name == "feedback" else laws[section.name](model, *gains)
    except (ValueError, ModelError) as error:
        raise InputError(str(error), "law") from error


def _gain(given: float | list[float]) -> control.feedforward.Gain:
    return tuple(given) if isinstance(given, list) else given


def _plant(problem: Schema, context: Context) -> lang.Model:
    own, friction = problem.plant, problem.plant.friction
    return problem_files.robots.resolve(
        problem.robot,
        context,
        parameters=problem.parameters | own.parameters,
        inertia=own.inertia or problem.inertia,
        smoothing=friction.smoothing or problem.friction.smoothing,
        velocity_scale=friction.velocity_scale_m_s or problem.friction.velocity_scale_m_s,
        payload=problem.payload_kg if own.payload_kg is None else own.payload_kg,
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
