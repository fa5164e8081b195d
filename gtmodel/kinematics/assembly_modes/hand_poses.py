"""Poses of a six-link robot: given one by one, or one row each of a CSV file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ...geometry.quaternions import zyz_quaternion
from ...measurements.csv_table import CsvTable
from ...results import ArgumentError, naming
from ...results.disk import path_of
from ..causality.conditions import UNIT_LENGTH
from .options import COLUMNS, CommandedPose
from .six_links import Hands, SixLinks


def read_poses(path: str | Path) -> list[CommandedPose]:
    """The poses of a CSV file, one row each, named columns as in COLUMNS. Raises ArgumentError.

    >>> from pathlib import Path
    >>> from gtmodel.kinematics.assembly_modes import read_poses
    >>> _ = Path("poses.csv").write_text("q1_m,q2_m,q3_m,q4_deg,q5_deg,q6_deg\\n0.7,0.3,0.2,90,0,0\\n")
    >>> read_poses("poses.csv")[0].axes
    [1.5707963267948966, 0.0, 0.0]
    """
    path = path_of(path)
    with naming("poses", ArgumentError):
        table = CsvTable(path)
    head = table.names
    wanted = [
        (name, columns, f) for name, all_ in COLUMNS.items() for columns, f in all_.items() if {*columns} & {*head}
    ]
    known = [column for _, columns, _ in wanted for column in columns]
    missing = [column for column in known if column not in head]
    if missing or not wanted:
        expected = ", ".join(missing) or "q1_m, q2_m, q3_m or x_m, y_m, z_m"
        raise ArgumentError(f"{path.name} lacks the columns {expected}; it has {', '.join(head)}", "poses")
    foreign = [column for column in head if column not in known]
    if foreign:
        raise ArgumentError(f"{path.name} has columns that are none of a pose: {', '.join(foreign)}", "poses")
    twice = [columns for name, columns, _ in wanted if sum(name == other for other, _, _ in wanted) > 1]
    if twice:
        raise ArgumentError(f"{path.name} has {' and '.join(c[0] for c in twice)}; give either", "poses")
    with naming("poses", ArgumentError):
        numbers = {c: table.numbers(c).tolist() for c in known}
    return [
        CommandedPose(**{name: [f * numbers[c][k] for c in columns] for name, columns, f in wanted})
        for k in range(len(table.lines))
    ]


def hands_of(robot: SixLinks, poses: Sequence[CommandedPose], argument: str) -> Hands:
    """Legs of the robot in poses that give the same quantities. Raises ArgumentError at `argument`."""
    given = poses[0].given()
    _check(robot, given, argument)
    if "q" in given:
        q = np.array([pose.q for pose in poses])
        if robot.carts_and_axes[1]:
            q = np.hstack([q, np.array([pose.axes or [0.0, 0.0, 0.0] for pose in poses])])
        return robot.at_carts(q)
    T, e = robot.home
    if "tcp" in given:
        return robot.at_poses(np.array([pose.tcp for pose in poses]), orientations(poses, e, argument))
    return robot.at_poses(T[None], e[None])


def orientations(poses: Sequence[CommandedPose], left_out: np.ndarray, argument: str) -> np.ndarray:
    """Quaternions (n, 4) of length 1 of the poses, `left_out` where they say nothing."""
    heads = [f"pose {i + 1} " if len(poses) > 1 else "" for i in range(len(poses))]
    return np.array([_orientation(pose, left_out, argument, head) for pose, head in zip(poses, heads, strict=True)])


def _orientation(pose: CommandedPose, left_out: np.ndarray, argument: str, head: str) -> np.ndarray:
    if pose.quaternion is not None:
        e = np.array(pose.quaternion)
        length = float(np.linalg.norm(e))
        if abs(length - 1.0) > UNIT_LENGTH:
            raise ArgumentError(
                f"{head}must be of length 1; found {pose.quaternion} of length {length:.6g}", f"{argument}.quaternion"
            )
        return e / length
    if pose.zyz is not None:
        return zyz_quaternion(*pose.zyz)
    return left_out


def _check(robot: SixLinks, given: tuple[str, ...], argument: str) -> None:
    """Raises ArgumentError for quantities that contradict each other or do not belong to the robot."""
    if "tcp" in given and "q" in given:
        raise ArgumentError("give either the carts q_m or tcp_m", argument)
    turned = [name for name in ("zyz", "quaternion") if name in given]
    if len(turned) > 1:
        raise ArgumentError("give either zyz or quaternion", argument)
    if "axes" in given and not robot.carts_and_axes[1]:
        raise ArgumentError("the robot has no rotary axes; leave them out", f"{argument}.axes")
    if turned and not robot.turns:
        raise ArgumentError("the robot's orientation follows from tcp_m; leave it out", f"{argument}.{turned[0]}")
    if "axes" in given and "q" not in given:
        raise ArgumentError("rotary axes need the carts q_m beside them", f"{argument}.axes")
    if turned and "tcp" not in given:
        raise ArgumentError("an orientation needs tcp_m beside it", f"{argument}.{turned[0]}")
