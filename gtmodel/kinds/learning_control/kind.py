"""Kind "learning_control": a law that learns from run to run, on a synthetic robot or for a measured run."""

from __future__ import annotations

from gtmodel.control.learning import (
    LearningRobot,
    ModelledRobot,
    SimulatedMotion,
    lag_robot,
    next_input,
    options,
    study,
)
from gtmodel.lang import ModelError
from gtmodel.problem_files.base import Context, InputError
from gtmodel.problem_files.call import Call
from gtmodel.problem_files.from_options import options_of
from gtmodel.results import ArgumentError, Trajectory
from gtmodel.robots import gantry_tau

from .keys import RunSection, Schema, recorded

NAME = "learning_control"
ARGUMENTS = {
    "design": "learning", "path": "reference", "run": "log", "law": "learning", "cutoff": "learning.cutoff",
    "ramp": "log.ramp_samples", "repeats": "log.repeats",
    "length": "learning.lags", "shift": "learning.shift", "side_time": "reference.side_time",
}  # fmt: skip


def call(problem: Schema, context: Context) -> Call:
    """The study of a synthetic robot, or of one measured run."""
    if context.start is not None:
        raise InputError("--start: learning starts from an input in the log; leave it out")
    design, path, noise = options_of(problem, "learning", "reference", "noise").values()
    robot = robot_of(problem, context)
    if problem.simulated is not None:
        if problem.log is not None:
            raise InputError("is a robot in place of a measured run; leave one of both out", "simulated")
        section = problem.simulated
        try:
            model = gantry_tau(section.robot, inertia=section.inertia)
        except ModelError as error:
            raise InputError(str(error), "simulated.robot") from error
        motion = SimulatedMotion(model, section.options(), path, noise, robot.sample_time)
        return Call(study, robot, path, design, noise, experiment=motion, title=problem.title)
    if problem.log is None:
        return Call(study, robot, path, design, noise, title=problem.title)
    for name in ("reference", "noise"):
        if name in problem.model_fields_set:
            raise InputError("belongs to a synthetic robot; with [log] leave it out", name)
    log = problem.log
    run = _run(log, log.files, context)
    repeats = [_run(log, [name], context) for name in log.repeats]
    if 0 < len(repeats) < 3:
        raise InputError(f"names {len(repeats)} runs; their scatter wants three or more", "log.repeats")
    return Call(
        next_input, robot, run, design, repeats=repeats, ramp=log.ramp_samples,
        acceleration_noise=log.acceleration_noise_m_s2, title=problem.title,
    )  # fmt: skip


def explain(problem: Schema, context: Context) -> str:
    """Which robot, which law, what is learned from."""
    design, path, noise = options_of(problem, "learning", "reference", "noise").values()
    robot = robot_of(problem, context)
    lines = [f"{problem.title or NAME}: case {design.case}, law {design.law}, axes {', '.join(robot.axes)}"]
    if isinstance(robot, ModelledRobot):
        for k, name in enumerate(robot.axes):
            mode = robot.mode(k)
            of = "no light mode" if mode is None else f"lightest mode {mode[0]:.3g} Hz (damping {mode[1]:.2g})"
            lines.append(f"  {name}: {', '.join(robot.plants[k].signals)}; {of}")
    elif robot.loop == "lag":
        tools = ", ".join(f"{f:g} Hz (damping {z:g})" for f, z in zip(robot.frequency, robot.damping, strict=True))
        lines.append(f"  motor loop: lag of {1e3 * robot.lag:g} ms behind {robot.delay} samples; tool: {tools}")
    lines.append(f"  Q: low pass at {design.low_pass:g} Hz, of {len(design.models(robot, 0))} models per axis")
    if problem.simulated is not None:
        tip = problem.simulated.options()
        lines.append(f"  simulated: {problem.simulated.robot} with {tip.mass:g} kg on a spring at {tip.frequency:g} Hz")
    elif problem.log is None:
        lines.append(
            f"  synthetic: {path.profile} sides of {1e3 * path.side:g} mm in {path.side_time:g} s, seed {noise.seed}, "
            f"{noise.repeats} identical runs, then {design.iterations} iterations"
        )
    else:
        run = _run(problem.log, problem.log.files, context)
        lines.append(f"  measured run: {len(run)} rows, signals {', '.join(run.names)}")
    return "\n".join(lines)


def _run(log: RunSection, files: list[str], context: Context) -> Trajectory:
    return recorded(log, log.signals, files, "log", context, log.synthetic)


def robot_of(problem: Schema, context: Context) -> LearningRobot | ModelledRobot:
    """What [robot] or [plant] says. Raises InputError."""
    section = problem.plant
    if section is None:
        return options_of(problem, "robot")["robot"]
    if "robot" in problem.model_fields_set:
        raise InputError("is the robot by a log, a model or numbers; leave [robot] out", "plant")
    ways = [name for name in ("files", "model", "b") if getattr(section, name)]
    if len(ways) != 1:
        raise InputError(
            f"expected one of files, model and b with a; found {' and '.join(ways) or 'none of them'}", "plant"
        )
    try:
        if ways == ["files"]:
            return section.of_a_log(context)
        if ways == ["model"]:
            return section.of_a_model(context)
        return lag_robot(section.b, section.a, section.delay_samples or 0, section.sample_time_s or options.SAMPLE_TIME)
    except ArgumentError as error:
        raise InputError(error.message, f"plant.{error.argument}" if error.argument == "a" else "plant") from error
