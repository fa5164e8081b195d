"""Poses of a six-link robot: a table of a problem file, or one row each of a CSV file."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field
from scipy.spatial.transform import Rotation

from gtmodel.kinematics.causality.conditions import UNIT_LENGTH
from gtmodel.problem_files import csv_table
from gtmodel.problem_files.base import Context, InputError, Section
from gtmodel.problem_files.robots import file_of

from .six_links import Hands, SixLinks

Three = Annotated[list[float], Field(min_length=3, max_length=3)]
Four = Annotated[list[float], Field(min_length=4, max_length=4)]

# keys of a pose with their columns in a file
COLUMNS = {
    "q_m": ("q1_m", "q2_m", "q3_m"),
    "q_rad": ("q4_rad", "q5_rad", "q6_rad"),
    "q_deg": ("q4_deg", "q5_deg", "q6_deg"),
    "tcp_m": ("x_m", "y_m", "z_m"),
    "zyz_deg": ("alpha_deg", "beta_deg", "gamma_deg"),
    "quaternion": ("e0", "e1", "e2", "e3"),
}


class Pose(Section):
    """Carts and rotary axes, or a tool pose."""

    q_m: Three | None = Field(default=None, description="coordinates of the three carts")
    q_rad: Three | None = Field(default=None, description="rotary axes q4, q5, q6 of an F1; zero if left out")
    q_deg: Three | None = Field(default=None, description="the same in degrees")
    tcp_m: Three | None = Field(default=None, description="tool centre point, in place of q_m")
    zyz_deg: Three | None = Field(
        default=None, description="the plate's angles about z, y, z there, where they are free; home's if left out"
    )
    quaternion: Four | None = Field(default=None, description="its unit quaternion instead, scalar first")

    def given(self) -> tuple[str, ...]:
        """The keys that are there."""
        return tuple(key for key in COLUMNS if getattr(self, key) is not None)


def of_file(reference: str, context: Context) -> list[Pose]:
    """The poses of a CSV file, one row each, named columns as in COLUMNS. Raises InputError at key poses."""
    path = file_of(reference, context)
    if path is None:
        raise InputError(f"there is no file '{reference}' in {context.folder} or here", "poses")
    context.take("poses", path)
    try:
        head, rows = _table(path)
    except InputError as error:
        raise error.within("", "poses") from error
    wanted = [key for key, columns in COLUMNS.items() if set(columns) & set(head)]
    known = [column for key in wanted for column in COLUMNS[key]]
    missing = [column for column in known if column not in head]
    if missing or not wanted:
        expected = ", ".join(missing) or "q1_m, q2_m, q3_m or x_m, y_m, z_m"
        raise InputError(f"{path.name} lacks the columns {expected}; it has {', '.join(head)}", "poses")
    foreign = [column for column in head if column not in known]
    if foreign:
        raise InputError(f"{path.name} has columns that are none of a pose: {', '.join(foreign)}", "poses")
    if not rows:
        raise InputError(f"{path.name} has no rows", "poses")
    return [
        Pose(**{key: [row[head.index(column)] for column in COLUMNS[key]] for key in wanted})  # type: ignore[arg-type]
        for row in rows
    ]


def _table(path: Path) -> tuple[list[str], list[list[float]]]:
    """Heads and numbers of a CSV file. Raises InputError."""
    (line, head), kept = csv_table.lines_of(path, "q1_m,q2_m,q3_m")
    csv_table.refuse_twice(head, f"{path.name} line {line}")
    rows = []
    for n, row in kept:
        try:
            numbers = [csv_table.number(cell) for cell in row]
        except ValueError:
            numbers = []
        if len(numbers) != len(head) or not all(map(math.isfinite, numbers)):
            raise InputError(f"{path.name} line {n}: expected {len(head)} finite numbers; found '{','.join(row)}'")
        rows.append(numbers)
    return head, rows


def hands_of(robot: SixLinks, poses: list[Pose], key: str) -> Hands:
    """Legs of the robot in poses that give the same keys. Raises InputError at `key`."""
    given = poses[0].given()
    _check(robot, given, key)
    if "q_m" in given:
        q = np.array([pose.q_m for pose in poses])
        if robot.carts_and_axes[1]:
            axes = [np.radians(p.q_deg) if p.q_deg is not None else p.q_rad or [0.0, 0.0, 0.0] for p in poses]
            q = np.hstack([q, np.array(axes)])
        return robot.at_carts(q)
    T, e = robot.home
    if "tcp_m" in given:
        return robot.at_poses(np.array([pose.tcp_m for pose in poses]), orientations(poses, e, key))
    return robot.at_poses(T[None], e[None])


def orientations(poses: list[Pose], left_out: np.ndarray, key: str) -> np.ndarray:
    """Quaternions (n, 4) of length 1 of the poses, `left_out` where they say nothing."""
    heads = [f"pose {i + 1} " if len(poses) > 1 else "" for i in range(len(poses))]
    return np.array([_orientation(pose, left_out, key, head) for pose, head in zip(poses, heads, strict=True)])


def _orientation(pose: Pose, left_out: np.ndarray, key: str, head: str) -> np.ndarray:
    if pose.quaternion is not None:
        e = np.array(pose.quaternion)
        length = float(np.linalg.norm(e))
        if abs(length - 1.0) > UNIT_LENGTH:
            raise InputError(
                f"{head}must be of length 1; found {pose.quaternion} of length {length:.6g}", f"{key}.quaternion"
            )
        return e / length
    if pose.zyz_deg is not None:
        return Rotation.from_euler("ZYZ", pose.zyz_deg, degrees=True).as_quat(scalar_first=True)
    return left_out


def _check(robot: SixLinks, given: tuple[str, ...], key: str) -> None:
    """Raises InputError for keys that contradict each other or do not belong to the robot."""
    if "tcp_m" in given and "q_m" in given:
        raise InputError("give either q_m or tcp_m", key)
    angles = [k for k in ("q_rad", "q_deg") if k in given]
    turned = [k for k in ("zyz_deg", "quaternion") if k in given]
    if len(angles) > 1 or len(turned) > 1:
        raise InputError(f"give either {' or '.join(angles if len(angles) > 1 else turned)}", key)
    if angles and not robot.carts_and_axes[1]:
        raise InputError("the robot has no rotary axes; leave it out", f"{key}.{angles[0]}")
    if turned and not robot.turns:
        raise InputError("the robot's orientation follows from tcp_m; leave it out", f"{key}.{turned[0]}")
    if angles and "q_m" not in given:
        raise InputError("rotary axes need the carts q_m beside them", f"{key}.{angles[0]}")
    if turned and "tcp_m" not in given:
        raise InputError("an orientation needs tcp_m beside it", f"{key}.{turned[0]}")
