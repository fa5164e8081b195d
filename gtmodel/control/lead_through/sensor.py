"""A force sensor on the robot: its frame, bias and load, and what its reading says at the tool centre point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ...results import ArgumentError
from .calibration import WrenchCalibration
from .lever import LeverArm
from .synthetic_sensor import GRAVITY
from .vectors import IDENTITY, ZERO, Turn, Vector, back, cross, forth, is_turn, plus, whole
from .wrench import ORTHONORMAL, vector_of

Wrench = tuple[Vector, Vector]


@dataclass(frozen=True)
class MountedSensor:
    """Where a force sensor sits on the tool, what it reads at rest and what it carries; plain numbers for the cycle.

    turn: rows of the rotation matrix whose columns are the sensor's axes in the tool's frame. point: (3,) [m] from the
    sensor's origin to the tool centre point, in the sensor's frame: about it moments count. force_bias [N],
    moment_bias [N m], mass [kg], first_moment [kg m]: as of `WrenchCalibration`. Raises ArgumentError for numbers that
    are not finite, a mass below 0 and what is no rotation matrix.

    >>> sensor = gt.control.lead_through.MountedSensor(mass=1.0, first_moment=(0.0, 0.0, 0.1), point=(0.0, 0.0, 0.2))
    >>> at_rest = (0.0, 0.0, -9.81), (0.0, 0.0, 0.0)
    >>> upright = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    >>> [tuple(x + 0.0 for x in part) for part in sensor.wrench(at_rest, upright)]  # nothing touches it
    [(0.0, 0.0, 0.0), (0.0, 0.0, 0.0)]
    """

    turn: Turn = IDENTITY
    point: Vector = ZERO
    force_bias: Vector = ZERO
    moment_bias: Vector = ZERO
    mass: float = 0.0
    first_moment: Vector = ZERO

    def __post_init__(self) -> None:
        for name in ("point", "force_bias", "moment_bias", "first_moment"):
            if len(getattr(self, name)) != 3 or not whole(getattr(self, name)):
                raise ArgumentError(f"expected three finite numbers; found {getattr(self, name)!r}", name)
        if not 0.0 <= self.mass < float("inf"):
            raise ArgumentError(f"must be a number, at least 0; found {self.mass!r}", "mass")
        if [len(row) for row in self.turn] != [3, 3, 3] or not is_turn(self.turn, ORTHONORMAL):
            raise ArgumentError(f"expected the rows of a rotation matrix; found {self.turn!r}", "turn")

    @classmethod
    def calibrated(
        cls, calibration: WrenchCalibration, turn: ArrayLike = IDENTITY, point: ArrayLike | LeverArm = ZERO
    ) -> MountedSensor:
        """A sensor with bias and load of a calibration; turn (3, 3), point (3,) or as `lever_arm` gives it.

        A load without a mass has none here. Raises ArgumentError after a calibration or a lever arm that failed.
        """
        if not calibration.status.ok and calibration.centre is not None:
            raise ArgumentError("no contact force can be had from it: " + calibration.status.message, "calibration")
        if isinstance(point, LeverArm):
            if point.estimate is None:
                raise ArgumentError("where the forces act is unknown: " + point.status.message, "point")
            point = point.estimate.values
        rows = np.asarray(turn, float)
        if rows.shape != (3, 3):
            raise ArgumentError(f"has the shape {rows.shape}; expected (3, 3)", "turn")
        loaded = calibration.centre is not None
        return cls(
            (_plain(rows[0]), _plain(rows[1]), _plain(rows[2])), _plain(vector_of(point, "point")),
            _plain(calibration.force.values[:3]), _plain(calibration.moment.values[:3]),
            calibration.force.value("mass") if loaded else 0.0,
            _plain(calibration.moment.values[3:]) if loaded else ZERO,
        )  # fmt: skip

    def wrench(self, reading: Wrench, turn: Turn, gravity: Vector = GRAVITY) -> Wrench:
        """Force [N] and moment [N m] from outside about the tool centre point, in the world frame.

        reading: force [N] and moment [N m] about the sensor's origin, in its frame, on what it carries. turn: rows of
        the rotation matrix whose columns are the tool's axes in the world frame. gravity: (3,) [m/s2].
        """
        g = back(self.turn, back(turn, gravity))
        force = plus(plus(reading[0], -1.0, self.force_bias), -self.mass, g)
        moment = plus(plus(reading[1], -1.0, self.moment_bias), -1.0, cross(self.first_moment, g))
        moment = plus(moment, -1.0, cross(self.point, force))
        return forth(turn, forth(self.turn, force)), forth(turn, forth(self.turn, moment))


def _plain(row: np.ndarray) -> Vector:
    return float(row[0]), float(row[1]), float(row[2])
