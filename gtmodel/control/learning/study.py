"""The learning study: rate and floor before the first iteration, the runs, notes, and the effect of a wrong model."""

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

SLOWLY = 1.5  # times the floor: above it more runs would help
SHARE = 0.05  # of the energy on either side of the band of a signal
SLOWEST = 0.5  # Hz: an error below it is not caused by Q, which is about 1 there
PASSES = 0.995  # mean |Q| over an error from which on Q is not the cause of this error
APART = 0.01  # excess of sigma over the frequency bound: the ends of the run are then the slowest part


def sentence(
    axes: Sequence[AxisLearning], floors: Sequence[Floor], design: LearningDesign, names: Sequence[str],
    corrected: slice,
) -> str:  # fmt: skip
    """Return a sentence with the rate of the slowest axis and the largest share of the error that remains."""
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


def why(axis: AxisLearning, end: Floor, design: LearningDesign, corrected: slice) -> str:
    """Return the cause of the remaining error."""
    if end.clipped:
        return "the bounds on the input prevent it"
    if design.law == "norm_optimal":
        return "the weight of the effort prevents it"
    low, high = band(end.rest[corrected], axis.sample_time)
    energy = np.abs(np.fft.rfft(end.rest[corrected])) ** 2
    f = np.fft.rfftfreq(len(end.rest[corrected]), axis.sample_time)
    passed = np.interp(f, axis.frequency, np.abs(axis.response))
    if low < SLOWEST or (energy.sum() > 0 and float(energy @ passed / energy.sum()) > PASSES):
        return "it comes from the lead-in and the lead-out, where the windows reduce the input"
    if design.case == "1":
        return f"it is above {low:.2g} Hz, where Q with its low pass at {design.low_pass:g} Hz attenuates"
    return f"it is between {low:.2g} and {high:.2g} Hz, where Q attenuates"


def band(signal: Array, sample_time: float) -> tuple[float, float]:
    """Return the frequencies [Hz] between which nine tenths of the energy of a signal (N,) lie."""
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
    """Return notes on errors (runs, axes): slow convergence, scatter, and errors of the estimate."""
    remarks = []
    for name, axis, end, course in zip(names, axes, floors, errors.T, strict=True):
        if not axis.rate.monotone:
            remarks.append(f"{name}: {axis.rate.words}")
        if len(course) and 0 < SLOWLY * end.total < course[-1]:
            runs = int(np.ceil(np.log(end.total / course[-1]) / np.log(min(axis.bound.value, 0.999))))
            remarks.append(
                f"{name}: {100 * course[-1] / course[0]:.2g} % of the error left after {len(course) - 1} iterations, "
                f"{100 * end.total / end.before:.2g} % would be possible: at {axis.bound.value:.2f} per iteration "
                f"near {axis.bound.frequency:.3g} Hz this takes about {runs} more, because the loop attenuates the "
                "input there"
            )
        if end.scatter > end.repeating:
            remarks.append(f"{name}: most of the floor is scatter between runs; more iterations do not help")
    if design.case in ("2A", "2B"):
        remarks.append("errors of the estimate are learned: the error of the tool may be larger than shown")
    return tuple(remarks)


def micrometres(value: float) -> str:
    """Format a length [m] in um, without powers of ten."""
    um = 1e6 * value
    return f"{um:.0f} um" if um >= 1000 else f"{um:.3g} um"


OFF = (-0.2, -0.1, -0.06, -0.03, -0.01, 0.0, 0.01, 0.03, 0.06, 0.1, 0.2)  # of the tool's frequency
SLOW_CUTOFF = 2.63  # Hz, Dressler 2012, (7.18)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class MismatchStudy(Study):
    """Errors of estimates of the tool, root mean squares over the fully corrected samples of one run."""

    off: Annotated[Sequence[float], "relative deviation of the model's frequency from the tool's"] = ()
    kalman: Annotated[Sequence[float], Quantity("m", "error of the Kalman filter for each", written="um")] = ()
    normalised: Annotated[Sequence[float], "mean square of its normalised innovations, 1 for a right model"] = ()
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
    """Compute the error of estimates of the tool for models with a wrong frequency.

    Args:
        run: "motor" [m], "acceleration" [m/s2] and the true "tool" [m], each (N,), from rest; for example synthetic.
        frequency, damping: of the tool [Hz] and [1]. off: relative deviations of the frequency. noise: of the
            accelerometer [m/s2]. cutoff: of the complementary filter [Hz]. ramp: samples left out at either end.
        title, progress, max_seconds, stop: see `gtmodel.results.Work`.

    For each model the filter's process noise maximises the likelihood of its innovations, without using the tool.
    Raises ArgumentError if signals are missing or differ in length, or if numbers are out of range.

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
        raise ArgumentError(f"has no {', '.join(missing)}; expected motor, acceleration and tool", "run")
    signals = {name: np.asarray(run[name], float) for name in ("motor", "acceleration", "tool")}
    size = len(signals["motor"])
    if any(x.shape != (size,) or not np.all(np.isfinite(x)) for x in signals.values()):
        raise ArgumentError("expected finite signals of equal length", "run")
    check_judged(size, ramp, "run")
    if any(not d > -1 for d in off) or not len(off):
        raise ArgumentError("expected one or more numbers above -1", "off")
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
    title = work.title or "error of the estimate against mismatch of the model"
    return MismatchStudy(
        status=SolveStatus.SOLVED, title=title,
        message=f"the error of the Kalman filter is {micrometres(kalman[best])} with a model that is "
        f"{100 * off[best]:+.0f} % off, and {micrometres(max(kalman))} at worst; the error of the motors alone is "
        f"{micrometres(alone)}",
        figures={"mismatch": partial(_mismatch, np.array(off), np.array(kalman), alone, both, title)},
        off=list(off), kalman=kalman, normalised=normalised, kinematics=alone, complementary=both,
    )  # fmt: skip


def _mismatch(off: Array, kalman: Array, alone: float, both: float, title: str) -> Any:
    from ...plot.learning import mismatch_figure

    return mismatch_figure(off, kalman, alone, both, title=title)


LAST = 5  # first run of the mean in Table 7.2, k = 5 .. 10
REACHED = 1.5  # times the predicted error: above it the model does not describe the robot
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
    """Run iterative learning control on a robot that repeats a motion: Dressler 2012, chapter 7.

    Args:
        robot: the law's model. path: the square to learn. design: the law. noise: differences between runs.
        experiment: a `RepeatedMotion` with the axes of `robot`; by default a `SyntheticExperiment` of these options.
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    Identical runs without input come first; their mean and scatter predict the error of each run and the floor. Raises
    ArgumentError if the law would diverge on one of its models, before any learning.

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
        raise ArgumentError(
            f"expected the robot's axes, {', '.join(robot.axes)}; found {', '.join(runs.names)}", "experiment"
        )
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
        estimates = np.array([axis.estimate({s: v[:, k] for s, v in run.items()}) for run in repeats])
        firsts.append(reference[:, k] - estimates.mean(axis=0))
        floors.append(axis.floor(firsts[-1], corrected, design.iterations, estimates))
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
    """The laws designed so far, if the study is interrupted before learning."""
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
            max(over), REACHED, "the errors exceed the prediction; identify the model again, or widen its set"
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


def _over(value: float, divisor: float) -> float:
    """The quotient, with 0 / 0 = 0."""
    return value / divisor if divisor else (0.0 if not value else np.inf)


def _rms(values: Array) -> Array:
    return np.sqrt(np.mean(np.square(values), axis=0))


def _input(time: Array, names: Sequence[str], inputs: Sequence[Array], synthetic: str) -> str:
    return input_csv(time, names, inputs[-1], synthetic)


def input_csv(time: Array, names: Sequence[str], u: Array, synthetic: str | None) -> str:
    """Format an input (N, axes) as a table with all digits, for the loop's replay law and the next iteration."""
    lines = [f"# synthetic: {synthetic}"] if synthetic else []
    lines.append(",".join(["time [s]", *(f"input_{name.replace(' ', '_')} [m]" for name in names)]))
    lines += [",".join([f"{t:.9g}", *(repr(float(x) + 0.0) for x in row)]) for t, row in zip(time, u, strict=True)]
    return "\n".join(lines) + "\n"


def _errors(*arguments: Any) -> Any:
    from ...plot.learning import course_figure

    return course_figure(*arguments)


def filter_picture(names: Sequence[str], axes: Sequence[AxisLearning], title: str) -> Any:
    """Draw |1 - L T| and 1/|Q| of each axis."""
    from ...plot.learning import filter_figure

    return filter_figure(names, [(a.frequency, a.response, a.rest) for a in axes], title=title)


def _tool(run: dict[str, Array]) -> Array | None:
    return run.get("true tool", run.get("tool"))


def _path(reference: Array, tool: Array, before: Array, corrected: slice, title: str) -> Any:
    from ...plot.learning import tool_path_figure

    return tool_path_figure(reference[corrected], tool[corrected], before=before[corrected], title=title)
