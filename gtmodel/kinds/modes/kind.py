"""Kind "modes": all assembly modes of six links, with a certificate that none is missing."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from gtmodel.kinematics.assembly_modes import bare, draw, modes_study, read_poses
from gtmodel.kinematics.assembly_modes.hand_poses import orientations
from gtmodel.kinematics.assembly_modes.modes_of_poses import legs_of
from gtmodel.kinematics.assembly_modes.six_links import LINKS, Hands
from gtmodel.problem_files import robots
from gtmodel.problem_files.base import Context, InputError
from gtmodel.problem_files.call import Call

from .keys import Platform, PoseSection, Schema

NAME = "modes"
ARGUMENTS = {"legs": "platform", "pose.axes": "pose"}


def call(problem: Schema, context: Context) -> Call:
    """All modes of every pose, and the commanded one among them."""
    if context.start is not None:
        raise InputError("--start: the modes are found from stored start systems; leave it out")
    given = [key for key in ("robot", "platform", "draw") if getattr(problem, key) is not None]
    if len(given) != 1:
        raise InputError(f"give one of robot, platform and draw; found {' and '.join(given) or 'none'}", *given[1:2])
    return Call(modes_study, *_asked(problem, context), title=problem.title or _about(problem))


def explain(problem: Schema, context: Context) -> str:
    """The legs of the first pose, the pose commanded, and the method."""
    hands = legs_of(*call(problem, context).arguments)
    lines = [f"{problem.title or 'assembly modes'}: {_about(problem)}, {len(hands)} pose{'s' * (len(hands) > 1)}"]
    if hands.q.shape[1]:
        lines.append(f"  coordinates {_list(hands.q[0])} (m, rad)")
    for k in range(LINKS):
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


def _asked(problem: Schema, context: Context) -> tuple[Any, Any]:
    """The robot or the legs, and the poses."""
    if problem.robot is None:
        for key in ("parameters", "poses"):
            if getattr(problem, key):
                raise InputError("are those of a robot; leave them out", key)
        if problem.draw is None:
            assert problem.platform is not None
            return _legs(problem.platform, problem.pose), None
        if problem.pose is not None:
            raise InputError("random platforms are in random poses; leave it out", "pose")
        return draw(problem.draw.platforms, problem.draw.seed), None
    if problem.poses is not None and problem.pose is not None:
        raise InputError("give either pose or poses", "poses")
    model = robots.resolve(problem.robot, context, parameters=problem.parameters)
    if problem.poses is None:
        return model, None if problem.pose is None else problem.pose.options()
    return model, read_poses(context.file(problem.poses, "poses"))


def _legs(platform: Platform, pose: PoseSection | None) -> Hands:
    T = e = None
    if pose is not None:
        foreign = [key for key in ("q_m", "q_rad", "q_deg") if getattr(pose, key) is not None]
        if foreign:
            raise InputError("a platform has no carts; give tcp_m with quaternion or zyz_deg", f"pose.{foreign[0]}")
        given = pose.options()
        if given.tcp is None or len(given.given()) != 2:
            raise InputError("the commanded pose of a platform is tcp_m with either quaternion or zyz_deg", "pose")
        T, e = np.array(given.tcp), orientations([given], np.zeros(4), "pose")
    return bare(np.array(platform.A_m), np.array(platform.B_m), np.array(platform.L_m), T, e)


def _list(x: Iterable[float]) -> str:
    return ", ".join(f"{v:.6g}" for v in x)
