"""Kind "delayed_feedback": largest stable gain of delayed corrections from an external sensor."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from pydantic import Field, PositiveFloat

from gtmodel import milling
from gtmodel.control import delayed
from gtmodel.control.delayed import options
from gtmodel.kinds.loop_simulation import LawSection, law_of
from gtmodel.kinds.milling import CutterKeys, Three
from gtmodel.lang import ModelError
from gtmodel.milling import Cut
from gtmodel.problem_files.base import Call, Context, FileSection, InputError
from gtmodel.problem_files.from_options import Made, made_from, options_of
from gtmodel.problem_files.keys import RobotProblem
from gtmodel.results import ArgumentError
from gtmodel.results.refusal import naming

RESULT = ["gtmodel.control.DelayedFeedbackStudy", "gtmodel.control.delayed.FeedbackMapStudy"]

Pose = Annotated[list[float], Field(min_length=2, max_length=2)]


@made_from(options.SinePath)
class SteeredPathKeys(Made):
    """The path of the synthetic runs that show the stability limit over time."""

    noise_um: float = Field(default=15.0, ge=0, description="standard deviation of the measurement")
    seed: int = Field(default=0, ge=0, description="seed of the noise")


@made_from(options.FeedbackCut, "speed")
class FeedbackCutKeys(Made):
    """A tool that cuts during the correction along an axis."""

    speed_rpm: PositiveFloat = Field(description="spindle speed, revolutions per minute")
    engagement: Made[Cut]
    cutter: CutterKeys

    def options(self) -> Any:
        """Return the options, with the spindle speed in revolutions per second."""
        return options.FeedbackCut(**self.given(), speed=self.speed_rpm / 60)


class ServoSection(FileSection):
    """A robot whose references are corrected and that follows them with its own law, see [law] and robot."""

    tool_m: Three = Field(description="tool centre point, in the robot's frame")
    directions: dict[str, Three] = Field(min_length=1, description="unit vectors of the corrections, by name")
    gain_step: PositiveFloat = Field(default=0.1, description="step between gains that can be set")


class PlantRow(FileSection):
    """Equivalent oscillators in one pose, fitted to the vibration after a command."""

    joints_deg: Pose = Field(description="joints 2 and 3")
    m: dict[str, PositiveFloat] = Field(description="equivalent mass by direction, dimensionless")
    c: dict[str, PositiveFloat] = Field(description="equivalent damping [1/s] by direction")
    k: dict[str, PositiveFloat] = Field(description="equivalent stiffness [1/s2] by direction")


@made_from(options.GainMap)
class JointMapKeys(Made):
    """Gain limits over joints 2 and 3, from the plants in several poses."""

    poses_deg: list[Pose] = Field(default=[], description="joints 2 and 3 of the synthetic experiments")
    table_deg: list[Pose] = Field(default=[], description="joints 2 and 3 of the poses of the table")
    gain_step: dict[str, PositiveFloat] = Field(min_length=1, description="step between gains, by direction")
    plant: list[PlantRow] = Field(default=[], description="measured plants, one table for each pose")
    synthetic: Made[options.SyntheticCommands] | None = Field(
        default=None, description="synthetic vibrations, instead of measured plants"
    )


class Schema(RobotProblem):
    """Largest stable gain of delayed corrections. Give one of [axes], [servo] and [map] as the plant."""

    robot: str | None = Field(default=None, description="for [servo]: catalogue name, file, or model in Python")  # type: ignore[assignment]
    timing: Made[options.FeedbackTiming] = Made[options.FeedbackTiming].left_out()
    axes: dict[str, Made[options.FeedbackAxis]] = Field(default={}, description="vibrating directions, by name")
    servo: ServoSection | None = Field(default=None, description="a robot, with any model, under its own law")
    law: LawSection | None = Field(default=None, description="control law of the robot's servo")
    map: JointMapKeys | None = Field(default=None, description="gain limits over two joints")
    box: Made[options.FeedbackBox] = Made[options.FeedbackBox].left_out()
    margins: Made[options.GainMargins] = Made[options.GainMargins].left_out()
    off_axis: list[Made[options.OffAxisRun]] = Field(default=[], description="directions between the axes x and y")
    path: SteeredPathKeys | None = Field(default=None, description="synthetic runs along a path")
    cut: FeedbackCutKeys | None = Field(default=None, description="chatter during the correction")


ARGUMENTS = {"plants": "axes", "measured": "map", "joints": "map.poses_deg", "asked": "map.table_deg",
             "gain_steps": "map.gain_step", "synthetic": "map.synthetic"}  # fmt: skip
OF_LOOPS = ("box", "off_axis", "path", "cut")
OF_A_SERVO = ("robot", "law", "inertia", "payload_kg", "parameters", "friction")


def call(problem: Schema, context: Context) -> Call:
    """Return the call of the study of the axes, the robot or the map in the file."""
    if context.start is not None:
        raise InputError("--start: this kind does not use an earlier result; leave it out")
    tables = [name for name in ("axes", "servo", "map") if getattr(problem, name)]
    if len(tables) != 1:
        raise InputError(f"expected one of [axes], [servo] and [map]; found {' and '.join(tables) or 'none'}", "axes")
    if problem.servo is None:
        _refuse(problem, OF_A_SERVO, "servo")
    if problem.map is not None:
        _refuse(problem, OF_LOOPS, "axes")
        return _map(problem)
    timing, box, margins, off_axis, path = options_of(problem, "timing", "box", "margins", "off_axis", "path").values()
    keywords: dict[str, Any] = {
        "box": box, "margins": margins, "off_axis": off_axis, "path": path, "title": problem.title,
    }  # fmt: skip
    if problem.path is not None:
        keywords |= {"noise": 1e-6 * problem.path.noise_um, "seed": problem.path.seed}
    if problem.cut is not None:
        with naming("cut."):
            parts = options_of(problem.cut, "cutter", "engagement")
        keywords["cut"] = milling.CorrectedCut(options_of(problem, "cut")["cut"], parts["cutter"], parts["engagement"])
    if problem.servo is not None:
        return Call(
            delayed.delayed_feedback, _servo(problem, context), timing, gain_step=problem.servo.gain_step, **keywords
        )
    return Call(delayed.delayed_feedback, options_of(problem, "axes")["axes"], timing, **keywords)


def explain(problem: Schema, context: Context) -> str:
    """Describe the timing and the plant."""
    t = problem.timing.options()
    lines = [f"{problem.heading}: a correction every {1e3 * t.cycle:g} ms, delayed by {1e3 * t.delay:g} ms"]
    lines.append(f"  corrections {'accumulate' if t.accumulate else 'do not accumulate: only their vibration remains'}")
    for name, axis in problem.axes.items():
        a = axis.options()
        gain = f"equivalent mass {a.mass:g}" if a.mass is not None else f"unstable above a gain of {a.limit:g}"
        lines.append(f"  {name}: {a.frequency:g} Hz, damping ratio {a.damping_ratio:g}, {gain}")
    if problem.servo is not None:
        law = problem.law.name if problem.law else "no law"
        lines.append(f"  {problem.robot} under {law}, corrected along {', '.join(problem.servo.directions)}")
    if problem.map is not None:
        source = f"{len(problem.map.plant)} measured poses" if problem.map.plant else "synthetic vibrations"
        lines.append(f"  map over joints 2 and 3 from {source}; table of {len(problem.map.table_deg)} poses")
    return "\n".join(lines)


def _refuse(problem: Schema, names: tuple[str, ...], place: str) -> None:
    for name in names:
        if name in problem.model_fields_set:
            raise InputError(f"belongs to [{place}], which is missing; leave it out", name)


def _servo(problem: Schema, context: Context) -> dict[str, delayed.CorrectedPlant]:
    assert problem.servo is not None
    if problem.robot is None:
        raise InputError("is missing; name the robot of [servo]", "robot")
    if problem.law is None:
        raise InputError("is missing; [servo] needs the control law of the robot", "law")
    robot = problem.model(context)
    law = law_of(problem.law, robot)
    pose = {"T": problem.servo.tool_m, "der(T)": 0.0}
    plants = {}
    for name, direction in problem.servo.directions.items():
        try:
            plants[name] = delayed.servo_plant(robot, law, pose, direction)
        except ArgumentError as error:
            key = f"servo.directions.{name}" if error.argument == "direction" else "law"
            raise InputError(error.message, key) from error
        except ModelError as error:
            raise InputError(str(error), "servo.tool_m") from error
    return plants


def _map(problem: Schema) -> Call:
    section = problem.map
    assert section is not None
    if (not section.plant) == (section.synthetic is None):
        present = "both" if section.plant else "neither"
        raise InputError(f"expected one of [[map.plant]] and [map.synthetic]; found {present}", "map.plant")
    rad = [np.deg2rad(rows).tolist() for rows in (section.poses_deg, section.table_deg)]
    if section.synthetic is not None:
        measured: Any = options_of(section, "synthetic")["synthetic"]
    else:
        if section.poses_deg:
            raise InputError("belongs to [map.synthetic]; measured plants have their own poses", "map.poses_deg")
        measured = _measured(section)
    return Call(
        delayed.feedback_map, measured, *rad, problem.timing.options(), gain_steps=dict(section.gain_step),
        options=section.options(), margins=problem.margins.options(), title=problem.title,
    )  # fmt: skip


def _measured(section: JointMapKeys) -> delayed.MeasuredPlants:
    directions = tuple(section.gain_step)
    for n, row in enumerate(section.plant):
        for name in ("m", "c", "k"):
            if set(getattr(row, name)) != set(directions):
                present = ", ".join(getattr(row, name))
                raise InputError(
                    f"has {present}; expected {', '.join(directions)}, as in gain_step", f"map.plant[{n}].{name}"
                )
    m, c, k = (np.array([[getattr(row, q)[d] for d in directions] for row in section.plant]) for q in ("m", "c", "k"))
    joints = np.deg2rad([row.joints_deg for row in section.plant])
    return delayed.MeasuredPlants(joints, m, c, k, directions)
