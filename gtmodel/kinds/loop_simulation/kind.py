"""Kind "loop_simulation": a robot in continuous time under a control law that computes at samples."""

from __future__ import annotations

from gtmodel.control import ComputedTorque, Feedback, Feedforward, Move, loop_simulation
from gtmodel.control.feedforward import Gain, Law
from gtmodel.lang import Model, ModelError
from gtmodel.problem_files import robots
from gtmodel.problem_files.base import Context, InputError
from gtmodel.problem_files.call import Call
from gtmodel.results import Trajectory, TrajectoryError

from .keys import LawSection, Schema

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
        loop_simulation, _plant(problem, context), law, _reference(problem, context),
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


def law_of(section: LawSection, model: Model) -> Law:
    """The law that a table names, on a model. Raises InputError."""
    gains = [_gain(g) for g in (section.stiffness, section.damping)]
    laws = {"computed_torque": ComputedTorque, "feedforward": Feedforward}
    try:
        return Feedback(*gains) if section.name == "feedback" else laws[section.name](model, *gains)
    except (ValueError, ModelError) as error:
        raise InputError(str(error), "law") from error


def _gain(given: float | list[float]) -> Gain:
    return tuple(given) if isinstance(given, list) else given


def _plant(problem: Schema, context: Context) -> Model:
    own, friction = problem.plant, problem.plant.friction
    return robots.resolve(
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
