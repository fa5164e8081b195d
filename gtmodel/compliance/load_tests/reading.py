"""Static load tests for a study: read from a file, or synthetic."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from ...lang import Model
from ...measurements import signal_table
from ...results import ArgumentError
from ...results.disk import path_of
from ..cartesian import ArmPoses, arm_poses
from ..joint_stiffness import ARM, Compensator, complementary_stiffness, without_noise
from ..options import Load
from ..static_tests import StaticTests
from .options import LoadTests, Setup, SyntheticTests


def synthetic_tests(
    tests: StaticTests,
    compliance: ArrayLike,
    rng: np.random.Generator | None,
    *,
    tilt: ArrayLike | None = None,
    origins: ArrayLike | None = None,
    point: ArrayLike | None = None,
) -> StaticTests:
    """Return the tests with displacements due to joint compliances (k,) [rad/(N.m)], and noise from `rng`.

    No noise if `rng` is None. `tilt` (k,) [rad/(N.m)]: compliance of each bearing about both directions across its
    axis, at `origins` (n, k, 3), with the tool at `point` (n, 3) [m]; the fitted model lacks it. Raises ValueError for
    a tilt without these.

    >>> poses = gt.compliance.arm_poses(gt.robots.kr500(), [[0.3, -0.9, 2.0, 0.2, -1.1, -0.1]])
    >>> planned = poses.tests([[0, 0, -4000.0, 0, 0, 0]], sigma=[2e-5] * 3 + [1e-4] * 3)
    >>> tests = gt.compliance.synthetic_tests(planned, [1e-6] * 6, rng=None)
    >>> np.allclose(tests.displacement[0], poses.J[0] @ (1e-6 * planned.torque[0]))
    True
    """
    exact = without_noise(tests, np.asarray(compliance, float))
    displacement, wrist = exact.displacement.copy(), exact.wrist_displacement
    wrist = None if wrist is None else wrist.copy()
    if tilt is not None:
        if origins is None or point is None:
            raise ValueError("tilt needs the origins of the joints and the point of the tool; give both")
        by_tilt, wrist_by_tilt = _tilted(tests, *(np.asarray(x, float) for x in (tilt, origins, point)))
        displacement += by_tilt
        wrist = None if wrist is None else wrist + wrist_by_tilt
    if rng is not None:
        displacement += _noise(tests.covariance, rng)
        if wrist is not None and tests.wrist_covariance is not None:
            wrist += _noise(tests.wrist_covariance, rng)
    return replace(exact, displacement=displacement, wrist_displacement=wrist)


def _tilted(t: StaticTests, tilt: np.ndarray, origins: np.ndarray, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Displacements (n, 6) of the tool and (n, 3) of the wrist centre due to tilting bearings."""
    arms = point[:, None, :] - origins  # (n, k, 3)
    axes = np.moveaxis(t.J[:, 3:], 1, 2)
    moments = t.wrench[:, None, 3:] + np.cross(arms, t.wrench[:, None, :3])
    across = moments - np.sum(moments * axes, axis=2, keepdims=True) * axes
    turns = tilt[:, None] * across
    # the target at the wrist centre is attached to the arm, before the bearings of the wrist
    at_wrist = np.cross(turns, arms + t.lever[:, None, :])[:, :ARM]
    return np.concatenate([np.cross(turns, arms).sum(axis=1), turns.sum(axis=1)], axis=1), at_wrist.sum(axis=1)


def _noise(covariance: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    L = np.linalg.cholesky(covariance)
    return np.einsum("nij,nj->ni", L, rng.standard_normal(covariance.shape[:2]))


Array = np.ndarray
HEAD = 3  # line of the first synthetic test
UNITS = {"q": "deg", "force": "N", "moment": "N.m", "displacement": "mm", "rotation": "rad", "wrist": "mm"}
SCALE = {"q": 180 / np.pi, "force": 1.0, "moment": 1.0, "displacement": 1e3, "rotation": 1.0, "wrist": 1e3}


@dataclass(frozen=True, eq=False)
class MeasuredTests:
    """n load tests in world coordinates: joint angles, loads, displacements.

    q: (n, 6) joint angles [rad]. wrench: (n, 6) on the tool centre point [N, N.m]. displacement: (n, 6) of the tool
        centre point, loaded less unloaded [m, rad]. wrist: (n, 3) displacement of a target at the wrist centre [m]; if
        None, it follows from the pose.
    lines: (n,) of their file; numbered from 1 if left out. synthetic: seed and noise of synthetic tests. truth: their
        joint stiffness [N.m/rad].
    """

    q: Array
    wrench: Array
    displacement: Array
    wrist: Array | None = None
    lines: Array | None = None
    synthetic: str | None = None
    truth: Sequence[float] | None = None

    @property
    def numbered(self) -> Array:
        """Lines, or numbers from 1."""
        return np.arange(1, len(self.q) + 1) if self.lines is None else self.lines

    @property
    def text(self) -> str:
        """The tests as CSV text that `read_load_tests` reads."""
        parts = {
            "q": self.q, "force": self.wrench[:, :3], "moment": self.wrench[:, 3:],
            "displacement": self.displacement[:, :3], "rotation": self.displacement[:, 3:],
        }  # fmt: skip
        if self.wrist is not None:
            parts["wrist"] = self.wrist
        head = [f"{name}[{k}] [{UNITS[name]}]" for name, x in parts.items() for k in range(x.shape[1])]
        table = np.hstack([SCALE[name] * x for name, x in parts.items()])
        rows = [",".join(f"{x:.12g}" for x in row) for row in table]
        note = [f"# synthetic: {self.synthetic}"] if self.synthetic else []
        return "\n".join([*note, ",".join(head), *rows]) + "\n"


def read_load_tests(path: Path | str, tests: LoadTests) -> MeasuredTests:
    r"""Read tests from a CSV file, one per row, in SI units.

    Raises ArgumentError with the line of a wrong cell, or with the argument "tests.q.column" for a wrong column.

    >>> from pathlib import Path
    >>> from gtmodel.compliance import LoadTestColumn, LoadTests, read_load_tests
    >>> head = [f"{name}[{i}]" for name, n in (("q", 6), ("F", 3), ("d", 3), ("r", 3)) for i in range(n)]
    >>> _ = Path("tests.csv").write_text(",".join(head) + "\n" + "90," * 6 + "0,0,-4000,0,0,-2.5,0,0,0.001\n")
    >>> tests = LoadTests(
    ...     q=LoadTestColumn("q", "deg"), force=LoadTestColumn("F", "N"),
    ...     displacement=LoadTestColumn("d", "mm"), rotation=LoadTestColumn("r", "rad"),
    ... )
    >>> read_load_tests("tests.csv", tests).displacement  # m, rad
    array([[ 0.    ,  0.    , -0.0025,  0.    ,  0.    ,  0.001 ]])
    """
    columns = {n: (c.column, c.unit) for n in UNITS if (c := getattr(tests, n)) is not None}
    try:
        table = signal_table.read(path_of(path), columns, leave_out=tests.leave_out)
    except ArgumentError as error:
        argument = error.argument.removeprefix("signals.") if error.argument else "file"
        raise ArgumentError(error.message, f"tests.{argument}") from error
    for name, rows in table.values.items():
        size = 6 if name == "q" else 3
        if rows.shape[1] != size:
            raise ArgumentError(f"has {rows.shape[1]} columns; expected {size}", f"tests.{name}.column")
    v = table.values
    wrench = np.hstack([v["force"], v.get("moment", np.zeros_like(v["force"]))])
    displacement = np.hstack([v["displacement"], v["rotation"]])
    return MeasuredTests(v["q"], wrench, displacement, v.get("wrist"), table.lines, table.synthetic)


def made_load_tests(
    robot: Model, truth: SyntheticTests, poses: Sequence[Sequence[float]], loads: Sequence[Load], setup: Setup
) -> MeasuredTests:
    """Return synthetic tests of an arm with known stiffness: every load in each of the poses [rad].

    Raises ArgumentError.

    >>> from gtmodel.compliance import Load, Setup, SyntheticTests, made_load_tests
    >>> truth = SyntheticTests(stiffness=[2e6] * 6, seed=1)
    >>> loads = [Load([2000.0, 0, 0]), Load([0, 0, -4000.0])]
    >>> tests = made_load_tests(gt.robots.kr500(), truth, [[0.3, -0.9, 2.0, 0.2, -1.1, -0.1]], loads, Setup())
    >>> tests.displacement.shape, tests.synthetic
    ((2, 6), 'seed 1, noise 2e-05 m and 0.0001 rad')
    """
    if not len(poses) or not loads:
        raise ArgumentError("expected at least one pose and one load", "poses" if not len(poses) else "load")
    if len(truth.stiffness) != 6:
        raise ArgumentError(f"has {len(truth.stiffness)} numbers; expected 6", "truth.stiffness")
    q = np.repeat(np.asarray(poses, float), len(loads), axis=0)
    wrench = np.tile([[*load.force, *load.moment] for load in loads], (len(poses), 1))
    arm, planned, _ = static_tests(robot, MeasuredTests(q, wrench, np.zeros((len(q), 6))), setup, truth.wrist_target)
    c = 1e-6 / (np.array(truth.stiffness) / 1e6)
    tilt = truth.tilt * c if truth.tilt else None
    rng = np.random.default_rng(truth.seed)
    tests = synthetic_tests(planned, c, rng, tilt=tilt, origins=arm.origins, point=arm.T)
    tilted = f", bearings tilt by {truth.tilt:g} times the joint's compliance" if truth.tilt else ""
    note = f"seed {truth.seed}, noise {setup.noise.position:g} m and {setup.noise.rotation:g} rad{tilted}"
    lines = HEAD + np.arange(len(q))
    return MeasuredTests(q, wrench, tests.displacement, tests.wrist_displacement, lines, note, truth.stiffness)


def static_tests(
    robot: Model, tests: MeasuredTests, setup: Setup, wrist_target: bool | None = None
) -> tuple[ArmPoses, StaticTests, Compensator | None]:
    """The arm's poses, the tests with Jacobians, and the spring on joint 2. Raises ArgumentError."""
    try:
        poses = arm_poses(robot, tests.q, setup.tool)
    except ValueError as error:
        raise ArgumentError(f"expected a serial arm such as kr500; {error}", "robot") from error
    c, noise = setup.compensator, setup.noise
    spring = None if c is None else Compensator(c.base, c.lever, c.rate, c.rest, c.angle)
    K_c = _complementary(setup, poses, tests.wrench, spring)
    target = tests.wrist is not None if wrist_target is None else wrist_target
    sigma = [noise.position] * 3 + [noise.rotation] * 3
    plan = poses.tests(tests.wrench, sigma=sigma, wrist_sigma=noise.position if target else None, K_c=K_c)
    if tests.wrist is None and target:
        return poses, plan, spring
    return poses, plan.with_(displacement=tests.displacement, wrist_displacement=tests.wrist), spring


def _complementary(setup: Setup, poses: ArmPoses, wrench: Array, spring: Compensator | None) -> Array | None:
    if not setup.complementary and spring is None:
        return None
    n, k = poses.q.shape
    K_c = complementary_stiffness(poses.J, wrench) if setup.complementary else np.zeros((n, k, k))
    return K_c if spring is None else spring.added(K_c, poses.q)
