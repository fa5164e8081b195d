"""Kind "modes": all assembly modes of six links, with a certificate of completeness."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Any

import numpy as np
from pydantic import Field, PositiveFloat

from gtmodel import problem_files
from gtmodel.kinematics import assembly_modes
from gtmodel.kinematics.assembly_modes.options import CommandedPose
from gtmodel.problem_files.base import Call, Context, FileSection, InputError, Problem
from gtmodel.problem_files.from_options import Made, made_from

RESULT = "gtmodel.kinematics.ModesStudy"

Three = Annotated[list[float], Field(min_length=3, max_length=3)]
Points = Annotated[list[Three], Field(min_length=6, max_length=6)]
Lengths = Annotated[list[PositiveFloat], Field(min_length=6, max_length=6)]


@made_from(CommandedPose, "axes")
class PoseSection(Made):
    """Positions of carts and rotary axes, or a tool pose."""

    q_rad: Three | None = Field(default=None, description="rotary axes q4, q5, q6 of an F1; zero if left out")
    q_deg: Three | None = Field(default=None, description="rotary axes q4, q5, q6 of an F1, in degrees")

    def options(self) -> CommandedPose:
        """Return the pose in SI. Raises InputError for angles in both units."""
        if self.q_rad is not None and self.q_deg is not None:
            raise InputError("give either q_rad or q_deg", "pose")
        axes = self.q_rad if self.q_deg is None else np.radians(self.q_deg).tolist()
        return CommandedPose(axes=axes, **self.given())


class Platform(FileSection):
    """Six legs without a robot."""

    A_m: Points = Field(description="joints at the base or at the carts")
    B_m: Points = Field(description="plate joints in plate coordinates")
    L_m: Lengths = Field(description="lengths of the legs, not their squares")


class Draw(FileSection):
    """Random synthetic platforms: base joints in a cube of side 2 m, plate joints in a cube of side 1 m."""

    platforms: int = Field(default=20, ge=1, le=100000, description="number of platforms")
    seed: int = Field(default=1, ge=0, description="seed of the random numbers")


class Schema(Problem):
    """Assembly modes of a robot with six links, of a platform given by its joints, or of random platforms.

    Give robot, platform or draw. A robot needs a pose (its home if left out) or poses; for a platform you may give the
    commanded pose.
    """

    robot: str | None = Field(default=None, description="catalogue name or TOML robot file, with six links")
    parameters: dict[str, Any] = Field(default={}, description="values of the model's parameters by name, in SI")
    pose: PoseSection | None = Field(default=None)
    poses: str | None = Field(
        default=None,
        description="CSV file of many poses; columns q1_m, q2_m, q3_m, with q4_deg ... or q4_rad ... for an F1, or "
        "x_m, y_m, z_m, with alpha_deg, beta_deg, gamma_deg (z, y, z) or e0 ... e3",
    )
    platform: Platform | None = Field(default=None)
    draw: Draw | None = Field(default=None)


ARGUMENTS = {"legs": "platform", "pose.axes": "pose"}


def call(problem: Schema, context: Context) -> Call:
    """Return the call of the study: all modes of every pose, and the commanded mode among them."""
    if context.start is not None:
        raise InputError("--start: the method starts from stored systems; leave it out")
    keys = [key for key in ("robot", "platform", "draw") if getattr(problem, key) is not None]
    if len(keys) != 1:
        sources = " and ".join(keys) or "none"
        raise InputError(f"give one of robot, platform and draw; found {sources}", "".join(keys[1:2]))
    return Call(assembly_modes.modes_study, *_arguments(problem, context), title=problem.title or _about(problem))


def explain(problem: Schema, context: Context) -> str:
    """Describe the legs in the first pose, the commanded pose and the method."""
    hands = assembly_modes.modes_of_poses.legs_of(*call(problem, context).arguments)
    lines = [f"{problem.title or 'assembly modes'}: {_about(problem)}, {len(hands)} pose{'s' * (len(hands) > 1)}"]
    if hands.q.shape[1]:
        lines.append(f"  coordinates {_list(hands.q[0])} (m, rad)")
    for k in range(assembly_modes.six_links.LINKS):
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


def _arguments(problem: Schema, context: Context) -> tuple[Any, Any]:
    """The robot or the legs, and the poses."""
    if problem.robot is None:
        for key in ("parameters", "poses"):
            if getattr(problem, key):
                raise InputError("belongs to a robot; leave it out", key)
        if problem.draw is None:
            assert problem.platform is not None
            return _legs(problem.platform, problem.pose), None
        if problem.pose is not None:
            raise InputError("random platforms have random poses; leave it out", "pose")
        return assembly_modes.draw(problem.draw.platforms, problem.draw.seed), None
    if problem.poses is not None and problem.pose is not None:
        raise InputError("give either pose or poses", "poses")
    model = problem_files.robots.resolve(problem.robot, context, parameters=problem.parameters)
    if problem.poses is None:
        return model, None if problem.pose is None else problem.pose.options()
    return model, assembly_modes.read_poses(context.file(problem.poses, "poses"))


def _legs(platform: Platform, pose: PoseSection | None) -> assembly_modes.Hands:
    T = e = None
    if pose is not None:
        foreign = [key for key in ("q_m", "q_rad", "q_deg") if getattr(pose, key) is not None]
        if foreign:
            raise InputError("a platform has no carts; give tcp_m with quaternion or zyz_deg", f"pose.{foreign[0]}")
        commanded = pose.options()
        if commanded.tcp is None or len(commanded.given()) != 2:
            raise InputError("the commanded pose of a platform is tcp_m with either quaternion or zyz_deg", "pose")
        T, e = np.array(commanded.tcp), assembly_modes.modes_of_poses.orientations([commanded], np.zeros(4), "pose")
    return assembly_modes.bare(np.array(platform.A_m), np.array(platform.B_m), np.array(platform.L_m), T, e)


def _list(x: Iterable[float]) -> str:
    return ", ".join(f"{v:.6g}" for v in x)
