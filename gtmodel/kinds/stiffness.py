"""Kind "stiffness": joint compliances of a serial arm from static load tests, by both methods."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
import tomli_w
from pydantic import Field, NonNegativeFloat, PositiveFloat

from gtmodel.compliance import (
    ArmPoses,
    StaticTests,
    StiffnessFit,
    arm_poses,
    complementary_stiffness,
    complete_pose,
    decoupled,
    select,
    softest_and_stiffest,
    synthetic_tests,
    translational_compliance,
)
from gtmodel.results import SolveStatus

from .base import Check, Context, InputError, Outcome, Row, Section
from .robot_keys import RobotProblem

NAME = "stiffness"

VALUES = {
    "compliance_rad_Nm": "by joint, of the chosen method",
    "stiffness_MNm_rad": "their inverses",
    "stiffness_interval_MNm_rad": "95 % intervals by joint; null: no upper end",
    "other_method_MNm_rad": "stiffness by joint of the other method",
    "agree": "whether the intervals of both methods overlap, by joint",
    "chi_squared_p": "of the residuals against the stated noise; small: the model lacks an effect",
    "adequacy": "the same in words",
    "observability_O1": "of the tests, compliances in units of themselves",
    "best_tests": "numbers of the tests that tell most, best first, from 0",
    "softest_N_m": "stiffness of the tool along its softest direction, by pose",
    "stiffest_N_m": "along its stiffest direction, by pose",
    "synthetic": "seed and noise of made-up tests; null for measured ones",
}

WITHIN = 0.1  # of synthetic tests: largest relative error of a compliance
NOTE = (
    "both methods agree without model error; the printed differences (Cvitanic 2021, Tables 1, 2) do not follow from it"
)


class Load(Section):
    """One load, world coordinates, hung on the tool in every pose."""

    force_N: list[float] = Field(min_length=3, max_length=3, description="at the tool centre point")
    moment_Nm: list[float] = Field(default=[0.0] * 3, min_length=3, max_length=3, description="about it")


class Noise(Section):
    """Standard deviations of the measured displacements."""

    position_m: PositiveFloat = Field(default=2e-5, description="of each coordinate, at tool and wrist centre")
    rotation_rad: PositiveFloat = Field(default=1e-4, description="of each rotation; 20 um on a base of 0.25 m")


class Measured(Section):
    """Displacements by test: all loads of the first pose, then of the second. World coordinates."""

    displacement_m: list[list[float]] = Field(description="of the tool centre point, three numbers each")
    rotation_rad: list[list[float]] = Field(description="rotation vector of the tool, three numbers each")
    wrist_m: list[list[float]] | None = Field(default=None, description="of a target at the wrist centre")


class Synthetic(Section):
    """Tests made up from known stiffness, to see what identification gives back."""

    stiffness_MNm_rad: list[PositiveFloat] = Field(description="by joint")
    tilt: NonNegativeFloat = Field(
        default=0.0, description="compliance of bearings across their axes, in units of the joint's; the model lacks it"
    )
    wrist_target: bool = Field(default=True, description="whether the wrist centre has a target of its own")
    seed: int = Field(description="of the noise")


class Schema(RobotProblem):
    """Joint stiffness from static load tests. One of [measured] and [synthetic] gives the displacements."""

    poses_deg: list[list[float]] = Field(min_length=1, description="joint angles of each pose")
    tool_m: list[float] = Field(
        default=[0.0] * 3, min_length=3, max_length=3, description="tool centre point in flange coordinates"
    )
    load: list[Load] = Field(min_length=1, description="one table for each load")
    method: Literal["complete_pose", "decoupled"] = Field(default="complete_pose", description="the one reported first")
    complementary: bool = Field(
        default=False, description="count the loads' complementary stiffness; with complete_pose only"
    )
    select: int = Field(default=10, ge=1, description="how many of the best tests are listed")
    noise: Noise = Noise()
    measured: Measured | None = Field(default=None, description="measured displacements")
    synthetic: Synthetic | None = Field(default=None, description="made-up displacements")


def solve(problem: Schema, context: Context) -> Outcome:
    """Jacobians from the robot's equations, then both methods."""
    context.progress("kinematics", 0.1)
    poses = _poses(problem, context)
    tests = _tests(problem, poses)
    if context.interrupted():
        return Outcome(status=SolveStatus.INTERRUPTED, message="stopped before the fit")
    try:
        fits = {"complete_pose": complete_pose(tests)}
        if not problem.complementary:
            fits["decoupled"] = decoupled(tests)
        elif problem.method == "decoupled":
            raise InputError("takes no complementary stiffness; use complete_pose", "method")
        best = select(tests, min(problem.select, len(tests.J)), fits[problem.method].compliance)
    except ValueError as error:
        raise error if isinstance(error, InputError) else InputError(str(error), "load") from error
    return _outcome(problem, poses, tests, fits, best.chosen)


def explain(problem: Schema, context: Context) -> str:
    """What will be fitted to how many rows."""
    n = len(problem.poses_deg) * len(problem.load)
    return "\n".join(
        [
            f"{problem.title or NAME}: {len(problem.poses_deg)} poses under {len(problem.load)} loads, {n} tests",
            "dX = J diag(J'F) c with c = 1/K, linear in the compliances (Cvitanic 2021, eqs. (2), (3), (6))",
            f"complete pose: {6 * n} rows; decoupled: {3 * n} rows of the wrist centre, then {3 * n} of the tool",
            NOTE,
        ]
    )


def _poses(problem: Schema, context: Context) -> ArmPoses:
    given = [k for k in ("measured", "synthetic") if getattr(problem, k) is not None]
    if len(given) != 1:
        raise InputError("expected one of [measured] and [synthetic]", given[-1] if given else "measured")
    for n, angles in enumerate(problem.poses_deg):
        if len(angles) != 6:
            raise InputError(f"has {len(angles)} numbers; expected 6 joint angles in degrees", f"poses_deg[{n}]")
    s = problem.synthetic
    if s is not None and len(s.stiffness_MNm_rad) != 6:
        raise InputError(f"has {len(s.stiffness_MNm_rad)} numbers; expected 6", "synthetic.stiffness_MNm_rad")
    model = problem.model(context)
    try:
        q = np.repeat(np.deg2rad(problem.poses_deg), len(problem.load), axis=0)
        return arm_poses(model, q, problem.tool_m)
    except ValueError as error:
        raise InputError(f"expected a serial arm such as kr500; {error}", "robot") from error


def _tests(problem: Schema, poses: ArmPoses) -> StaticTests:
    s, m, noise = problem.synthetic, problem.measured, problem.noise
    wrenches = np.tile([[*load.force_N, *load.moment_Nm] for load in problem.load], (len(problem.poses_deg), 1))
    K_c = complementary_stiffness(poses.J, wrenches) if problem.complementary else None
    target = s.wrist_target if s is not None else m is not None and m.wrist_m is not None
    sigma = [noise.position_m] * 3 + [noise.rotation_rad] * 3
    planned = poses.tests(wrenches, sigma=sigma, wrist_sigma=noise.position_m if target else None, K_c=K_c)
    if s is not None:
        c = 1e-6 / np.array(s.stiffness_MNm_rad)
        tilt = s.tilt * c if s.tilt else None
        rng = np.random.default_rng(s.seed)
        return synthetic_tests(planned, c, rng, tilt=tilt, origins=poses.origins, point=poses.T)
    assert m is not None
    keys = {"displacement_m": m.displacement_m, "rotation_rad": m.rotation_rad, "wrist_m": m.wrist_m}
    tables = {}
    for key, rows in keys.items():
        if rows is None:
            continue
        if len(rows) != len(poses.q) or any(len(row) != 3 for row in rows):
            raise InputError(f"expected {len(poses.q)} rows of 3 numbers, one per pose and load", f"measured.{key}")
        tables[key] = np.array(rows)
    moved = np.hstack([tables["displacement_m"], tables["rotation_rad"]])
    return StaticTests(
        planned.J, planned.J_wrist, wrenches, moved, planned.covariance, planned.lever, tables.get("wrist_m"),
        planned.wrist_covariance, K_c,
    )  # fmt: skip


def _outcome(
    problem: Schema, poses: ArmPoses, tests: StaticTests, fits: dict[str, StiffnessFit], best: tuple[int, ...]
) -> Outcome:
    fit = fits[problem.method]
    other = next((f for name, f in fits.items() if name != problem.method), None)
    intervals = [np.array(fit.interval(j)) / 1e6 for j in range(6)]
    overlap = None if other is None else [_overlap(fit.interval(j), other.interval(j)) for j in range(6)]
    stiffness, _ = softest_and_stiffest(translational_compliance(poses.J, fit.compliance)[:: len(problem.load)])
    s = problem.synthetic
    tilted = f", bearings tilt by {s.tilt:g} times the joint's compliance" if s and s.tilt else ""
    noise = problem.noise
    note = s and f"seed {s.seed}, noise {noise.position_m:g} m and {noise.rotation_rad:g} rad{tilted}"
    values: dict[str, Any] = {
        "compliance_rad_Nm": fit.compliance,
        "stiffness_MNm_rad": fit.stiffness / 1e6,
        "stiffness_interval_MNm_rad": [[x if np.isfinite(x) else None for x in i.tolist()] for i in intervals],
        "other_method_MNm_rad": None if other is None else other.stiffness / 1e6,
        "agree": overlap,
        "chi_squared_p": fit.adequacy.p,
        "adequacy": fit.adequacy.sentence,
        "observability_O1": fit.told.indices.o1,
        "best_tests": list(best),
        "softest_N_m": stiffness[:, 0],
        "stiffest_N_m": stiffness[:, -1],
        "synthetic": note,
    }
    rows = [
        *(Row(f"joint {j + 1}", f"{fit.stiffness[j] / 1e6:.4g} ({i[0]:.4g} .. {i[1]:.4g})", "MN.m/rad")
          for j, i in enumerate(intervals)),
        *([] if other is None else [Row(other.method, _list(other.stiffness / 1e6), "MN.m/rad")]),
        Row("residuals", fit.adequacy.sentence),
        Row("softest direction of the tool, by pose", _list(stiffness[:, 0] / 1e6), "N/um"),
        Row("tests that tell most", ", ".join(map(str, best))),
        Row("said in print", NOTE),
    ]  # fmt: skip
    if note:
        rows.append(Row("SYNTHETIC", note))
    checks = {"chi_squared_p": Check(fit.adequacy.p, None, fit.adequacy.passed)}
    if s is not None:
        error = float(np.abs(fit.compliance * 1e6 * np.array(s.stiffness_MNm_rad) - 1).max())
        checks["compliance_error"] = Check(error, WITHIN, error <= WITHIN)
    comment = f"# synthetic: {note}\n" if note else ""
    return Outcome(
        status=SolveStatus.SOLVED,
        message=f"{len(tests.J)} tests, {fit.method}",
        checks=checks,
        values=values,
        rows=rows,
        figures={"stiffness": lambda: _figure(problem, fits, note)},
        files={"parameters.toml": comment + tomli_w.dumps({"stiffness_MNm_rad": (fit.stiffness / 1e6).tolist()})},
    )


def _figure(problem: Schema, fits: dict[str, StiffnessFit], note: str | None) -> Any:
    from gtmodel.plot.stiffness import stiffness_figure

    found = [(f.method, f.stiffness, np.array([f.interval(j) for j in range(6)])) for f in fits.values()]
    true = None if problem.synthetic is None else 1e6 * np.array(problem.synthetic.stiffness_MNm_rad)
    title = problem.title or "joint stiffness"
    return stiffness_figure(found, true, title=f"{title}\n(synthetic: {note})" if note else title)


def _list(numbers: np.ndarray) -> str:
    return ", ".join(f"{x:.4g}" for x in numbers)


def _overlap(a: tuple[float, float], b: tuple[float, float]) -> bool:
    return max(a[0], b[0]) <= min(a[1], b[1])


__all__ = ["NAME", "VALUES", "Schema", "explain", "solve"]
