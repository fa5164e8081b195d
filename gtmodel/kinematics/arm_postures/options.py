"""Poses of a tool, in the representations of controllers, and the postures of an arm for them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np

from ...geometry.rotations import rotation_by
from ...lang.units import convert, parse_unit
from ...measurements.orientations import WORDS, in_angles, orientation_vectors
from ...results import ArgumentError, Quantity, Row, Study, naming
from ...results.options import Long, Options, Unit

Array = np.ndarray


@dataclass(frozen=True)
class ToolPose(Options):
    """A pose of the tool: its position, and its orientation in the representation of a controller.

    >>> pose = gt.kinematics.ToolPose([0.4, 0.1, 0.3], [180.0, 0.0, 90.0], "KUKA A B C")
    >>> pose.poses.R.round(6)[0] + 0.0
    array([[-1.,  0.,  0.],
           [ 0.,  0.,  1.],
           [ 0.,  1.,  0.]])
    """

    position: Annotated[list[float], Unit("m"), Long(3), "origin of the tool frame, world coordinates"]
    orientation: Annotated[
        list[float] | list[list[float]] | None,
        "numbers of the orientation, or a rotation matrix in three rows; left out: any orientation, for an arm of up "
        "to three joints",
    ] = None  # fmt: skip
    representation: Annotated[
        str, f"of the orientation: {WORDS}; matrix for three rows; ABB writes quaternion w x y z, KUKA A B C, "
        "Universal Robots a rotation vector, Fanuc and URDF RPY"
    ] = "matrix"  # fmt: skip
    unit: Annotated[str, "of angles in the orientation, deg or rad"] = "deg"

    @property
    def poses(self) -> ToolPoses:
        """The pose as arrays of one row. Raises ArgumentError for an orientation that is none."""
        if self.orientation is None:
            return ToolPoses(np.array([self.position]), None)
        with naming("representation"):
            unit = self.unit if in_angles(self.representation) else "1"
        numbers = np.asarray(self.orientation, float).reshape(1, -1)
        return ToolPoses(np.array([self.position]), rotations(numbers, self.representation, unit))


@dataclass(frozen=True)
class ToolColumns(Options):
    """Columns of a file of poses.

    >>> gt.kinematics.ToolColumns("T", "mm", ["A", "B", "C"], "KUKA A B C").unit
    'deg'
    """

    position: Annotated[str | list[str], 'names in the file; "T" also means "T[0]", "T[1]", "T[2]"'] = "T"
    position_unit: Annotated[str, "unit of the position's columns"] = "m"
    orientation: Annotated[str | list[str] | None, "names in the file; left out: any orientation"] = None
    representation: Annotated[str, f"of the orientation: {WORDS}"] = "matrix"
    unit: Annotated[str, "of angles in the orientation, deg or rad"] = "deg"


@dataclass(frozen=True, eq=False)
class ToolPoses:
    """Poses of the tool: T (m, 3) [m] and R (m, 3, 3), None for any orientation; `lines`: their lines in a file.

    >>> gt.kinematics.ToolPoses([[0.4, 0.1, 0.3]], [np.eye(3)]).R.shape
    (1, 3, 3)
    """

    T: Array
    R: Array | None = None
    lines: Array | None = None

    def __post_init__(self) -> None:
        T = np.atleast_2d(np.asarray(self.T, float))
        R = None if self.R is None else np.asarray(self.R, float).reshape(-1, 3, 3)
        if T.ndim != 2 or T.shape[1] != 3 or not len(T) or (R is not None and len(R) != len(T)):
            shape = None if R is None else R.shape
            raise ArgumentError(f"T has the shape {T.shape} and R {shape}; expected (m, 3) and (m, 3, 3)", "poses")
        object.__setattr__(self, "T", T)
        object.__setattr__(self, "R", R)

    def __len__(self) -> int:
        return len(self.T)

    def called(self, row: int) -> str:
        """Return how a row is called in sentences: by its line if it comes from a file."""
        return f"row {row + 1}" + ("" if self.lines is None else f" (line {self.lines[row]})")


def rotations(rows: Array, representation: str, unit: str) -> Array:
    """Return rotation matrices (m, 3, 3) of rows in a representation; unit: of their angles, "1" for other numbers."""
    with naming("unit"):
        si = parse_unit(unit).si_text if unit != "1" else "1"
        rows = np.asarray(convert(rows, unit, si), float) if unit != "1" else rows
    with naming("orientation"):
        return np.array([rotation_by(v) for v in orientation_vectors(rows, representation, si)])


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class PosturesStudy(Study):
    """Postures of m poses of an arm of n joints, at most k of each.

    q (m, k, n) [rad or m]: all postures, within their limits where turns of 360 degrees bring them there, NaN where
    there is none; excess (m, k, n): how far they exceed them; codes (m, k) of `Status`; branches (m, k): index of
    `names`, or a number if there are no names. chosen (m, n): one posture of each pose within limits: the nearest to
    `near`, or along a path the one without jumps.
    """

    q: Array
    excess: Array
    codes: Array
    branches: Array
    chosen: Array
    names: tuple[str, ...] = ()
    joints: tuple[str, ...] = ()
    poses: Annotated[int, Quantity("", "number of poses", "poses")]
    method: Annotated[str, Quantity("", "how the postures were found: structure of the axes, or method", "method")]
    complete: Annotated[bool, "whether all postures are known, by algebra"]
    counts: Annotated[Mapping[str, int], "number of poses by the number of their postures within limits"]
    statuses: Annotated[
        Mapping[str, int],
        "number of poses by status: ok, singular (all of them are next to a singular position), beyond_limits "
        "(postures exist, none within the limits), out_of_range (no posture), not_finite, not_converged (no posture "
        "was found by iteration)",
    ]
    shortfall: Annotated[
        Array | None,
        Quantity("m", "distance of each pose that is out of reach from the nearest position that the arm reaches with "
                 "the same orientation, 0 for the others; the nearest of many local minima", written="mm"),
    ] = None  # fmt: skip
    jumps: Annotated[
        Sequence[Mapping[str, Any]], "along a path: row (from 1) of each jump that no choice avoids, and its reason"
    ] = ()
    each: Annotated[
        Sequence[Mapping[str, Any]],
        "postures of a single pose: name, joint coordinates, status, and the limits that they exceed",
    ] = ()
    lines: list[Row] = field(default_factory=list)

    @property
    def rows(self) -> list[Row]:
        """The table for people."""
        rows = super().rows
        rows += [Row(f"poses with {k} postures", n) for k, n in self.counts.items()] if self.poses > 1 else []
        return rows + self.lines
