"""Kind "calibration": geometric parameters of a robot from measured poses, or joint stiffness from load tests."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gtmodel import calibrate
from gtmodel.calibrate import CalibrationStudy, CartPoints, MeasuredPoses, Origin, Refit
from gtmodel.calibrate.calibration_study import explained
from gtmodel.calibrate.unknowns import merged
from gtmodel.compliance import MeasuredTests, StiffnessStudy, made_load_tests, read_load_tests, stiffness_study
from gtmodel.compliance.load_tests.stiffness import fitted_rows
from gtmodel.lang import Model
from gtmodel.problem_files import python_models, robots
from gtmodel.problem_files.base import Call, Context, InputError
from gtmodel.results import ArgumentError
from gtmodel.results.refusal import naming

from .keys import JointStiffness, MeasuredSection, Schema

STIFFNESS = "joint_stiffness"
ARGUMENTS = {
    "fit": "", "poses.values": "measurements.signals", "poses[].values": "measurements[].signals",
    "poses": "measurements", "measured": "measurements",
    "carts.points": "cart_points.file", "carts": "cart_points",
    "tests": f"{STIFFNESS}.measurements", "truth": f"{STIFFNESS}.synthetic", "load": f"{STIFFNESS}.load",
    "setup": STIFFNESS, "held_out": "held_out.every",
    "method": "held_out.method", "folds": "held_out.folds",
    "refit.what": "held_out.refit", "refit": "held_out.refit",
}  # fmt: skip
ALIKE = ("kind", "title", "robot", "parameters", STIFFNESS)


def call(problem: Schema, context: Context) -> Call:
    """Return the call of the study of the poses or of the load tests."""
    context.progress("reading measurements", 0.1)
    robot = problem.model(context)
    if problem.joint_stiffness is not None:
        keys = _stiffness(problem)
        title = problem.title or f"joint stiffness of {problem.robot}"
        study = Call(stiffness_study, robot, _tests(keys, robot, context), keys.options(), title=title)
        return study.then(_calibration)
    carts = _carts(problem, context)
    reference, before = robots.in_python(problem.robot, context)
    external = python_models.is_reference(reference) or python_models.is_arm_file(reference)
    origin = Origin(problem.robot, reference if external else "", merged(before, problem.parameters))
    title = problem.title or f"{problem.kind} of {problem.robot}"
    split = problem.held_out
    refit = Refit(split.refit, split.refit_every) if split.refit else None
    return Call(
        calibrate.study, robot, _poses(problem, robot, context), problem.options(), held_out=split.every, refit=refit,
        method=split.method, folds=split.folds, carts=carts, origin=origin, title=title,
    )  # fmt: skip


def explain(problem: Schema, context: Context) -> str:
    """Describe free and fixed parameters, and which of them the poses can determine."""
    robot = problem.model(context)
    if problem.joint_stiffness is not None:
        lines = fitted_rows(_tests(_stiffness(problem), robot, context))
    else:
        held, carts, poses = problem.held_out, _carts(problem, context), _poses(problem, robot, context)
        lines = explained(robot, poses, problem.options(), held.every, carts, held.method, context.full)
    name = problem.kind if problem.joint_stiffness is None else STIFFNESS
    return "\n".join([f"{problem.title or name}: {lines[0]}", *lines[1:]])


def _poses(problem: Schema, robot: Model, context: Context) -> MeasuredPoses | list[MeasuredPoses]:
    _one_of(problem, "measurements")
    file = problem.held_out.file
    held_out = None if file is None else context.file(file, "held_out.file", source=problem.held_out.source)
    if problem.synthetic is not None:
        return calibrate.made_poses(robot, problem.synthetic.options(), held_out)
    if isinstance(problem.measurements, MeasuredSection):
        return _read(problem.measurements, "measurements", held_out, context)
    if held_out is not None:
        raise InputError(
            "is for one table [measurements]; with several, give held_out_file in each of them", "held_out.file"
        )
    return [_read(table, f"measurements[{k}]", None, context) for k, table in enumerate(problem.measurements or [])]


def _read(keys: MeasuredSection, key: str, held_out: Path | None, context: Context) -> MeasuredPoses:
    if keys.held_out_file is not None:
        if held_out is not None:
            raise InputError("is set besides held_out.file; leave one of the two out", f"{key}.held_out_file")
        held_out = context.file(keys.held_out_file, f"{key}.held_out_file", source=keys.source)
    path = context.file(keys.file, f"{key}.file", source=keys.source)
    try:
        return calibrate.read_poses(path, keys.measured(key, context), held_out, keys.form())
    except ArgumentError as error:
        held_out_key = f"{key}.held_out_file" if keys.held_out_file else "held_out.file"
        argument_key = f"{key}.{error.argument.removeprefix('measured.')}"
        raise InputError(error.message, held_out_key if error.argument == "held_out.file" else argument_key) from error


def _carts(problem: Schema, context: Context) -> CartPoints | None:
    keys = problem.cart_points
    if keys is None:
        return None
    file = context.file(keys.file, "cart_points.file", source=keys.source)
    with naming("cart_points.file", refusal=InputError):
        positions, points = calibrate.read_cart_points(file, keys.arms, keys.unit)
    return CartPoints(positions, points, **keys.given())


def _stiffness(problem: Schema) -> JointStiffness:
    geometric = sorted(problem.model_fields_set - set(ALIKE))
    if geometric:
        raise InputError(f"belongs to a geometric calibration; leave it out with [{STIFFNESS}]", geometric[0])
    assert problem.joint_stiffness is not None
    return problem.joint_stiffness


def _tests(keys: JointStiffness, robot: Model, context: Context) -> MeasuredTests:
    _one_of(keys, STIFFNESS)
    if keys.measurements is not None:
        if keys.poses_deg is not None or keys.load is not None:
            name = "load" if keys.poses_deg is None else "poses_deg"
            raise InputError("belongs to synthetic tests; measured tests have it in their file", f"{STIFFNESS}.{name}")
        path = context.file(keys.measurements.file, f"{STIFFNESS}.measurements.file", source=keys.measurements.source)
        return read_load_tests(path, keys.measurements.options())
    assert keys.synthetic is not None
    if not keys.poses_deg or not keys.load:
        raise InputError("synthetic tests need poses_deg and at least one load", STIFFNESS)
    poses, loads = np.deg2rad(keys.poses_deg), [load.options() for load in keys.load]
    return made_load_tests(robot, keys.synthetic.options(), poses.tolist(), loads, keys.options())


def _one_of(keys: Schema | JointStiffness, key: str) -> None:
    if (keys.measurements is None) == (keys.synthetic is None):
        present = "both" if keys.measurements else "neither"
        raise InputError(f"expected one of [measurements] and [synthetic]; found {present}", key)


def _calibration(stiffness: StiffnessStudy) -> CalibrationStudy:
    """The stiffness study as a result of this kind."""
    return CalibrationStudy(
        status=stiffness.status, message=stiffness.message, title=stiffness.title, objective=stiffness.objective,
        checks=stiffness.checks, figures=stiffness.figures, files=stiffness.files,
        machine_files=stiffness.machine_files, synthetic=stiffness.synthetic, notes=stiffness.notes,
        estimate=stiffness.estimate, joint_stiffness=stiffness if stiffness.method else None,
    )  # fmt: skip
