"""Before anything moves: does the sensor report the force on the tool, with sign and weight of its calibration?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ...inference import linear_fit
from ...results import ArgumentError, Estimate
from .calibration import WrenchCalibration
from .status import WrenchStatus
from .wrench import rows_of, sigma_of

TILTED = np.deg2rad(15.0)  # between the weights of two poses, in the sensor's axes: less tells little of a turn
OTHER_LOAD = 0.3  # of the weight, ours: 17 degrees of a frame that is turned, or another load
SURE = 3.0  # standard deviations


@dataclass(frozen=True, eq=False)
class SignTest:
    """share: Estimate of "share", measured over expected weight, 1 expected [1]; None for a load without a mass.
    status: OK; WRONG_SIGN; NO_FORCE where noise and drift do not let the weight tell the sign; WRONG_LOAD where the
    sign is right and a reading is off the expected weight by more than 0.3 of it.

    blind: the weight pulled in one direction of the sensor only, so that a sensor turned about the vertical would have
    read the same; a second pose, tilted, or a push in a known direction tells it.
    """

    share: Estimate | None
    status: WrenchStatus
    blind: bool = False


def sign_test(
    calibration: WrenchCalibration, turn: ArrayLike, forces: ArrayLike, *, sigma: float, drift: float = 0.0
) -> SignTest:
    """Compare readings at rest and free of contact with the weight that the calibration expects in those poses.

    Args:
        turn: (3, 3) columns are the sensor's axes in the world frame; or (poses, 3, 3), of each reading.
        forces: (rows, 3) readings [N], as of `calibrate_wrench`. In one pose their mean counts.
        sigma: standard deviation of one reading [N].
        drift: largest change of the bias since the calibration [N]: it may not decide the sign.

    The sign is told at 95 %. Raises ArgumentError for other shapes, numbers that are not finite, a negative drift and a
    sigma that is not positive.

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
    own = np.asarray(turn, float)
    if own.shape == (3, 3):
        own, f, count = own[None], f.mean(axis=0, keepdims=True), len(f)
    elif own.shape == (len(f), 3, 3):
        count = 1
    else:
        raise ArgumentError(f"has the shape {own.shape}; expected (3, 3) or ({len(f)}, 3, 3)", "turn")
    weight = calibration.weight(own)[0]
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
