"""Kind "learning_control": a law that learns from run to run, on a synthetic robot or for a measured run."""

from __future__ import annotations

from gtmodel.control.learning import SimulatedMotion, next_input, study
from gtmodel.lang import ModelError
from gtmodel.problem_files.base import Context, InputError
from gtmodel.problem_files.call import Call
from gtmodel.problem_files.from_options import options_of
from gtmodel.results import Trajectory
from gtmodel.robots import gantry_tau

from .keys import RunSection, Schema

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
    robot, design, path, noise = options_of(problem, "robot", "learning", "reference", "noise").values()
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
    run = _run(log, log.files, "log.files", context)
    repeats = [_run(log, [name], f"log.repeats[{k}]", context) for k, name in enumerate(log.repeats)]
    if 0 < len(repeats) < 3:
        raise InputError(f"names {len(repeats)} runs; their scatter wants three or more", "log.repeats")
    return Call(
        next_input, robot, run, design, repeats=repeats, ramp=log.ramp_samples,
        acceleration_noise=log.acceleration_noise_m_s2, title=problem.title,
    )  # fmt: skip


def explain(problem: Schema, context: Context) -> str:
    """Which robot, which law, what is learned from."""
    robot, design, path, noise = options_of(problem, "robot", "learning", "reference", "noise").values()
    lines = [f"{problem.title or NAME}: case {design.case}, law {design.law}, axes {', '.join(robot.axes)}"]
    if robot.loop == "lag":
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
        run = _run(problem.log, problem.log.files, "log.files", context)
        lines.append(f"  measured run: {len(run)} rows, signals {', '.join(run.names)}")
    return "\n".join(lines)


def _run(log: RunSection, files: list[str], key: str, context: Context) -> Trajectory:
    """The signals of a run on one clock."""
    given = {name: getattr(log.signals, name) for name in type(log.signals).model_fields}
    columns = {name: section.recorded() for name, section in given.items() if section is not None}
    one = log.model_copy(update={"files": files})
    recording = one.recording(columns, context, "log")
    by_name = {name: t for t in recording.values() for name in t.names}
    clock = by_name["reference"]
    if any(t is not clock for t in by_name.values()):
        raise InputError("has signals with clocks of their own; resample them on one (kind resampling)", "log")
    return Trajectory(
        clock.time, {name: clock[name] for name in columns}, {name: clock.unit(name) for name in columns},
        synthetic=log.synthetic or clock.synthetic,
    )  # fmt: skip
