"""Static load tests of kind "calibration": read or made up, with Jacobians from the robot's equations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtmodel.compliance import (
    ArmPoses,
    Compensator,
    StaticTests,
    arm_poses,
    complementary_stiffness,
    synthetic_tests,
)
from gtmodel.lang import Model

from . import calibration_table
from .base import Context, InputError
from .calibration_stiffness_keys import Column, JointStiffness
from .robots import file_of

KEY = "joint_stiffness"
FILE = "load_tests.csv"
HEAD = 3  # line of its first test
UNITS = {"q": "deg", "force": "N", "moment": "N.m", "displacement": "mm", "rotation": "rad", "wrist": "mm"}
SCALE = {"q": 180 / np.pi, "force": 1.0, "moment": 1.0, "displacement": 1e3, "rotation": 1.0, "wrist": 1e3}


@dataclass(frozen=True, eq=False)
class LoadTestData:
    """Tests with the poses that they stand in, the spring on joint 2, what a synthetic file says of itself, and its
    text; the lines of a measured file."""

    poses: ArmPoses
    tests: StaticTests
    spring: Compensator | None
    synthetic: str | None
    text: str | None
    lines: np.ndarray


def data_of(keys: JointStiffness, model: Model, context: Context) -> LoadTestData:
    """Raises InputError with the key of what is wrong."""
    if (keys.measurements is None) == (keys.synthetic is None):
        found = "both" if keys.measurements else "none of them"
        raise InputError(f"expected one of [measurements] and [synthetic]; found {found}", KEY)
    if keys.measurements is not None:
        return _measured(keys, model, context)
    return _made(keys, model)


def _made(keys: JointStiffness, model: Model) -> LoadTestData:
    s = keys.synthetic
    assert s is not None
    if not keys.poses_deg or not keys.load:
        raise InputError("synthetic tests need poses_deg and at least one load", KEY)
    for n, angles in enumerate(keys.poses_deg):
        if len(angles) != 6:
            raise InputError(f"has {len(angles)} numbers; expected 6 joint angles in degrees", f"{KEY}.poses_deg[{n}]")
    if len(s.stiffness_MNm_rad) != 6:
        raise InputError(f"has {len(s.stiffness_MNm_rad)} numbers; expected 6", f"{KEY}.synthetic.stiffness_MNm_rad")
    q = np.repeat(np.deg2rad(keys.poses_deg), len(keys.load), axis=0)
    wrenches = np.tile([[*load.force_N, *load.moment_Nm] for load in keys.load], (len(keys.poses_deg), 1))
    poses, spring = _poses(keys, model, q), _spring(keys)
    sigma, wrist = _noise(keys)
    K_c = _complementary(keys, poses, wrenches, spring)
    planned = poses.tests(wrenches, sigma=sigma, wrist_sigma=wrist if s.wrist_target else None, K_c=K_c)
    c = 1e-6 / np.array(s.stiffness_MNm_rad)
    tilt = s.tilt * c if s.tilt else None
    rng = np.random.default_rng(s.seed)
    tests = synthetic_tests(planned, c, rng, tilt=tilt, origins=poses.origins, point=poses.T)
    tilted = f", bearings tilt by {s.tilt:g} times the joint's compliance" if s.tilt else ""
    n = keys.noise
    note = f"seed {s.seed}, noise {n.position_m:g} m and {n.rotation_rad:g} rad{tilted}"
    return LoadTestData(poses, tests, spring, note, _text(poses, tests, note), HEAD + np.arange(len(q)))


def _measured(keys: JointStiffness, model: Model, context: Context) -> LoadTestData:
    m = keys.measurements
    assert m is not None
    for name in ("poses_deg", "load"):
        if getattr(keys, name) is not None:
            raise InputError("belongs to synthetic tests; measured ones have it in their file", f"{KEY}.{name}")
    path = file_of(m.file, context)
    if path is None:
        raise InputError(f"there is no file '{m.file}' in {context.folder} or here", f"{KEY}.measurements.file")
    context.take(f"{KEY}.measurements.file", path)
    given: dict[str, Column] = {n: c for n in UNITS if (c := getattr(m, n)) is not None}
    try:
        table = calibration_table.read(path, {n: (c.column, c.unit) for n, c in given.items()})
    except InputError as error:
        at = error.key.removeprefix("signals.") if error.key else "file"
        raise InputError(error.sentence, f"{KEY}.measurements.{at}") from error
    for name, rows in table.values.items():
        wanted = 6 if name == "q" else 3
        if rows.shape[1] != wanted:
            raise InputError(f"has {rows.shape[1]} columns; expected {wanted}", f"{KEY}.measurements.{name}.column")
    v = table.values
    poses, spring = _poses(keys, model, v["q"]), _spring(keys)
    wrenches = np.hstack([v["force"], v.get("moment", np.zeros_like(v["force"]))])
    sigma, wrist = _noise(keys)
    K_c = _complementary(keys, poses, wrenches, spring)
    plan = poses.tests(wrenches, sigma=sigma, wrist_sigma=wrist if "wrist" in v else None, K_c=K_c)
    moved = np.hstack([v["displacement"], v["rotation"]])
    tests = StaticTests(
        plan.J, plan.J_wrist, wrenches, moved, plan.covariance, plan.lever, v.get("wrist"), plan.wrist_covariance, K_c
    )
    return LoadTestData(poses, tests, spring, table.synthetic, None, table.lines)


def _poses(keys: JointStiffness, model: Model, q: np.ndarray) -> ArmPoses:
    try:
        return arm_poses(model, q, keys.tool_m)
    except ValueError as error:
        raise InputError(f"expected a serial arm such as kr500; {error}", "robot") from error


def _spring(keys: JointStiffness) -> Compensator | None:
    s = keys.compensator
    return None if s is None else Compensator(s.base_m, s.lever_m, s.rate_N_m, s.rest_m, float(np.deg2rad(s.angle_deg)))


def _noise(keys: JointStiffness) -> tuple[list[float], float]:
    return [keys.noise.position_m] * 3 + [keys.noise.rotation_rad] * 3, keys.noise.position_m


def _complementary(
    keys: JointStiffness, poses: ArmPoses, wrenches: np.ndarray, spring: Compensator | None
) -> np.ndarray | None:
    if not keys.complementary and spring is None:
        return None
    n, k = poses.q.shape
    K_c = complementary_stiffness(poses.J, wrenches) if keys.complementary else np.zeros((n, k, k))
    return K_c if spring is None else spring.added(K_c, poses.q)


def _text(poses: ArmPoses, tests: StaticTests, note: str) -> str:
    """The tests as a file that can be measurements."""
    parts = {
        "q": poses.q, "force": tests.wrench[:, :3], "moment": tests.wrench[:, 3:],
        "displacement": tests.displacement[:, :3], "rotation": tests.displacement[:, 3:],
    }  # fmt: skip
    if tests.wrist_displacement is not None:
        parts["wrist"] = tests.wrist_displacement
    head = [f"{name}[{k}] [{UNITS[name]}]" for name, x in parts.items() for k in range(x.shape[1])]
    table = np.hstack([SCALE[name] * x for name, x in parts.items()])
    rows = [",".join(f"{x:.12g}" for x in row) for row in table]
    return "\n".join([f"# synthetic: {note}", ",".join(head), *rows]) + "\n"
