"""The learning study: rate and floor before the first iteration, then the runs beside them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from ...results import ArgumentError, Check, SolveStatus, Trajectory, Work, at_most
from ...results.door import study_function
from ...results.made_files import MadeFiles
from ...results.refusal import naming
from ...results.work import Progress, never, silent
from .course import Floor, above_cutoff
from .designed import AxisLearning, design_axis
from .experiment import RepeatedMotion, SyntheticExperiment
from .lifted import Array
from .modelled import ModelledRobot
from .options import LearningDesign, LearningNoise, LearningRobot
from .references import SquarePath
from .result import LearningStudy
from .words import notes, sentence

LAST = 5  # runs of the mean of Table 7.2, k = 5 .. 10
REACHED = 1.5  # times the predicted course: beyond, the model is another robot's
CASE_1, SQUARE = LearningDesign(), SquarePath()


@study_function
def study(
    robot: LearningRobot | ModelledRobot,
    path: SquarePath = SQUARE,
    design: LearningDesign = CASE_1,
    noise: LearningNoise | None = None,
    *,
    experiment: Any = None,
    title: str = "",
    progress: Progress = silent,
    max_seconds: float | None = None,
    stop: Callable[[], bool] = never,
) -> LearningStudy:
    """Iterative learning control on a robot that repeats a motion: Dressler 2012, chapter 7.

    Args:
        robot: as the law knows it. path: the square that is learned. design: the law. noise: how runs differ.
        experiment: what runs, a `RepeatedMotion` with the axes of `robot`; `SyntheticExperiment` of these if left out.
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    First come identical runs without input, whose mean and scatter give floor and course of what follows. Raises
    ArgumentError for a law that would diverge on one of its models, before anything is learned.

    >>> learning = gt.control.learning
    >>> s = learning.study(learning.LearningRobot(), design=learning.LearningDesign(case="3", iterations=6))
    >>> s.status.ok, bool(max(s.bound) < 1), bool(max(s.tool_share) < 0.05)
    (True, True, True)
    """
    work = Work(progress=progress, max_seconds=max_seconds, stop=stop)
    noise = noise or LearningNoise()
    with naming("path"):
        runs = experiment or SyntheticExperiment(robot, path, noise)
    if tuple(runs.names) != tuple(robot.axes):
        raise ArgumentError(f"its axes are {', '.join(runs.names)}; of the robot {', '.join(robot.axes)}", "experiment")
    size, reference, corrected = len(runs.reference), runs.reference, runs.corrected
    repeats = list[dict[str, Array]]()
    for n in range(noise.repeats):
        work.step("identical runs", n / noise.repeats)
        repeats.append(runs.run(np.zeros_like(reference)))
    axes: list[AxisLearning] = []
    work.keep(partial(_designed, design, runs.names, axes, title))
    for k, name in enumerate(runs.names):
        work.step(f"law of {name}")
        first = [{signal: values[:, k] for signal, values in run.items()} for run in repeats]
        axes.append(design_axis(robot, k, design, size, corrected.start, first, noise.acceleration))
    floors, firsts = [], []
    for k, axis in enumerate(axes):
        seen = np.array([axis.estimate({s: v[:, k] for s, v in run.items()}) for run in repeats])
        firsts.append(reference[:, k] - seen.mean(axis=0))
        floors.append(axis.floor(firsts[-1], corrected, design.iterations, seen))
    work.step("learning")
    u = np.zeros_like(reference)
    inputs, errors, tools, run, hats = [], [], [], repeats[0], np.zeros_like(reference)
    for n in range(design.iterations + 1):
        if n and work.interrupted():
            break
        work.progress("learning", n / (design.iterations + 1), {})
        run = runs.run(u) if n else repeats[0]
        hats = np.column_stack([a.estimate({s: v[:, k] for s, v in run.items()}) for k, a in enumerate(axes)])
        e = reference - hats
        inputs.append(u)
        errors.append(_rms(e[corrected]))
        truth = _tool(run)
        if truth is not None:
            tools.append(_rms((reference - truth)[corrected]))
        u = np.column_stack([a.next_input(u[:, k], e[:, k]) for k, a in enumerate(axes)])
    return _answer(
        runs, design, axes, floors, firsts, inputs, np.array(errors), np.array(tools), repeats[0], run, hats, title
    )


def _designed(design: LearningDesign, names: Sequence[str], axes: Sequence[AxisLearning], title: str) -> LearningStudy:
    """The laws that are designed when a study is ended before it learned."""
    return LearningStudy(
        status=SolveStatus.INTERRUPTED, title=title or "learning control", case=design.case,
        axes=tuple(names[: len(axes)]), shift=[a.shift for a in axes], sigma=[a.rate.sigma for a in axes],
        bound=[a.bound.value for a in axes], bound_frequency=[a.bound.frequency for a in axes],
    )  # fmt: skip


def _answer(
    runs: RepeatedMotion, design: LearningDesign, axes: Sequence[AxisLearning], floors: Sequence[Floor],
    firsts: Sequence[Array], inputs: Sequence[Array], errors: Array, tools: Array, before: dict[str, Array],
    run: dict[str, Array], hats: Array,
    title: str,
) -> LearningStudy:  # fmt: skip
    names, done = tuple(runs.names), len(errors)
    complete = done == design.iterations + 1
    reached = np.sqrt(np.mean(errors[min(LAST, done - 1) :] ** 2, axis=0))
    over = [
        _over(float(reached[k]), float(np.sqrt(np.mean(f.course[min(LAST, done - 1) : done] ** 2))))
        for k, f in enumerate(floors)
    ]
    checks = {"bound": at_most(max(a.bound.value for a in axes), 1.0 + 1e-9, "lower the cutoff or the contraction")}
    if complete:
        checks["reached_over_predicted"] = Check(
            max(over), REACHED, "the runs err more than the model says; identify the model anew, or widen its set"
        )
    largest = np.max(np.abs(inputs[-1]), axis=0)
    time = runs.sample_time * np.arange(len(runs.reference))
    trajectory = Trajectory(
        time, {"reference": runs.reference, "input": inputs[-1], "estimate": hats},
        {"reference": "m", "input": "m", "estimate": "m"}, synthetic=runs.synthetic or None,
    )  # fmt: skip
    shown = title or "learning control"
    if runs.synthetic and "synthetic" not in shown.lower():
        shown = f"{shown} (synthetic)"
    courses = np.array([f.course for f in floors])
    tool = _tool(run)
    figures: dict[str, Any] = {"errors": partial(
        _errors, names, errors.T, courses, [f.total for f in floors], [a.rate.sigma for a in axes],
        tools.T if len(tools) else None, shown,
    ), "filter": partial(filter_picture, names, axes, shown)}  # fmt: skip
    if tool is not None and (first := _tool(before)) is not None and len(names) == 2:
        figures["path"] = partial(_path, runs.reference, tool, first, runs.corrected, shown)
    return LearningStudy(
        status=SolveStatus.SOLVED if complete else SolveStatus.INTERRUPTED,
        message=sentence(axes, floors, design, names, runs.corrected) if complete else "",
        title=title or "learning control", notes=notes(design, axes, floors, errors, names), checks=checks,
        trajectory=trajectory, figures=figures,
        files=MadeFiles({"learned_input.csv": partial(_input, time, names, inputs, runs.synthetic)}),
        machine_files=("learned_input.csv",), case=design.case, axes=names, shift=[a.shift for a in axes],
        sigma=[a.rate.sigma for a in axes], bound=[a.bound.value for a in axes],
        bound_frequency=[a.bound.frequency for a in axes], first_error=[f.before for f in floors],
        floor=[f.total for f in floors], factor=[_over(f.before, f.total) for f in floors],
        not_learned=[f.share for f in floors], scatter=[f.scatter for f in floors],
        reached=reached.tolist(), error=errors.T.tolist(), predicted=courses.tolist(),
        tool_error=tools.T.tolist() if len(tools) else None,
        tool_share=[
            _over(float(a), float(b))
            for a, b in zip(np.mean(tools[min(LAST, done - 1):], axis=0), tools[0], strict=True)
        ] if len(tools) else None,
        reference_above=[above_cutoff(e[runs.corrected], design.low_pass, runs.sample_time) for e in firsts],
        largest_input=largest.tolist(), synthetic=runs.synthetic or None,
    )  # fmt: skip


def _over(value: float, of: float) -> float:
    """A quotient, 0 of nothing by nothing."""
    return value / of if of else (0.0 if not value else np.inf)


def _rms(values: Array) -> Array:
    return np.sqrt(np.mean(np.square(values), axis=0))


def _input(time: Array, names: Sequence[str], inputs: Sequence[Array], synthetic: str) -> str:
    return input_csv(time, names, inputs[-1], synthetic)


def input_csv(time: Array, names: Sequence[str], u: Array, synthetic: str | None) -> str:
    """An input (N, axes) as a table for the loop's replay law and for the next iteration: all digits."""
    lines = [f"# synthetic: {synthetic}"] if synthetic else []
    lines.append(",".join(["time [s]", *(f"input_{name.replace(' ', '_')} [m]" for name in names)]))
    lines += [",".join([f"{t:.9g}", *(repr(float(x) + 0.0) for x in row)]) for t, row in zip(time, u, strict=True)]
    return "\n".join(lines) + "\n"


def _errors(*arguments: Any) -> Any:
    from ...plot.learning import course_figure

    return course_figure(*arguments)


def filter_picture(names: Sequence[str], axes: Sequence[AxisLearning], title: str) -> Any:
    """|1 - L T| against 1/|Q| of each axis."""
    from ...plot.learning import filter_figure

    return filter_figure(names, [(a.frequency, a.response, a.rest) for a in axes], title=title)


def _tool(run: dict[str, Array]) -> Array | None:
    return run.get("true tool", run.get("tool"))


def _path(reference: Array, tool: Array, before: Array, corrected: slice, title: str) -> Any:
    from ...plot.learning import tool_path_figure

    return tool_path_figure(reference[corrected], tool[corrected], before=before[corrected], title=title)
