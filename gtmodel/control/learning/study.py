"""The learning study: rate and floor before the first iteration, the runs beside them, what a wrong model costs, and
what it all says in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, Unpack

import numpy as np

from ...results import ArgumentError, Check, Quantity, Row, SolveStatus, Study, Trajectory, Work, at_most
from ...results.disk import MadeFiles
from ...results.refusal import naming
from ...results.work import WorkOptions, study_function
from .axis import tool_model
from .course import Floor, RepeatedMotion, SyntheticExperiment, above_cutoff
from .design import AxisLearning, design_axis
from .estimators import ToolEstimate, complementary_estimate, kalman_estimate, kinematic
from .kalman import most_likely_filter
from .law import RAMP
from .lifted import Array
from .measured_runs import check_judged
from .options import LearningDesign, LearningNoise, LearningRobot, LearningStudy
from .plants import SAMPLE_TIME
from .references import SquarePath
from .robot import ModelledRobot

SLOWLY = 1.5  # times the floor: beyond, more runs would help
SHARE = 0.05  # of the energy on either side of the band in which a signal lies
SLOWEST = 0.5  # Hz: what lies below is no matter of a Q that is 1 at rest
PASSES = 0.995  # of |Q|: where it lets this much through, Q is not why an error stays
APART = 0.01  # of sigma above the bound over frequency: the run's ends are then what is slow


def sentence(
    axes: Sequence[AxisLearning], floors: Sequence[Floor], design: LearningDesign, names: Sequence[str],
    corrected: slice,
) -> str:  # fmt: skip
    """Rate and floor in words, of the slowest axis and of the one of which most stays."""
    slow = max(axes, key=lambda a: a.bound.value)
    k = int(np.argmax([f.share for f in floors]))
    monotone = all(a.rate.monotone for a in axes)
    sigma = max(a.rate.sigma for a in axes)
    rate = f"{slow.bound.value:.2f} per iteration at {slow.bound.frequency:.0f} Hz"
    if monotone and sigma > slow.bound.value + APART:
        rate = f"{sigma:.2f} per iteration"
    return (
        f"{'converges' if monotone else 'converges in the end'}, rate {rate}; {100 * floors[k].share:.2g} % of the "
        f"error of {names[k]} cannot be learned: {why(axes[k], floors[k], design, corrected)}"
    )


def why(axis: AxisLearning, left: Floor, design: LearningDesign, corrected: slice) -> str:
    """What keeps the error that is not learned."""
    if left.clipped:
        return "the bounds on the input keep it"
    if design.law == "norm_optimal":
        return "the weight of the effort keeps it"
    low, high = band(left.rest[corrected], axis.sample_time)
    energy = np.abs(np.fft.rfft(left.rest[corrected])) ** 2
    f = np.fft.rfftfreq(len(left.rest[corrected]), axis.sample_time)
    passed = np.interp(f, axis.frequency, np.abs(axis.response))
    if low < SLOWEST or (energy.sum() > 0 and float(energy @ passed / energy.sum()) > PASSES):
        return "it belongs to the lead-in and the lead-out, where the windows hold the input back"
    if design.case == "1":
        return f"the reference holds it above {low:.2g} Hz, where Q with its low pass at {design.low_pass:g} Hz falls"
    return f"it lies between {low:.2g} and {high:.2g} Hz, where Q lets less than all of it through"


def band(signal: Array, sample_time: float) -> tuple[float, float]:
    """Frequencies [Hz] between which nine tenths of the energy of a signal (N,) lie."""
    energy = np.abs(np.fft.rfft(signal)) ** 2
    f = np.fft.rfftfreq(len(signal), sample_time)
    below = np.cumsum(energy)
    if not below[-1] > 0:
        return 0.0, float(f[-1])
    low, high = np.searchsorted(below / below[-1], [SHARE, 1 - SHARE])
    return float(f[low]), float(f[min(high, len(f) - 1)])


def notes(
    design: LearningDesign, axes: Sequence[AxisLearning], floors: Sequence[Floor], errors: Array, names: Sequence[str]
) -> tuple[str, ...]:
    """Of errors (runs, axes): what is slow, what scatters, what an estimate hides."""
    made = []
    for name, axis, left, course in zip(names, axes, floors, errors.T, strict=True):
        if not axis.rate.monotone:
            made.append(f"{name}: {axis.rate.words}")
        if len(course) and 0 < SLOWLY * left.total < course[-1]:
            runs = int(np.ceil(np.log(left.total / course[-1]) / np.log(min(axis.bound.value, 0.999))))
            made.append(
                f"{name}: after {len(course) - 1} iterations {100 * course[-1] / course[0]:.2g} % of the error is left "
                f"where {100 * left.total / left.before:.2g} % would be possible: at {axis.bound.value:.2f} per "
                f"iteration near {axis.bound.frequency:.3g} Hz that takes some {runs} more, for there the loop passes "
                "too little of the input"
            )
        if left.scatter > left.repeating:
            made.append(f"{name}: most of the floor is what differs from run to run; more iterations do not help")
    if design.case in ("2A", "2B"):
        made.append("what the estimate gets wrong is learned into the tool: its error may stay above that shown")
    return tuple(made)


def micrometres(value: float) -> str:
    """A length [m] as people read it: four digits, no powers of ten."""
    um = 1e6 * value
    return f"{um:.0f} um" if um >= 1000 else f"{um:.3g} um"


OFF = (-0.2, -0.1, -0.06, -0.03, -0.01, 0.0, 0.01, 0.03, 0.06, 0.1, 0.2)  # of the tool's frequency
SLOW_CUTOFF = 2.63  # Hz, Dressler 2012, (7.18)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class MismatchStudy(Study):
    """Errors of estimates of the tool, root mean squares over the fully corrected samples of one run."""

    off: Annotated[Sequence[float], "share by which the model's frequency differs from the tool's"] = ()
    kalman: Annotated[Sequence[float], Quantity("m", "error of the Kalman filter at each of these", written="um")] = ()
    normalised: Annotated[Sequence[float], "mean square of its innovations over what it expects, 1 where right"] = ()
    kinematics: Annotated[float, Quantity("m", "error of the motors alone", written="um")] = 0.0
    complementary: Annotated[float, Quantity("m", "error of the complementary filter", written="um")] = 0.0

    @property
    def rows(self) -> list[Row]:
        """The table for people."""
        rows = [Row("motors alone", f"{1e6 * self.kinematics:.4g}", "um")]
        rows.append(Row("complementary filter", f"{1e6 * self.complementary:.4g}", "um"))
        return rows + [
            Row(f"Kalman filter, model {100 * d:+.0f} %", f"{1e6 * e:.4g}", "um")
            for d, e in zip(self.off, self.kalman, strict=True)
        ]


@study_function
def mismatch(
    run: Mapping[str, Any], frequency: float, damping: float, *, off: Sequence[float] = OFF, noise: float = 0.07,
    cutoff: float = SLOW_CUTOFF, ramp: int = RAMP, sample_time: float = SAMPLE_TIME,
    **work_options: Unpack[WorkOptions],
) -> MismatchStudy:  # fmt: skip
    """How much an estimate of the tool errs, against how far the frequency of its model is off.

    Args:
        run: "motor" [m], "acceleration" [m/s2] and the true "tool" [m], each (N,), from rest; such as a synthetic one.
        frequency, damping: of the tool [Hz] and [1]. off: shares of the frequency. noise: of the accelerometer [m/s2].
        cutoff: of the complementary filter [Hz]. ramp: samples at either end that do not count.
        title, progress, max_seconds, stop: see `gtmodel.results.Work`.

    At each the filter's process noise is what makes its innovations most likely, without a look at the tool. Raises
    ArgumentError where signals are missing or of other lengths, and for numbers out of range.

    >>> learning = gt.control.learning
    >>> r = learning.SquarePath().samples(0.004)[:, 1]
    >>> run = {name: T(r) for name, T in learning.flexible_axis(11.5, 0.05).maps(825).items()}
    >>> run["acceleration"] = run["acceleration"] + 0.07 * np.random.default_rng(1).normal(size=825)
    >>> s = learning.mismatch(run, 11.5, 0.05, off=(0.0, 0.1))
    >>> s.kalman[0] < s.kalman[1] < s.complementary < s.kinematics
    True
    """
    work = Work(**work_options)
    missing = [name for name in ("motor", "acceleration", "tool") if name not in run]
    if missing:
        raise ArgumentError(f"has no {', '.join(missing)}; the errors are those of all three", "run")
    signals = {name: np.asarray(run[name], float) for name in ("motor", "acceleration", "tool")}
    size = len(signals["motor"])
    if any(x.shape != (size,) or not np.all(np.isfinite(x)) for x in signals.values()):
        raise ArgumentError("expected signals of one length, all of them finite", "run")
    check_judged(size, ramp, "run")
    if any(not d > -1 for d in off) or not len(off):
        raise ArgumentError("expected one share or more above -1", "off")
    corrected = slice(ramp, size - ramp)

    def error(estimate: ToolEstimate) -> float:
        return float(np.sqrt(np.mean((estimate(signals) - signals["tool"])[corrected] ** 2)))

    kalman, normalised = [], []
    for n, share in enumerate(off):
        work.step("noise of each model", n / len(off))
        model = tool_model(frequency * (1 + share), damping, sample_time)
        filter = most_likely_filter(model, signals["motor"], signals["acceleration"], noise)
        kalman.append(error(kalman_estimate(size, filter)))
        normalised.append(float(np.mean(filter.innovations(signals["motor"], signals["acceleration"]) ** 2)))
    alone = error(kinematic(size))
    both = error(complementary_estimate(size, cutoff, sample_time))
    best = int(np.argmin(kalman))
    shown = work.title or "error of the estimate against mismatch of the model"
    return MismatchStudy(
        status=SolveStatus.SOLVED, title=shown,
        message=f"the Kalman filter errs by {micrometres(kalman[best])} where its model is off by "
        f"{100 * off[best]:+.0f} %, and by {micrometres(max(kalman))} at worst; the motors "
        f"alone by {micrometres(alone)}",
        figures={"mismatch": partial(_mismatch, np.array(off), np.array(kalman), alone, both, shown)},
        off=list(off), kalman=kalman, normalised=normalised, kinematics=alone, complementary=both,
    )  # fmt: skip


def _mismatch(off: Array, kalman: Array, alone: float, both: float, title: str) -> Any:
    from ...plot.learning import mismatch_figure

    return mismatch_figure(off, kalman, alone, both, title=title)


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
    **work_options: Unpack[WorkOptions],
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
    work = Work(**work_options)
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
    work.keep(partial(_designed, design, runs.names, axes, work.title))
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
        runs, design, axes, floors, firsts, inputs, np.array(errors), np.array(tools), repeats[0], run, hats, work.title
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
