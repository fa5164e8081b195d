"""The technician's loop: one measured run in, the next input out, and whether anything is left to learn."""

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

AT_THE_FLOOR = 1.2  # times the floor: what is predicted is within 20 % of what is reached
SCATTERS = 3.0  # times the error of a run: repeats that differ by more are not of one motion
EXPLAINED = 0.5  # of the error before learning: what the model must make of a run, or rate and floor say nothing of it
OUTSIDE = 0.5  # of the way of the reference: the part that is judged holds the greater one
SHORTEN = "most of the motion lies in lead-in and lead-out, where it is not judged; shorten them"
ANOTHER = (
    "the run is not what the model makes of reference and input: look at columns, units, signs and the input that ran, "
    "or identify the robot anew"
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
    """The next input of a learning law, from one measured run.

    Args:
        robot: as it is known. design: the law.
        run: "reference", "input" (zero where left out) and what the case learns from, "motor", "tool" or
            "acceleration", each (N, axes) or, of one axis, (N,); [m] and [m/s2], at even times. Positions count from
            where the reference begins; of a run from rest to rest the accelerometer's bias is taken off.
        repeats: three or more runs of the same reference and one input, with the same signals.
        ramp: samples of lead-in and of lead-out. acceleration_noise: of a reading [m/s2].
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    Where the error has come near the floor in every axis the input stays as it is, and the message says so. A check
    fails where the run is not what the model makes of its reference and input, where the accelerometer reads another
    motion than the tool does (that of the model where no tool was measured), and where most of the motion lies in
    lead-in and lead-out. Raises ArgumentError where signals are missing or do not match, where fewer than 50 samples
    are left to judge, where repeats differ in more than their scatter, and for a law that would diverge.

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
        mine = {s: v[:, k] for s, v in signals.items()}
        axis = design_axis(robot, k, design, size, ramp, [mine], acceleration_noise)
        hat = axis.estimate(mine)
        if "acceleration" in mine:
            moved = robot.plant(k).maps(size)["acceleration"](reference[:, k] + u[:, k])
            doubts.append(
                accelerometer(
                    f" of {name}", mine["acceleration"], None if tool is None else tool[:, k], moved, robot.sample_time
                )
            )
        e = reference[:, k] - hat
        seen = np.array([axis.estimate({s: v[:, k] for s, v in other.items()}) for other in others])
        floors.append(axis.floor(e + axis.seen(u[:, k]), corrected, 1, seen if len(seen) else None))
        axes.append(axis)
        errors.append(_rms(e[corrected]))
        bests.append(axis.next_input(u[:, k], e))
        before = _rms((reference[:, k] - axis.seen(reference[:, k]))[corrected])
        off = _rms((hat - axis.seen(reference[:, k] + u[:, k]))[corrected])
        unexplained.append(off / before if before else (0.0 if off <= floors[-1].total else np.inf))
        slides.append(drift(seen[:, corrected]) if len(seen) else False)
    wrong, sentences = suspicion_checks(doubts)
    judged = {"moves_outside": at_most(moves_outside(reference, corrected), OUTSIDE, SHORTEN), **wrong}
    learned = all(e <= AT_THE_FLOOR * f.total for e, f in zip(errors, floors, strict=True))
    after = u if learned else np.column_stack(bests)
    notes = [f"{name}: {axis.rate.words}" for name, axis in zip(names, axes, strict=True) if not axis.rate.monotone]
    if not repeats:
        notes.append("the floor is that of the repeating error alone; record three runs to know their scatter")
    if "input" not in run.names:
        notes.append("the run has no input, so it counts as zero: right for a first run only")
    if any(abs(b) > acceleration_noise for b in bias):
        notes.append(f"the accelerometer's mean of {max(bias, key=abs):.3g} m/s2 over the run is taken off")
    notes += [
        f"{name}: the repeats slide one way from run to run, which a law can follow: the floor may be lower"
        for name, slide in zip(names, slides, strict=True) if slide
    ]  # fmt: skip
    return _answer(
        run, names, design, axes, errors, floors, bool(repeats), learned, after, unexplained, notes + sentences,
        work.title, judged,
    )  # fmt: skip


def _answer(
    run: Trajectory, names: Sequence[str], design: LearningDesign, axes: Sequence[AxisLearning],
    errors: Sequence[float], floors: Sequence[Floor], repeated: bool, learned: bool, after: Array,
    unexplained: Sequence[float], notes: Sequence[str], title: str, judged: Mapping[str, Check],
) -> NextInputStudy:  # fmt: skip
    scattering = {}
    if repeated:
        share = max(f.scatter / e if e else (np.inf if f.scatter else 0.0) for e, f in zip(errors, floors, strict=True))
        scattering["scatter_over_error"] = at_most(
            share, SCATTERS, "the repeats differ by more than the run errs, so they are not of one motion; record anew"
        )
    over = [e / f.total if f.total else (np.inf if e else 0.0) for e, f in zip(errors, floors, strict=True)]
    worst = int(np.argmax(over))
    of = f"{micrometres(errors[worst])}, floor {micrometres(floors[worst].total)}"
    rate = max(max(a.bound.value, a.rate.sigma if a.rate.monotone else 0.0) for a in axes)
    message = (
        f"nothing more can be learned: the error of every axis is at its floor ({names[worst]}: {of}); keep this input"
        if learned
        else f"go on: {names[worst]} errs by {of}; what is above it falls to {rate:.2f} or less per iteration"
    )
    trajectory = Trajectory(run.time, {"next_input": after}, {"next_input": "m"}, synthetic=run.synthetic)
    shown = title or "the next input"
    return NextInputStudy(
        status=SolveStatus.SOLVED, message=message, title=shown, notes=tuple(notes), trajectory=trajectory,
        checks={
            "bound": at_most(max(a.bound.value for a in axes), 1 + 1e-9, "lower the cutoff or the contraction"),
            "unexplained": at_most(max(unexplained), EXPLAINED, ANOTHER),
            **scattering, **judged,
        },
        files=MadeFiles({"next_input.csv": partial(input_csv, run.time, names, after, run.synthetic)}),
        machine_files=("next_input.csv",), figures={"filter": partial(filter_picture, names, axes, shown)},
        axes=tuple(names), case=design.case, error=errors, floor=[f.total for f in floors],
        scatter=[f.scatter for f in floors] if repeated else None, unexplained=unexplained,
        sigma=[a.rate.sigma for a in axes], bound=[a.bound.value for a in axes], learned=learned,
        largest_input=np.abs(after).max(axis=0).tolist(), synthetic=run.synthetic,
    )  # fmt: skip


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
