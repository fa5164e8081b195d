"""Kind "modes": all assembly modes of six links, with a certificate that none is missing."""

from __future__ import annotations

from functools import partial
from typing import Annotated, Any

import numpy as np
from pydantic import Field, PositiveFloat

from gtmodel.kinematics.assembly_modes import assembly_modes_batch
from gtmodel.problem_files import robots
from gtmodel.problem_files.base import Context, InputError, Outcome, Problem, Section
from gtmodel.problem_files.robot_file import Points
from gtmodel.results import SolveStatus

from . import hand_poses, platform_draw, six_links
from .commanded_mode import Judged
from .hand_poses import Pose
from .modes_report import outcome
from .six_links import Hands

NAME = "modes"

VALUES = {
    "poses": "number of poses or platforms",
    "whole": "how many of them have a whole set: every finite mode is known, and none is multiple",
    "found": "finite modes found over the complex numbers, least over the poses",
    "distinct": "those of them outside the radius of uniqueness of every other, least over the poses",
    "certified": "those that pass the Newton-Kantorovich test, least over the poses",
    "real": "modes with a real pose, least over the poses",
    "real_most": "the same, most over the poses",
    "real_counts": "number of poses by their number of real modes",
    "conjugate_pairs": "pairs of complex conjugate modes, least over the poses",
    "infinite": "paths that ended at infinity, most over the poses",
    "multiple": "paths that ended in singular modes, most over the poses",
    "lost": "paths that ended nowhere, most over the poses",
    "retries": "paths tracked again from another start system, sum over the poses",
    "worst_residual": "largest scaled equation at a mode found; 1 is the size of the terms",
    "worst_leg_error": "largest error of a leg length at a real mode, by the legs as given, over the platform's size",
    "nearest_mm": "distance of the plate joints' centroid between the two real modes nearest each other, over all "
    "poses; null with fewer than two. Near means least root of (distance / size)^2 + angle^2",
    "nearest_deg": "the angle between these two",
    "commanded": "number of the commanded mode among the real ones, from 1; null for several poses, and where no pose "
    "was commanded or Newton found none",
    "commanded_nearest_mm": "distance of the nearest other real mode from the commanded one, least over the poses",
    "commanded_nearest_deg": "the angle between them",
    "modes": "real modes of an only pose: mode (from 1), tcp_m, quaternion (scalar first), nearest_mode, nearest_mm, "
    "nearest_deg, commanded; empty for several",
    "each": "for each pose: pose (from 1), status, message, the numbers above, q_m and q_rad, the commanded tcp_m and "
    "quaternion, and its modes",
}

Lengths = Annotated[list[PositiveFloat], Field(min_length=6, max_length=6)]


class Platform(Section):
    """Six legs without a robot."""

    A_m: Points = Field(description="joints at the base or at the carts")
    B_m: Points = Field(description="plate joints in plate coordinates")
    L_m: Lengths = Field(description="lengths of the legs, not their squares")


class Draw(Section):
    """Random platforms, synthetic: base joints in a cube of side 2 m, plate joints in one of side 1 m."""

    platforms: int = Field(default=20, ge=1, le=100000, description="how many")
    seed: int = Field(default=1, ge=0, description="of the random numbers")


class Schema(Problem):
    """Assembly modes of a robot with six links, of a platform given by its joints, or of random ones.

    Give robot, platform or draw; with a robot a pose (its home if left out) or poses, with a platform perhaps the
    pose that is commanded.
    """

    robot: str | None = Field(default=None, description="catalogue name or TOML robot file, with six links")
    parameters: dict[str, Any] = Field(
        default={}, description="modifiers of the model, by its own parameter names, in SI"
    )
    pose: Pose | None = Field(default=None)
    poses: str | None = Field(
        default=None,
        description="CSV file of many poses; columns q1_m, q2_m, q3_m, with q4_deg ... or q4_rad ... for an F1, or "
        "x_m, y_m, z_m, with alpha_deg, beta_deg, gamma_deg (z, y, z) or e0 ... e3",
    )
    platform: Platform | None = Field(default=None)
    draw: Draw | None = Field(default=None)


def solve(problem: Schema, context: Context) -> Outcome:
    """Find all modes of every pose, and the commanded one among them."""
    if context.start is not None:
        raise InputError("--start: the modes are found from stored start systems; leave it out")
    hands = _hands(problem, context)
    if context.interrupted():
        return Outcome(status=SolveStatus.INTERRUPTED, message=SolveStatus.INTERRUPTED.sentence)

    def progress(done: int, poses: int) -> bool:
        context.progress("tracking 40 paths per pose", done / poses, {"poses": float(done)})
        return context.interrupted()

    progress(0, len(hands))
    results = assembly_modes_batch(hands.A, hands.B, hands.L, progress=progress)
    judged = Judged.of(hands, results)
    refused = judged.refused()
    if len(hands) == 1 and refused:
        raise InputError(
            refused[0], next(key for key in ("platform", "poses", "pose", "robot") if getattr(problem, key))
        )
    return outcome(judged).with_(figures=_figures(problem, judged))


def explain(problem: Schema, context: Context) -> str:
    """The legs of the first pose, the pose commanded, and the method."""
    hands = _hands(problem, context)
    lines = [f"{problem.title or 'assembly modes'}: {_about(problem)}, {len(hands)} pose{'s' * (len(hands) > 1)}"]
    if hands.q.shape[1]:
        lines.append(f"  coordinates {_list(hands.q[0])} (m, rad)")
    for k in range(six_links.LINKS):
        lines.append(
            f"  leg {k + 1}: A = ({_list(hands.A[0, k])}) m, B = ({_list(hands.B[0, k])}) m, L = {hands.L[0, k]:.6g} m"
        )
    if np.isfinite(hands.T[0]).all():
        lines.append(f"  commanded: T = ({_list(hands.T[0])}) m")
    lines.append(
        "  method: 40 paths from a stored complex platform in Study coordinates, certified by Newton-Kantorovich"
    )
    return "\n".join(lines)


def _about(problem: Schema) -> str:
    if problem.draw is not None:
        return f"synthetic platforms, seed {problem.draw.seed}"
    return "a platform on six legs" if problem.platform is not None else f"assembly modes of {problem.robot}"


def _hands(problem: Schema, context: Context) -> Hands:
    """The legs that the problem is about. Raises InputError."""
    given = [key for key in ("robot", "platform", "draw") if getattr(problem, key) is not None]
    if len(given) != 1:
        raise InputError(f"give one of robot, platform and draw; found {' and '.join(given) or 'none'}", *given[1:2])
    if problem.parameters and problem.robot is None:
        raise InputError("are those of a robot; leave them out", "parameters")
    if problem.poses is not None and problem.robot is None:
        raise InputError("are those of a robot; leave them out", "poses")
    if problem.poses is not None and problem.pose is not None:
        raise InputError("give either pose or poses", "poses")
    if problem.draw is not None:
        if problem.pose is not None:
            raise InputError("random platforms are in random poses; leave it out", "pose")
        return platform_draw.draw(problem.draw.platforms, problem.draw.seed)
    if problem.platform is not None:
        return _bare(problem.platform, problem.pose)
    assert problem.robot is not None
    model = robots.resolve(problem.robot, context, parameters=problem.parameters)
    robot = six_links.six_links_of(model, problem.robot)
    if problem.poses is not None:
        return hand_poses.hands_of(robot, hand_poses.of_file(problem.poses, context), "poses")
    return hand_poses.hands_of(robot, [problem.pose or Pose()], "pose")


def _bare(platform: Platform, pose: Pose | None) -> Hands:
    T = e = None
    if pose is not None:
        given = pose.given()
        foreign = [key for key in given if key.startswith("q_")]
        if foreign:
            raise InputError("a platform has no carts; give tcp_m with quaternion or zyz_deg", f"pose.{foreign[0]}")
        if "tcp_m" not in given or len(given) != 2:
            raise InputError("the commanded pose of a platform is tcp_m with either quaternion or zyz_deg", "pose")
        T, e = np.array(pose.tcp_m), hand_poses.orientations([pose], np.zeros(4), "pose")
    return six_links.bare(np.array(platform.A_m), np.array(platform.B_m), np.array(platform.L_m), T, e)


def _list(x: np.ndarray) -> str:
    return ", ".join(f"{v:.6g}" for v in x)


def _figures(problem: Schema, judged: Judged) -> dict[str, Any]:
    if len(judged.hands) == 1:
        return {"modes": partial(_panels, problem, judged)}
    return {"real_modes": partial(_statistics, problem, judged)}


def _panels(problem: Schema, judged: Judged) -> Any:
    from gtmodel.plot.assembly_modes import modes_figure

    hands, modes = judged.hands, judged.results[0]
    return modes_figure(
        hands.A[0], hands.B[0], modes.R, modes.T,
        commanded=judged.commanded[0], carts=hands.carts, directions=hands.directions,
        title=problem.title or _about(problem),
    )  # fmt: skip


def _statistics(problem: Schema, judged: Judged) -> Any:
    from gtmodel.plot.assembly_modes import real_counts_figure

    title = problem.title or _about(problem)
    if problem.draw is not None and "synthetic" not in title:
        title += f" ({_about(problem)})"
    done = [i for i in range(len(judged.hands)) if judged.done(i)]
    near = np.array([judged.commanded_nearest(i) for i in done]).reshape(-1, 2)
    return real_counts_figure([judged.results[i].certificate.real for i in done], near, title=title)
