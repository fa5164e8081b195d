"""Kind "learning_control": a law that learns from run to run, on a synthetic robot or for a measured run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from pydantic import Field

from gtmodel import robots
from gtmodel.control import learning
from gtmodel.control.learning import LearningRobot, options, references
from gtmodel.lang import ModelError
from gtmodel.problem_files.base import Call, Context, FileSection, InputError, Problem
from gtmodel.problem_files.from_options import Made, made_from, options_of
from gtmodel.problem_files.keys import RecordedSignalSection, RecordingFiles
from gtmodel.results import Trajectory
from gtmodel.results.refusal import naming

if TYPE_CHECKING:
    from gtmodel.control.learning import ModelledRobot

EVEN = 0.01  # of a period
RESULT = ("gtmodel.control.learning.LearningStudy", "gtmodel.control.learning.NextInputStudy")


class RunSignals(FileSection):
    """Columns of a run, one for each axis."""

    reference: RecordedSignalSection = Field(description="what the robot is to follow, without the input")
    input: RecordedSignalSection | None = Field(default=None, description="what was added to it; zero if left out")
    motor: RecordedSignalSection | None = Field(
        default=None, description="the motors through the forward kinematics; for cases 1, 2A and 2B"
    )
    acceleration: RecordedSignalSection | None = Field(default=None, description="of the tool; for cases 2A and 2B")
    tool: RecordedSignalSection | None = Field(default=None, description="measured; for case 3")


class RunSection(RecordingFiles):
    """One measured run, at the robot's sampling."""

    signals: RunSignals
    repeats: list[str] = Field(default=[], description="files of runs that were identical to each other")
    ramp_samples: int = Field(default=references.RAMP, ge=1, description="of lead-in and of lead-out")
    acceleration_noise_m_s2: float = Field(default=0.07, gt=0, description="of a reading of the accelerometer")
    synthetic: str = Field(default="", description="what made the run, where it was simulated")


class LearnedPlantSection(RecordingFiles):
    """The robot's axes: from a log (files, signals), from a model in Python, or b q^-delay / (1 - a q^-1)."""

    signals: RunSignals | None = Field(
        default=None, description="of the log, under a reference that excites, such as a random one"
    )
    order: int | None = Field(
        default=None, ge=1, description="states of an axis, the delay not counted; by held-out samples if left out"
    )
    model: str | None = Field(default=None, description="in Python, file.py:Class")
    parameters: dict[str, Any] = Field(default={}, description="of the model, in SI")
    reference: list[str] = Field(default=[], description="the model's inputs, one for each axis")
    motor: list[str] = Field(default=[], description="its variables of the motors, one for each axis")
    tool: list[str] = Field(default=[], description="of the tool, for cases 2A, 2B and 3")
    acceleration: list[str] = Field(default=[], description="of the tool's acceleration, for cases 2A and 2B")
    b: list[float] = Field(default=[], description="one for each axis, as in (6.11)")
    a: list[float] = Field(default=[], description="one for each axis, as in (6.11)")
    delay_samples: int | None = Field(
        default=None, ge=0, description="until a reference acts; of a log where its response begins if left out"
    )
    synthetic: str = Field(default="", description="what made the log, where it was simulated")

    def of_a_log(self, context: Context) -> ModelledRobot:
        """The axes identified. Raises InputError."""
        import numpy as np  # here, as below: the keys alone need none of it

        if self.signals is None:
            raise InputError("is missing; name the columns of reference and motor", "plant.signals")
        log = recorded(self, self.signals, self.files, "plant", context, self.synthetic)
        steps = np.diff(log.time)
        period = self.sample_time_s or float(np.median(steps))
        if np.any(np.abs(steps - period) > EVEN * period):
            raise InputError(f"has rows that are not {1e3 * period:g} ms apart; resample it (kind resampling)", "plant")
        columns = {name: np.asarray(log[name], float).reshape(len(log), -1) for name in log.names}
        u = columns.pop("reference") + columns.pop("input", 0.0)
        for name, values in columns.items():
            if values.shape != u.shape:
                raise InputError(
                    f"has {values.shape[1]} columns; the reference {u.shape[1]}, one for each axis",
                    f"plant.signals.{name}",
                )
        return learning.identified_robot(u, columns, period, self.order, self.delay_samples)

    def of_a_model(self, context: Context) -> ModelledRobot:
        """The axes of the model, linear where it starts. Raises InputError."""
        from gtmodel.problem_files import python_models

        assert self.model is not None
        model = python_models.resolve(self.model, context, "plant.model", self.parameters)
        named = {"motor": self.motor, "tool": self.tool, "acceleration": self.acceleration}
        for name, variables in {"reference": self.reference, **named}.items():
            if (len(variables) != len(self.reference) and (variables or name == "motor")) or not self.reference:
                raise InputError(
                    f"names {len(variables)} variables; expected one for each axis, as reference names them",
                    f"plant.{name}",
                )
        period, made = self.sample_time_s or options.SAMPLE_TIME, []
        for k, reference in enumerate(self.reference):
            signals = {name: variables[k] for name, variables in named.items() if variables}
            try:
                made.append(learning.linear_axis(model, reference, signals, period, self.delay_samples or 0))
            except ModelError as error:
                raise InputError(str(error), "plant.model") from error
        return learning.ModelledRobot(made)


@made_from(options.ElasticTip)
class SimulatedSection(Made):
    """A Gantry-Tau of the catalogue with a tool on a spring, simulated with its controller."""

    robot: str = Field(default="l1_tape", description="a Gantry-Tau of the catalogue")
    inertia: str = Field(default="model_2", description="its masses and friction")


class Schema(Problem):
    """Iterative learning control: rate and floor before the first iteration, and the runs of a synthetic robot beside
    them. With [log]: from one measured run the input of the next one."""

    robot: Made[options.LearningRobot] = Made[options.LearningRobot].left_out()
    plant: LearnedPlantSection | None = Field(
        default=None, description="the robot's axes from a log, a model or printed numbers, in place of [robot]"
    )
    learning: Made[options.LearningDesign] = Made[options.LearningDesign].left_out()
    reference: Made[references.SquarePath] = Made[references.SquarePath].left_out()
    noise: Made[options.LearningNoise] = Made[options.LearningNoise].left_out()
    simulated: SimulatedSection | None = Field(
        default=None, description="a robot that is simulated, of which [robot] is the model that the law knows"
    )
    log: RunSection | None = Field(default=None, description="a measured run, in place of [reference] and [noise]")


def recorded(
    log: RecordingFiles, signals: RunSignals, files: Sequence[str], key: str, context: Context, synthetic: str
) -> Trajectory:
    """The signals of a recording on one clock, from these files. Raises InputError."""
    given = {name: getattr(signals, name) for name in type(signals).model_fields}
    columns = {name: section.recorded() for name, section in given.items() if section is not None}
    recording = log.model_copy(update={"files": list(files)}).recording(columns, context, key)
    by_name = {name: t for t in recording.values() for name in t.names}
    clock = by_name["reference"]
    if any(t is not clock for t in by_name.values()):
        raise InputError("has signals with clocks of their own; resample them on one (kind resampling)", key)
    return Trajectory(
        clock.time, {name: clock[name] for name in columns}, {name: clock.unit(name) for name in columns},
        synthetic=synthetic or clock.synthetic,
    )  # fmt: skip


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
            model = robots.gantry_tau(section.robot, inertia=section.inertia)
        except ModelError as error:
            raise InputError(str(error), "simulated.robot") from error
        motion = learning.SimulatedMotion(model, section.options(), path, noise, robot.sample_time)
        return Call(learning.study, robot, path, design, noise, experiment=motion, title=problem.title)
    if problem.log is None:
        return Call(learning.study, robot, path, design, noise, title=problem.title)
    for name in ("reference", "noise"):
        if name in problem.model_fields_set:
            raise InputError("belongs to a synthetic robot; with [log] leave it out", name)
    log = problem.log
    run = _run(log, log.files, context)
    repeats = [_run(log, [name], context) for name in log.repeats]
    if 0 < len(repeats) < 3:
        raise InputError(f"names {len(repeats)} runs; their scatter wants three or more", "log.repeats")
    return Call(
        learning.next_input, robot, run, design, repeats=repeats, ramp=log.ramp_samples,
        acceleration_noise=log.acceleration_noise_m_s2, title=problem.title,
    )  # fmt: skip


def explain(problem: Schema, context: Context) -> str:
    """Which robot, which law, what is learned from."""
    design, path, noise = options_of(problem, "learning", "reference", "noise").values()
    robot = robot_of(problem, context)
    lines = [f"{problem.title or NAME}: case {design.case}, law {design.law}, axes {', '.join(robot.axes)}"]
    if isinstance(robot, learning.ModelledRobot):
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


def robot_of(problem: Schema, context: Context) -> LearningRobot | learning.ModelledRobot:
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
    with naming({"a": "plant.a", "": "plant"}, refusal=InputError):
        if ways == ["files"]:
            return section.of_a_log(context)
        if ways == ["model"]:
            return section.of_a_model(context)
        return learning.lag_robot(
            section.b, section.a, section.delay_samples or 0, section.sample_time_s or options.SAMPLE_TIME
        )
