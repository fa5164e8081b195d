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

OTHER_LOAD = 0.3  # of the weight, ours: 17 degrees of a frame that is turned, or another load
SURE = 3.0  # standard deviations


@dataclass(frozen=True, eq=False)
class SignTest:
    """share: Estimate of "share", measured over expected weight, 1 expected [1]; None for a load without a mass.
    status: OK; WRONG_SIGN; NO_FORCE where noise and drift do not let the weight tell the sign; WRONG_LOAD where the
    sign is right and the reading is off the expected weight by more than 0.3 of it.
    """

    share: Estimate | None
    status: WrenchStatus


def sign_test(
    calibration: WrenchCalibration, turn: ArrayLike, forces: ArrayLike, *, sigma: float, drift: float = 0.0
) -> SignTest:
    """Compare readings at rest and free of contact with the weight that the calibration expects in that pose.

    Args:
        turn: (3, 3) columns are the sensor's axes in the world frame.
        forces: (rows, 3) readings [N], as of `calibrate_wrench`. Their mean counts.
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
    """
    f = rows_of(forces, "forces")
    sigma_of(sigma, "sigma")
    if not (np.isfinite(drift) and drift >= 0):
        raise ArgumentError(f"must be a number, at least 0; found {drift!r}", "drift")
    if not calibration.status.ok:
        return SignTest(None, calibration.status)
    own = np.asarray(turn, float)
    if own.shape != (3, 3):
        raise ArgumentError(f"has the shape {own.shape}; expected (3, 3)", "turn")
    weight = calibration.weight(own[None])[0][0]
    mean = f.mean(axis=0) - calibration.force.values[:3]
    share = linear_fit(weight[:, None], mean, ["share"], sigma=sigma / np.sqrt(len(f)))
    low, high = share.interval("share")
    margin = drift / float(np.linalg.norm(weight))
    if low > margin:
        off = float(np.linalg.norm(mean - weight)) - drift - SURE * sigma * np.sqrt(3 / len(f))
        other = off > OTHER_LOAD * float(np.linalg.norm(weight))
        return SignTest(share, WrenchStatus.WRONG_LOAD if other else WrenchStatus.OK)
    return SignTest(share, WrenchStatus.WRONG_SIGN if high < -margin else WrenchStatus.NO_FORCE)
