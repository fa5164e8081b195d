"""The calibration study: fit geometric parameters to measured poses and validate them on held-out poses."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from itertools import groupby
from typing import Annotated, Literal, Unpack

import numpy as np

from ..lang import Model
from ..results import ArgumentError, SolveStatus, Work
from ..results.disk import MadeFiles
from ..results.options import Within
from ..results.suspicion import Inspection
from ..results.work import WorkOptions, study_function
from . import sensitivity
from .held_out import folds_of
from .measured.misreadings import Witness, a_priori, misread_after, misread_by_lengths, recognise_sessions, witness_of
from .measured.options import CartPoints, Refit
from .measured.poses import MeasuredPoses, SplitPoses, split_all
from .measurements import Measurements
from .options import Fit
from .problem import CalibrationProblem
from .report import robot_file, values as poses_table
from .report.findings import CalibrationFindings, findings_of, length_noise
from .report.result import CalibrationStudy
from .report.robot_file import Origin
from .report.values import KEPT, checks_of, pictures, scenes, values_of
from .variants import by_dh_numbers, on_cart_points, prepared, too_few, with_measured_orientation


@study_function
def study(
    robot: Model,
    poses: MeasuredPoses | Measurements | Sequence[MeasuredPoses | Measurements],
    fit: Fit | None = None,
    *,
    held_out: Annotated[int, Within(least=0)] = 2,
    refit: Refit | None = None,
    method: Literal["every", "leave_one_out", "folds"] = "every",
    folds: Annotated[int, Within(least=2)] = 10,
    carts: CartPoints | None = None,
    origin: Origin | None = None,
    **work_options: Unpack[WorkOptions],
) -> CalibrationStudy:
    """Calibrate a robot on measured poses: check the readings, fit, predict held-out poses, report a verdict.

    Args:
        robot: the model with its nominal parameters.
        poses: measured poses in SI units: `Measurements` in memory, or `MeasuredPoses` from `read_poses` or
            `made_poses`. Several (heights, distances, positions) share the robot's parameters; they are weighted by
        their noise, and each is evaluated separately.
        fit: free parameters and cost; by default all parameters and length errors.
        held_out: every n-th pose is held out of the fit; 0 for none. Ignored if the poses mark held-out ones.
        refit: parameters specific to a held-out recording: fitted on some of its poses, validated on the others.
        method: "every" holds out poses as `held_out` says. For few poses: "leave_one_out" fits all poses and predicts
            each with a fit without it; "folds" does so with this number of `folds`.
        carts: guideways through measured points.
        origin: where the robot comes from, for parameters.toml.
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    If interrupted, the study holds the best parameters so far and has no verdict. Raises ArgumentError, also for poses
    that were misread: wrong units, exchanged columns, swapped axes. The message names the alarm; if the readings are
    right, name it in `fit.accept`, and it becomes a note.

    >>> from gtmodel.calibrate import Fit, Synthetic, made_poses, study
    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> poses = made_poses(robot, Synthetic(low=[0.0, -1.0, 0.2], high=[1.5, 0.5, 0.8], counts=[4, 4, 3]))
    >>> s = study(robot, poses, Fit(variant="modified", sensitivity_step=0.0))
    >>> s.held_out["mean"] < s.a_priori["mean"] / 10
    True

    Heights alone, from a probe; the study reports what they do not determine.

    >>> m = poses.measurements
    >>> heights = gt.calibrate.Measurements({"q": m.values["q"], "T[2]": m.values["T"][:, 2]})
    >>> s = study(robot, heights, Fit(free=["L"]))
    >>> [(r["name"], list(r["errors"])) for r in s.recordings]
    [('measurements', ['T[2]'])]
    """
    work = Work(**work_options)
    fit, origin = fit or Fit(), origin or Origin(type(robot).__name__)
    robot, on_points = on_cart_points(by_dh_numbers(fit, robot), carts)
    plain, robot = robot, with_measured_orientation(robot, poses)
    inspection = Inspection(fit.accept)
    data = split_all(poses, robot, held_out if method == "every" else 0, refit, inspection)
    in_turn = [] if method == "every" else _in_turn(data, folds if method == "folds" else None)
    work.progress("checking the poses", 0.3)
    witnesses = [witness_of(plain, d) for d in data]
    frames = []
    for k, (d, w) in enumerate(zip(data, witnesses, strict=True)):
        with _among(data, k):
            frames.append(recognise_sessions(d, w, inspection))
    data = [d.with_device(p) if p and d.pose.device_start is None else d for d, p in zip(data, frames, strict=True)]
    title = work.title or f"calibration of {origin.name}"
    if any(d.synthetic for d in data) and "synthetic" not in title.lower():
        title += " (synthetic)"
    if work.interrupted():
        return CalibrationStudy(status=SolveStatus.INTERRUPTED, message="stopped before the fit", title=title)
    work.progress("fitting", 0.5)
    ready = prepared(fit, robot, data, carts, on_points)
    if len(data) > 1:
        _look_at_each(data, ready, witnesses, inspection)
    before = [a_priori(d, w, p) for d, w, p in zip(data, witnesses, frames, strict=True)]
    findings = findings_of(fit, data, ready, before, work.interrupted, inspection, refit, in_turn)
    c = findings.calibration
    # columns can be checked by the fit if all lengths are known pose by pose, and something was fitted
    checkable = c.status is not SolveStatus.INTERRUPTED and len(data) == 1 and not ready.implicit and len(c.x) > 0
    if checkable:
        inspection.refuse(misread_after(data[0], ready, c, witnesses[0]), f"poses.values.{data[0].actuators}")
    work.progress("writing the report", 0.9)
    return _study_of(findings, robot, fit, origin, title)


def _look_at_each(
    data: Sequence[SplitPoses], ready: CalibrationProblem, witnesses: Sequence[Witness], inspection: Inspection
) -> None:
    """Raise ArgumentError if columns of one of several measurements were misread.

    Uses the nominal robot: the joint fit adapts to all measurements and cannot tell which one is wrong."""
    for k, (poses, part, witness) in enumerate(zip(data, ready.parts, witnesses, strict=True)):
        with _among(data, k):
            inspection.refuse(misread_by_lengths(poses, part, witness), f"poses.values.{poses.actuators}")


@contextmanager
def _among(data: Sequence[SplitPoses], k: int) -> Iterator[None]:
    """Add name and index of the measurements to an ArgumentError if there are several."""
    try:
        yield
    except ArgumentError as error:
        if len(data) < 2 or not error.argument.startswith("poses"):
            raise
        place = f"poses[{k}]{error.argument.removeprefix('poses')}"
        raise ArgumentError(f"{data[k].name}: {error.message}", place) from error


def _in_turn(data: Sequence[SplitPoses], folds: int | None) -> list[np.ndarray]:
    """Folds for cross-validation. Raises ArgumentError for several measurements and if poses are held out already."""
    if len(data) > 1:
        raise ArgumentError(f"cross-validation takes one table of measurements; found {len(data)}", "method")
    if data[0].held_out.any():
        raise ArgumentError("the file holds out poses already; use either these or cross-validation", "method")
    return folds_of(len(data[0].lines), folds, data[0].repeated)


def explained(
    robot: Model, poses: MeasuredPoses | Measurements | Sequence[MeasuredPoses | Measurements], fit: Fit,
    held_out: int = 2, carts: CartPoints | None = None, method: str = "every", full: bool = True,
) -> list[str]:  # fmt: skip
    """Lines of text before the fit: free parameters, fixed ones, and what the poses can determine.

    full: if False, array elements share a line, and so do all badly determined combinations.
    """
    robot, on_points = on_cart_points(by_dh_numbers(fit, robot), carts)
    robot = with_measured_orientation(robot, poses)
    data = split_all(poses, robot, held_out if method == "every" else 0)
    ready = prepared(fit, robot, data, carts, on_points)
    u = ready.unknowns
    fitted, held = sum(len(d.fitted) for d in data), sum(int(d.held_out.sum()) for d in data)
    lines = [f"{fitted} poses fitted, {held} held out; {len(u.names)} unknowns, cost {fit.cost}"]
    free = zip(u.names, u.units, u.start, strict=True)
    for _, same in groupby(free, key=lambda one: one[0] if full else (one[0].partition("[")[0], one[1])):
        (name, unit, x), *more = same
        rest = (
            f" to {more[-1][0]} [{unit or '1'}]: {1 + len(more)} unknowns" if more else f" [{unit or '1'}] from {x:g}"
        )
        lines.append(f"  {name}{rest}")
    fixed = [n for n in ready.values(u.start) if n not in u.names]
    if fixed:
        lines.append(f"fixed, tied or part of a unit quaternion: {', '.join(fixed)}")
    lines += [note for note in u.notes if KEPT in note]
    if not u.names:
        return [*lines, "nothing is free: the robot is judged as it is"]
    analysis = ready.identifiability(sigma=length_noise(ready))
    lines += [*too_few(ready), *(analysis.notes if full else analysis.brief_notes)]
    return lines if full else [*lines, "add --full to list every unknown and combination"]


def _study_of(findings: CalibrationFindings, robot: Model, fit: Fit, origin: Origin, title: str) -> CalibrationStudy:
    c, values = findings.calibration, values_of(findings, fit.accuracy)
    files: dict[str, Callable[[], str]] = {
        "parameters.toml": partial(robot_file.text, findings, robot, title, origin),
        "poses.csv": partial(poses_table.text, findings),
    }
    files |= {f"poses_{part.data.name}.csv": partial(poses_table.text, part) for part in findings.beside}
    if values["sensitivity"]:
        files["sensitivity.csv"] = partial(sensitivity.text, values["sensitivity"])
    urdf = robot_file.urdf(findings, robot, title)
    files |= {name: partial(str, text) for name, text in urdf.items()}
    for part in findings.parts:
        files |= {name: partial(str, text) for name, text in part.data.source.files.items()}
    errors, _, held = findings.headline
    message = c.message
    if c.status.ok and findings.position in errors and not findings.beside:
        message += f"; mean {'held-out' if held else 'fitted'} error {1e3 * errors[findings.position].mean:.3g} mm"
    return CalibrationStudy(
        status=c.status,
        message=message,
        title=title,
        objective=float(0.5 * (np.nan_to_num(c.residuals) ** 2).sum()),
        iterations=c.iterations,
        checks=checks_of(fit.accuracy, findings),
        figures=pictures(findings, title),
        scenes=scenes(findings, robot, title),
        files=MadeFiles(files),
        machine_files=("parameters.toml", *urdf),
        **values,
    )
