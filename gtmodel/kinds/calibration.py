"""Kind "calibration": geometric parameters of a robot from measured poses, or joint stiffness from load tests."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from gtmodel.problem_files.base import Context, InputError, Outcome
from gtmodel.results import SolveStatus

from . import (
    calibration_parameters,
    calibration_poses,
    calibration_report,
    calibration_sensitivity,
    calibration_stiffness,
)
from .calibration_carts import on_cart_points
from .calibration_choice import prepared, require_poses
from .calibration_data import CARTS, FILE, data_of, with_device
from .calibration_findings import found_of, length_noise
from .calibration_keys import Schema
from .calibration_pictures import pictures
from .calibration_recognition import a_priori, exchanged_after, recognise_sessions, witness_of
from .calibration_results import VALUES as GEOMETRIC
from .calibration_results import checks_of, rows_of, values_of

__all__ = ["NAME", "VALUES", "Schema", "explain", "solve"]

NAME = "calibration"

VALUES = {**GEOMETRIC, "joint_stiffness": calibration_stiffness.VALUES}


def solve(problem: Schema, context: Context) -> Outcome:
    """Read or make the poses, see whether they were read right, fit, predict the held-out ones, judge."""
    if problem.joint_stiffness is not None:
        return calibration_stiffness.solve(problem, context)
    context.progress("reading", 0.1)
    model, on_points = on_cart_points(problem, context)
    data = data_of(problem, model, context)
    context.progress("looking at the poses", 0.3)
    witness = witness_of(model, data)
    placed = recognise_sessions(data, witness)
    if placed and data.keys.device_start is None:
        data = with_device(data, placed)
    if context.interrupted():
        return Outcome(status=SolveStatus.INTERRUPTED, message="stopped before the fit")
    context.progress("fitting", 0.5)
    ready = prepared(problem, model, data.fitted, data.keys.actuators, on_points)
    require_poses(ready)
    found = found_of(problem, data, ready, a_priori(data, witness, placed), context.interrupted)
    c = found.calibration
    left = float(np.sqrt(np.mean(c.residuals**2))) if c.status.ok else np.inf
    stopped = c.status is SolveStatus.INTERRUPTED
    exchanged = None if stopped else exchanged_after(data, ready, left, witness.size)
    if exchanged is not None:
        raise InputError(exchanged, f"measurements.signals.{data.keys.actuators}")
    context.progress("telling", 0.9)
    title = problem.title or f"calibration of {problem.robot}"
    if data.synthetic and "synthetic" not in title.lower():
        title += " (synthetic)"
    values = {**values_of(problem, found), "joint_stiffness": None}
    figures = pictures(found, title)
    files: dict[str, Callable[[], str]] = {
        "parameters.toml": lambda: calibration_parameters.text(found, model, title, problem, context),
        "poses.csv": lambda: calibration_poses.text(found),
        "report.html": lambda: calibration_report.text(found, values, figures, title, problem, context),
    }
    if values.get("sensitivity"):
        files["sensitivity.csv"] = lambda: calibration_sensitivity.text(values["sensitivity"])
    if data.text is not None:
        files[FILE] = lambda: data.text or ""
    if data.carts is not None:
        files[CARTS] = lambda: data.carts or ""
    told, _, held = found.told
    message = c.message
    if c.status.ok and found.position in told:
        message += f"; {'held-out' if held else 'fitted'} error {1e3 * told[found.position].mean:.3g} mm in the mean"
    return Outcome(
        status=c.status,
        message=message,
        objective=float(0.5 * (c.residuals**2).sum()),
        iterations=c.iterations,
        checks=checks_of(problem, found),
        values=values,
        rows=rows_of(values, found),
        figures=figures,
        files=_Files(files),
        machine_files=("parameters.toml",),
    )


def explain(problem: Schema, context: Context) -> str:
    """What is free, what stays, and what the poses can tell before anything is fitted."""
    if problem.joint_stiffness is not None:
        return calibration_stiffness.explain(problem, context)
    model, on_points = on_cart_points(problem, context)
    data = data_of(problem, model, context)
    ready = prepared(problem, model, data.fitted, data.keys.actuators, on_points)
    u = ready.unknowns
    lines = [
        f"{problem.title or NAME}: {len(data.fitted)} poses fitted, {int(data.held_out.sum())} held out; "
        f"{len(u.names)} unknowns, cost {problem.cost}"
    ]
    lines += [f"  {n} [{unit or '1'}] from {x:g}" for n, unit, x in zip(u.names, u.units, u.start, strict=True)]
    fixed = [n for n in ready.values(u.start) if n not in u.names]
    if fixed:
        lines.append(f"fixed, tied or turned as a quaternion: {', '.join(fixed)}")
    return "\n".join([*lines, *ready.identifiability(sigma=length_noise(ready)).sentences()])


class _Files(Mapping[str, str]):
    """Files by name, made when they are written."""

    def __init__(self, makers: Mapping[str, Callable[[], str]]) -> None:
        self._makers = dict(makers)

    def __getitem__(self, name: str) -> Any:
        return self._makers[name]()

    def __iter__(self) -> Iterator[str]:
        return iter(self._makers)

    def __len__(self) -> int:
        return len(self._makers)
