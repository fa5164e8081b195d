"""Study that computes the next input from one measured run, and whether anything remains to be learned."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Annotated, Unpack

import numpy as np

from ...results import Check, SolveStatus, Trajectory, Within, Work, at_most
from ...results.disk import MadeFiles
from ...results.suspicion import Suspicion, suspicion_checks
from ...results.work import WorkOptions, study_function
from .course import Floor
from .design import AxisLearning, design_axis
from .identified import accelerometer
from .law import RAMP
from .lifted import Array
from .measured_runs import check_repeats, check_run, columns, drift, moves_outside, signals_of
from .options import LearningDesign, LearningRobot, NextInputStudy
from .robot import ModelledRobot
from .study import CASE_1, filter_picture, input_csv, micrometres

AT_THE_FLOOR = 1.2  # times the floor: the prediction is accurate to 20 %
SCATTERS = 3.0  # times the error of a run: repeats that differ by more are not runs of one motion
EXPLAINED = 0.5  # of the error before learning: largest deviation of a run from the model; else rate and floor mislead
OUTSIDE = 0.5  # of the path length of the reference: largest share that is not evaluated
SHORTEN = "most of the motion lies in lead-in and lead-out, which are not evaluated; shorten them"
ANOTHER = (
    "the run does not agree with the model for this reference and input: check columns, units, signs and the input of "
    "the run, or identify the robot again"
)


@study_function
def next_input(
    robot: LearningRobot | ModelledRobot,
    run: Trajectory,
    design: LearningDesign = CASE_1,
    *,
    repeats: Sequence[Trajectory] = (),
    ramp: Annotated[int, Within(least=0)] = RAMP,
    acceleration_noise: Annotated[float, Within(least=0.0)] = 0.07,
    **work_options: Unpack[WorkOptions],
) -> NextInputStudy:
    """Compute the next input of a learning law from one measured run.

    Args:
        robot: its model. design: the law.
        run: "reference", "input" (zero by default) and the signals of the case, "motor", "tool" or "acceleration",
            each (N, axes), or (N,) for one axis; [m] and [m/s2], at equal time steps. Positions are relative to the
            start of the reference. If the run is from rest to rest, the accelerometer's bias is removed.
        repeats: three or more runs of the same reference with one common input, with the same signals.
        ramp: samples of lead-in and of lead-out. acceleration_noise: of a reading [m/s2].
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    If the error of every axis is within 20 % of the floor, the input stays unchanged, and the message says so. A check
    fails if the run does not agree with the model, if the accelerometer disagrees with the tool (or with the model if
    no tool was measured), or if most of the motion lies in lead-in and lead-out. Raises ArgumentError if signals are
    missing or do not match, if fewer than 50 samples remain to evaluate, if repeats are not runs of one motion, or if
    the law would diverge.

    >>> learning = gt.control.learning
    >>> t, r = 0.004 * np.arange(825), learning.SquarePath().samples(0.004)[:, 0]
    >>> robot = learning.LearningRobot(frequency=(7.4,), damping=(0.2,))
    >>> q = robot.plant(0).maps(825)["motor"](r)
    >>> s = learning.next_input(robot, gt.Trajectory(t, {"reference": r, "motor": q}, {"reference": "m", "motor": "m"}))
    >>> s.learned, s.trajectory["next_input"].shape
    (False, (825, 1))
    """
    work = Work(**work_options)
    names, size = robot.axes, len(run)
    check_run(run, robot.sample_time, ramp)
    reference = columns(run, "reference", len(names), size, "run")
    u = columns(run, "input", len(names), size, "run") if "input" in run.names else np.zeros_like(reference)
    signals, bias = signals_of(run, reference, u, design.case, len(names), "run")
    check_repeats(repeats, run, robot.sample_time)
    others = [signals_of(r, reference, u, design.case, len(names), f"repeats[{k}]")[0] for k, r in enumerate(repeats)]
    tool = columns(run, "tool", len(names), size, "run") if "tool" in run.names else None
    reference = reference - reference[0]
    corrected = slice(ramp, size - ramp)
    doubts: list[Suspicion] = []
    axes: list[AxisLearning] = []
    errors, floors, bests, unexplained, slides = [], [], [], [], []
    for k, name in enumerate(names):
        work.step(f"law of {name}", k / len(names))
        log = {s: v[:, k] for s, v in signals.items()}
        axis = design_axis(robot, k, design, size, ramp, [log], acceleration_noise)
        hat = axis.estimate(log)
        if "acceleration" in log:
            moved = robot.plant(k).maps(size)["acceleration"](reference[:, k] + u[:, k])
            doubts.append(
                accelerometer(
                    f" of {name}", log["acceleration"], None if tool is None else tool[:, k], moved, robot.sample_time
                )
            )
        e = reference[:, k] - hat
        estimates = np.array([axis.estimate({s: v[:, k] for s, v in other.items()}) for other in others])
        floors.append(axis.floor(e + axis.seen(u[:, k]), corrected, 1, estimates if len(estimates) else None))
        axes.append(axis)
        errors.append(_rms(e[corrected]))
        bests.append(axis.next_input(u[:, k], e))
        before = _rms((reference[:, k] - axis.seen(reference[:, k]))[corrected])
        off = _rms((hat - axis.seen(reference[:, k] + u[:, k]))[corrected])
        unexplained.append(off / before if before else (0.0 if off <= floors[-1].total else np.inf))
        slides.append(drift(estimates[:, corrected]) if len(estimates) else False)
    wrong, sentences = suspicion_checks(doubts)
    checks = {"moves_outside": at_most(moves_outside(reference, corrected), OUTSIDE, SHORTEN), **wrong}
    learned = all(e <= AT_THE_FLOOR * f.total for e, f in zip(errors, floors, strict=True))
    after = u if learned else np.column_stack(bests)
    notes = [f"{name}: {axis.rate.words}" for name, axis in zip(names, axes, strict=True) if not axis.rate.monotone]
    if not repeats:
        notes.append("the floor includes only the repeating error; record three repeats to include their scatter")
    if "input" not in run.names:
        notes.append("the run has no input, so zero is assumed: this is right only for a first run")
    if any(abs(b) > acceleration_noise for b in bias):
        notes.append(f"the accelerometer's mean of {max(bias, key=abs):.3g} m/s2 over the run was subtracted")
    notes += [
        f"{name}: the repeats drift from run to run, which a law can follow: the floor may be lower"
        for name, slide in zip(names, slides, strict=True) if slide
    ]  # fmt: skip
    return _answer(
        run, names, design, axes, errors, floors, bool(repeats), learned, after, unexplained, notes + sentences,
        work.title, checks,
    )  # fmt: skip


def _answer(
    run: Trajectory, names: Sequence[str], design: LearningDesign, axes: Sequence[AxisLearning],
    errors: Sequence[float], floors: Sequence[Floor], repeated: bool, learned: bool, after: Array,
    unexplained: Sequence[float], notes: Sequence[str], title: str, checks: Mapping[str, Check],
) -> NextInputStudy:  # fmt: skip
    scattering = {}
    if repeated:
        share = max(f.scatter / e if e else (np.inf if f.scatter else 0.0) for e, f in zip(errors, floors, strict=True))
        scattering["scatter_over_error"] = at_most(
            share, SCATTERS, "the repeats scatter too much for runs of one motion; record them again"
        )
    over = [e / f.total if f.total else (np.inf if e else 0.0) for e, f in zip(errors, floors, strict=True)]
    worst = int(np.argmax(over))
    size = f"{micrometres(errors[worst])}, floor {micrometres(floors[worst].total)}"
    rate = max(max(a.bound.value, a.rate.sigma if a.rate.monotone else 0.0) for a in axes)
    message = (
        f"nothing more can be learned: every axis is at its floor ({names[worst]}: {size}); keep this input"
        if learned
        else f"continue: error of {names[worst]} {size}; the excess falls by a factor of {rate:.2f} or better per run"
    )
    trajectory = Trajectory(run.time, {"next_input": after}, {"next_input": "m"}, synthetic=run.synthetic)
    title = title or "the next input"
    return NextInputStudy(
        status=SolveStatus.SOLVED, message=message, title=title, notes=tuple(notes), trajectory=trajectory,
        checks={
            "bound": at_most(max(a.bound.value for a in axes), 1 + 1e-9, "lower the cutoff or the contraction"),
            "unexplained": at_most(max(unexplained), EXPLAINED, ANOTHER),
            **scattering, **checks,
        },
        files=MadeFiles({"next_input.csv": partial(input_csv, run.time, names, after, run.synthetic)}),
        machine_files=("next_input.csv",), figures={"filter": partial(filter_picture, names, axes, title)},
        axes=tuple(names), case=design.case, error=errors, floor=[f.total for f in floors],
        scatter=[f.scatter for f in floors] if repeated else None, unexplained=unexplained,
        sigma=[a.rate.sigma for a in axes], bound=[a.bound.value for a in axes], learned=learned,
        largest_input=np.abs(after).max(axis=0).tolist(), synthetic=run.synthetic,
    )  # fmt: skip


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
