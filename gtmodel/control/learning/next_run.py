"""The technician's loop: one measured run in, the next input out, and whether anything is left to learn."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from ...results import ArgumentError, SolveStatus, Trajectory, Work, at_most
from ...results.door import study_function
from ...results.made_files import MadeFiles
from ...results.work import Progress, never, silent
from .course import floor
from .designed import AxisLearning, design_axis
from .law import RAMP
from .lifted import Array
from .options import LearningDesign, LearningRobot
from .result import NextInputStudy
from .study import CASE_1, filter_picture, input_csv

AT_THE_FLOOR = 1.2  # times the floor: what is predicted is within 20 % of what is reached
EVEN = 0.01  # of a period
NEEDS = {"1": ("motor",), "2A": ("motor", "acceleration"), "2B": ("motor", "acceleration"), "3": ("tool",)}


@study_function
def next_input(
    robot: LearningRobot,
    run: Trajectory,
    design: LearningDesign = CASE_1,
    *,
    repeats: Sequence[Trajectory] = (),
    ramp: int = RAMP,
    acceleration_noise: float = 0.07,
    title: str = "",
    progress: Progress = silent,
    max_seconds: float | None = None,
    stop: Callable[[], bool] = never,
) -> NextInputStudy:
    """The next input of a learning law, from one measured run.

    Args:
        robot: as it is known. design: the law.
        run: "reference", "input" (zero where left out) and what the case learns from, "motor", "tool" or
            "acceleration", each (N, axes) or, of one axis, (N,); [m] and [m/s2], at even times.
        repeats: three or more runs that were identical to each other, with the same signals.
        ramp: samples of lead-in and of lead-out. acceleration_noise: of a reading [m/s2].
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    Where the error has come near the floor in every axis the input stays as it is, and the message says so. Raises
    ArgumentError where signals are missing or do not match, and for a law that would diverge.

    >>> learning = gt.control.learning
    >>> t, r = 0.004 * np.arange(825), learning.SquarePath().samples(0.004)[:, 0]
    >>> robot = learning.LearningRobot(frequency=(7.4,), damping=(0.2,))
    >>> q = robot.plant(0).maps(825)["motor"](r)
    >>> s = learning.next_input(robot, gt.Trajectory(t, {"reference": r, "motor": q}, {"reference": "m", "motor": "m"}))
    >>> s.learned, s.trajectory["next_input"].shape
    (False, (825, 1))
    """
    work = Work(progress=progress, max_seconds=max_seconds, stop=stop)
    names, size = robot.axes, len(run)
    steps = np.diff(run.time)
    if size < 2 or np.any(np.abs(steps - robot.sample_time) > EVEN * robot.sample_time):
        raise ArgumentError(f"its rows are not {1e3 * robot.sample_time:g} ms apart, as robot.sample_time says", "run")
    reference = _columns(run, "reference", len(names), size, "run")
    u = _columns(run, "input", len(names), size, "run") if "input" in run.names else np.zeros_like(reference)
    signals = _signals(run, design.case, len(names), size, "run")
    others = [_signals(r, design.case, len(names), size, f"repeats[{k}]") for k, r in enumerate(repeats)]
    corrected = slice(ramp, size - ramp)
    axes: list[AxisLearning] = []
    errors, floors, scatter, bests = [], [], [], []
    for k, name in enumerate(names):
        work.step(f"law of {name}", k / len(names))
        mine = {s: v[:, k] for s, v in signals.items()}
        axis = design_axis(robot, k, design, size, ramp, [mine], acceleration_noise)
        e = reference[:, k] - axis.estimate(mine)
        seen = [axis.estimate({s: v[:, k] for s, v in other.items()}) for other in others]
        left = floor(axis.law, axis.seen, e + axis.seen(u[:, k]), corrected, 1, np.array(seen) if seen else None)
        axes.append(axis)
        errors.append(float(np.sqrt(np.mean(e[corrected] ** 2))))
        floors.append(left.total)
        scatter.append(left.scatter)
        bests.append(axis.next_input(u[:, k], e))
    learned = all(e <= AT_THE_FLOOR * f for e, f in zip(errors, floors, strict=True))
    after = u if learned else np.column_stack(bests)
    return _answer(run, names, design, axes, errors, floors, scatter if repeats else None, learned, after, title)


def _answer(
    run: Trajectory, names: Sequence[str], design: LearningDesign, axes: Sequence[AxisLearning],
    errors: Sequence[float], floors: Sequence[float], scatter: Sequence[float] | None, learned: bool, after: Array,
    title: str,
) -> NextInputStudy:  # fmt: skip
    worst = int(np.argmax(np.array(errors) / np.array(floors)))
    of = f"{1e6 * errors[worst]:.3g} um, floor {1e6 * floors[worst]:.3g} um"
    message = (
        f"nothing more can be learned: the error of every axis is at its floor ({names[worst]}: {of}); keep this input"
        if learned
        else f"go on: {names[worst]} errs by {of}; at best {max(a.bound.value for a in axes):.2f} remains per iteration"
    )
    notes = [f"{name}: {axis.rate.words}" for name, axis in zip(names, axes, strict=True) if not axis.rate.monotone]
    if scatter is None:
        notes.append("the floor is that of the repeating error alone; record three runs to know their scatter")
    trajectory = Trajectory(run.time, {"next_input": after}, {"next_input": "m"}, synthetic=run.synthetic)
    shown = title or "the next input"
    return NextInputStudy(
        status=SolveStatus.SOLVED, message=message, title=shown, notes=tuple(notes), trajectory=trajectory,
        checks={"bound": at_most(max(a.bound.value for a in axes), 1 + 1e-9, "lower the cutoff or the contraction")},
        files=MadeFiles({"next_input.csv": partial(input_csv, run.time, names, after, run.synthetic)}),
        machine_files=("next_input.csv",), figures={"filter": partial(filter_picture, names, axes, shown)},
        axes=tuple(names), case=design.case, error=errors, floor=floors, scatter=scatter,
        sigma=[a.rate.sigma for a in axes], bound=[a.bound.value for a in axes], learned=learned,
        largest_input=np.abs(after).max(axis=0).tolist(), synthetic=run.synthetic,
    )  # fmt: skip


def _signals(run: Trajectory, case: str, axes: int, size: int, argument: str) -> dict[str, Array]:
    return {name: _columns(run, name, axes, size, argument) for name in NEEDS[case]}


def _columns(run: Trajectory, name: str, axes: int, size: int, argument: str) -> Array:
    if name not in run.names:
        raise ArgumentError(f"has no signal '{name}'; it has {', '.join(run.names)}", argument)
    unit = "m/s2" if name == "acceleration" else "m"
    if run.unit(name) not in (unit, "m/s^2" if unit == "m/s2" else unit):
        raise ArgumentError(f"'{name}' is in {run.unit(name)}; expected {unit}", argument)
    values = np.asarray(run[name], float).reshape(len(run), -1)
    if values.shape != (size, axes):
        raise ArgumentError(
            f"'{name}' has {values.shape[0]} rows of {values.shape[1]} columns; expected {size} of {axes}, one for "
            "each axis", argument,
        )  # fmt: skip
    return values
