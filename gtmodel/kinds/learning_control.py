"""Kind "learning_control": iterative learning control, on a synthetic robot or for a measured run."""

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

EVEN = 0.01  # largest deviation of a time step, relative to the sampling period
RESULT = ("gtmodel.control.learning.LearningStudy", "gtmodel.control.learning.NextInputStudy")


class RunSignals(FileSection):
    """Columns of a run, one for each axis."""

    reference: RecordedSignalSection = Field(description="reference of the robot, without the learned input")
    input: RecordedSignalSection | None = Field(
        default=None, description="input added to the reference; zero if left out"
    )
    motor: RecordedSignalSection | None = Field(
        default=None, description="motor positions through the forward kinematics; for cases 1, 2A and 2B"
    )
    acceleration: RecordedSignalSection | None = Field(
        default=None, description="acceleration of the tool; for cases 2A and 2B"
    )
    tool: RecordedSignalSection | None = Field(default=None, description="measured tool position; for case 3")


class RunSection(RecordingFiles):
    """One measured run, at the robot's sampling period."""

    signals: RunSignals
    repeats: list[str] = Field(default=[], description="files of runs with identical inputs")
    ramp_samples: int = Field(default=references.RAMP, ge=1, description="length of lead-in and of lead-out")
    acceleration_noise_m_s2: float = Field(
        default=0.07, gt=0, description="standard deviation of an accelerometer reading"
    )
    synthetic: str = Field(default="", description="origin of the run, if it was simulated")


class LearnedPlantSection(RecordingFiles):
    """The robot's axes: from a log (files, signals), from a model in Python, or b q^-delay / (1 - a q^-1)."""

    signals: RunSignals | None = Field(
        default=None, description="signals of the log; the reference must excite the axes, for example at random"
    )
    order: int | None = Field(
        default=None, ge=1, description="states of an axis without the delay; from held-out samples if left out"
    )
    model: str | None = Field(default=None, description="model in Python, file.py:Class")
    parameters: dict[str, Any] = Field(default={}, description="values of the model's parameters by name, in SI")
    reference: list[str] = Field(default=[], description="inputs of the model, one for each axis")
    motor: list[str] = Field(default=[], description="motor variables of the model, one for each axis")
    tool: list[str] = Field(default=[], description="tool variables, for cases 2A, 2B and 3")
    acceleration: list[str] = Field(default=[], description="tool accelerations, for cases 2A and 2B")
    b: list[float] = Field(default=[], description="b of (6.11), one for each axis")
    a: list[float] = Field(default=[], description="a of (6.11), one for each axis")
    delay_samples: int | None = Field(
        default=None, ge=0, description="delay of the response to a reference; estimated from a log if left out"
    )
    synthetic: str = Field(default="", description="origin of the log, if it was simulated")

    def of_a_log(self, context: Context) -> ModelledRobot:
        """Return the axes identified from the log. Raises InputError."""
        import numpy as np  # here, as below: the keys alone do not need it

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
        """Return the axes of the model, linearised at its start. Raises InputError."""
        from gtmodel.problem_files import python_models

        assert self.model is not None
        model = python_models.resolve(self.model, context, "plant.model", self.parameters)
        outputs = {"motor": self.motor, "tool": self.tool, "acceleration": self.acceleration}
        for name, variables in {"reference": self.reference, **outputs}.items():
            if (len(variables) != len(self.reference) and (variables or name == "motor")) or not self.reference:
                raise InputError(
                    f"names {len(variables)} variables; expected one for each axis, as in reference",
                    f"plant.{name}",
                )
        period, axes = self.sample_time_s or options.SAMPLE_TIME, []
        for k, reference in enumerate(self.reference):
            signals = {name: variables[k] for name, variables in outputs.items() if variables}
            try:
                axes.append(learning.linear_axis(model, reference, signals, period, self.delay_samples or 0))
            except ModelError as error:
                raise InputError(str(error), "plant.model") from error
        return learning.ModelledRobot(axes)


@made_from(options.ElasticTip)
class SimulatedSection(Made):
    """A Gantry-Tau of the catalogue with a tool on a spring, simulated with its controller."""

    robot: str = Field(default="l1_tape", description="a Gantry-Tau of the catalogue")
    inertia: str = Field(default="model_2", description="masses and friction of the robot")


class Schema(Problem):
    """Iterative learning control: predicted rate and floor, and simulated runs to compare with. With [log]: the input
    of the next run from one measured run."""

    robot: Made[options.LearningRobot] = Made[options.LearningRobot].left_out()
    plant: LearnedPlantSection | None = Field(
        default=None, description="the robot's axes from a log, a model or given numbers, instead of [robot]"
    )
    learning: Made[options.LearningDesign] = Made[options.LearningDesign].left_out()
    reference: Made[references.SquarePath] = Made[references.SquarePath].left_out()
    noise: Made[options.LearningNoise] = Made[options.LearningNoise].left_out()
    simulated: SimulatedSection | None = Field(
        default=None, description="a simulated robot; [robot] is the model that the law uses"
    )
    log: RunSection | None = Field(default=None, description="a measured run, instead of [reference] and [noise]")


def recorded(
    log: RecordingFiles, signals: RunSignals, files: Sequence[str], key: str, context: Context, synthetic: str
) -> Trajectory:
    """Return the signals of a recording with a single clock. Raises InputError."""
    sections = {name: getattr(signals, name) for name in type(signals).model_fields}
    columns = {name: section for name, section in sections.items() if section is not None}
    recording = log.model_copy(update={"files": list(files)}).recording(columns, context, key)
    by_name = {name: t for t in recording.values() for name in t.names}
    clock = by_name["reference"]
    if any(t is not clock for t in by_name.values()):
        raise InputError("has signals with different clocks; resample them first (kind resampling)", key)
    return Trajectory(
        clock.time, {name: clock[name] for name in columns}, {name: clock.unit(name) for name in columns},
        synthetic=synthetic or clock.synthetic,
    )  # fmt: skip


ARGUMENTS = {
    "design": "learning", "path": "reference", "run": "log", "law": "learning", "cutoff": "learning.cutoff",
    "ramp": "log.ramp_samples", "repeats": "log.repeats",
    "length": "learning.lags", "shift": "learning.shift", "side_time": "reference.side_time",
}  # fmt: skip


def call(problem: Schema, context: Context) -> Call:
    """Return the call of the study of a synthetic robot or of one measured run."""
    if context.start is not None:
        raise InputError("--start: learning starts from an input in the log; leave it out")
    design, path, noise = options_of(problem, "learning", "reference", "noise").values()
    robot = robot_of(problem, context)
    if problem.simulated is not None:
        if problem.log is not None:
            raise InputError("is a robot instead of a measured run; leave one of the two out", "simulated")
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
            raise InputError("belongs to a synthetic robot; leave it out with [log]", name)
    log = problem.log
    run = _run(log, log.files, context)
    repeats = [_run(log, [name], context) for name in log.repeats]
    if 0 < len(repeats) < 3:
        raise InputError(f"names {len(repeats)} runs; their scatter needs at least three", "log.repeats")
    return Call(
        learning.next_input, robot, run, design, repeats=repeats, ramp=log.ramp_samples,
        acceleration_noise=log.acceleration_noise_m_s2, title=problem.title,
    )  # fmt: skip


def explain(problem: Schema, context: Context) -> str:
    """Describe the robot, the law and the data to learn from."""
    design, path, noise = options_of(problem, "learning", "reference", "noise").values()
    robot = robot_of(problem, context)
    lines = [f"{problem.heading}: case {design.case}, law {design.law}, axes {', '.join(robot.axes)}"]
    if isinstance(robot, learning.ModelledRobot):
        for k, name in enumerate(robot.axes):
            mode = robot.mode(k)
            text = "no light mode" if mode is None else f"lightest mode {mode[0]:.3g} Hz (damping {mode[1]:.2g})"
            lines.append(f"  {name}: {', '.join(robot.plants[k].signals)}; {text}")
    elif robot.loop == "lag":
        tools = ", ".join(f"{f:g} Hz (damping {z:g})" for f, z in zip(robot.frequency, robot.damping, strict=True))
        lines.append(f"  motor loop: lag of {1e3 * robot.lag:g} ms after {robot.delay} samples; tool: {tools}")
    lines.append(f"  Q: low pass at {design.low_pass:g} Hz, for {len(design.models(robot, 0))} models per axis")
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
    """Return the robot in [robot] or [plant]. Raises InputError."""
    section = problem.plant
    if section is None:
        return options_of(problem, "robot")["robot"]
    if "robot" in problem.model_fields_set:
        raise InputError("defines the robot already; leave [robot] out", "plant")
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
