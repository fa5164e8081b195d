"""A mounted force sensor that converts readings to wrenches at the tool, and the test of its sign and load."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ...inference import linear_fit
from ...results import ArgumentError, Estimate
from .calibration import WrenchCalibration
from .scenes import GRAVITY
from .wrench import (
    IDENTITY,
    ORTHONORMAL,
    ZERO,
    Turn,
    Vector,
    WrenchStatus,
    back,
    cross,
    forth,
    is_turn,
    plus,
    rows_of,
    sigma_of,
    vector_of,
    whole,
)
from .wrench_study import LeverArm

Wrench = tuple[Vector, Vector]


@dataclass(frozen=True)
class MountedSensor:
    """Mounting, bias and load of a force sensor on the tool, in plain numbers for the control cycle.

    turn: rows of the rotation matrix whose columns are the sensor's axes in the tool's frame. point: (3,) [m] from the
    sensor's origin to the tool centre point, in the sensor's frame; moments are converted to this point. force_bias
    [N], moment_bias [N m], mass [kg], first_moment [kg m]: as in `WrenchCalibration`. Raises ArgumentError if numbers
    are not finite, the mass is negative, or turn is not a rotation matrix.

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
        """Return a sensor with bias and load of a calibration; turn (3, 3), point (3,) or a result of `lever_arm`.

        If the calibrated mass does not differ from zero, the sensor has no load. Raises ArgumentError if the
        calibration or the lever arm failed.
        """
        if not calibration.status.ok and calibration.centre is not None:
            raise ArgumentError("it gives no contact forces: " + calibration.status.message, "calibration")
        if isinstance(point, LeverArm):
            if point.estimate is None:
                raise ArgumentError("the lever arm is unknown: " + point.status.message, "point")
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
        """Return the external force [N] and moment [N m] about the tool centre point, in the world frame.

        reading: force [N] and moment [N m] on the load about the sensor's origin, in its frame. turn: rows of the
        rotation matrix whose columns are the tool's axes in the world frame. gravity: (3,) [m/s2].
        """
        g = back(self.turn, back(turn, gravity))
        force = plus(plus(reading[0], -1.0, self.force_bias), -self.mass, g)
        moment = plus(plus(reading[1], -1.0, self.moment_bias), -1.0, cross(self.first_moment, g))
        moment = plus(moment, -1.0, cross(self.point, force))
        return forth(turn, forth(self.turn, force)), forth(turn, forth(self.turn, moment))


def _plain(row: np.ndarray) -> Vector:
    return float(row[0]), float(row[1]), float(row[2])


TILTED = np.deg2rad(15.0)  # least angle between the weights of two poses, in the sensor's axes, to detect a rotation
OTHER_LOAD = 0.3  # of the weight, our choice: a frame rotated by 17 degrees, or another load
SURE = 3.0  # standard deviations


@dataclass(frozen=True, eq=False)
class SignTest:
    """share: Estimate of "share", the measured over the expected weight [1], ideally 1; None for a load without mass.
    status: OK; WRONG_SIGN; NO_FORCE if noise and drift are too large to determine the sign from the weight; WRONG_LOAD
    if the sign is right but a reading differs from the expected weight by more than 0.3 of it.

    blind: the weight had only one direction in the sensor's frame, so a sensor rotated about the vertical would read
    the same. A second, tilted pose or a push in a known direction detects this.
    """

    share: Estimate | None
    status: WrenchStatus
    blind: bool = False


def sign_test(
    calibration: WrenchCalibration, turn: ArrayLike, forces: ArrayLike, *, sigma: float, drift: float = 0.0
) -> SignTest:
    """Test sign and load: compare readings at rest, without contact, with the weight expected from the calibration.

    Args:
        turn: (3, 3), columns are the sensor's axes in the world frame; or (poses, 3, 3), one for each reading.
        forces: (rows, 3) readings [N], as in `calibrate_wrench`; in a single pose their mean is used.
        sigma: standard deviation of one reading [N].
        drift: largest change of the bias since the calibration [N]; it must not determine the sign.

    The confidence of the sign is 95 %. Raises ArgumentError if shapes do not fit, if numbers are not finite, if drift
    is negative, or if sigma is not positive.

    >>> turns = np.stack([np.eye(3), [[1, 0, 0], [0, 0, -1], [0, 1, 0]], [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]])
    >>> g = turns.transpose(0, 2, 1) @ [0.0, 0.0, -9.81]
    >>> c = gt.control.lead_through.calibrate_wrench(turns, 0.8 * g, 0.0 * g, sigma_force=0.05, sigma_moment=0.002)
    >>> [gt.control.lead_through.sign_test(c, np.eye(3), [f], sigma=0.05, drift=1.0).status.name
    ...  for f in ([0, 0, -7.8], [0, 0, 7.8], [0, 0, 0])]
    ['OK', 'WRONG_SIGN', 'NO_FORCE']
    >>> about_z = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])  # the sensor is mounted a quarter turn off
    >>> off = turns @ about_z
    >>> read = off.transpose(0, 2, 1) @ [0.0, 0.0, -7.848]
    >>> [(t.status.name, t.blind) for t in (gt.control.lead_through.sign_test(c, turns[:1], read[:1], sigma=0.05),
    ...  gt.control.lead_through.sign_test(c, turns, read, sigma=0.05))]
    [('OK', True), ('WRONG_LOAD', False)]
    """
    f = rows_of(forces, "forces")
    sigma_of(sigma, "sigma")
    if not (np.isfinite(drift) and drift >= 0):
        raise ArgumentError(f"must be a number, at least 0; found {drift!r}", "drift")
    if not calibration.status.ok:
        return SignTest(None, calibration.status)
    turns = np.asarray(turn, float)
    if turns.shape == (3, 3):
        turns, f, count = turns[None], f.mean(axis=0, keepdims=True), len(f)
    elif turns.shape == (len(f), 3, 3):
        count = 1
    else:
        raise ArgumentError(f"has the shape {turns.shape}; expected (3, 3) or ({len(f)}, 3, 3)", "turn")
    weight = calibration.weight(turns)[0]
    size = float(np.linalg.norm(weight[0]))
    mean = f - calibration.force.values[:3]
    share = linear_fit(weight.reshape(-1, 1), mean.reshape(-1), ["share"], sigma=sigma / np.sqrt(count))
    blind = bool(np.all(weight @ weight[0] > np.cos(TILTED) * size**2))
    low, high = share.interval("share")
    margin = drift / size
    if low > margin:
        off = float(np.linalg.norm(mean - weight, axis=1).max()) - drift - SURE * sigma * np.sqrt(3 / count)
        return SignTest(share, WrenchStatus.WRONG_LOAD if off > OTHER_LOAD * size else WrenchStatus.OK, blind)
    return SignTest(share, WrenchStatus.WRONG_SIGN if high < -margin else WrenchStatus.NO_FORCE, blind)
