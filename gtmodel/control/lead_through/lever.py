"""Where a force acts: the lever arm from the sensor to a tip or a grip, from wrenches of pushes without a torque."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ...geometry.rotations import cross_matrix
from ...inference import linear_fit
from ...results import ArgumentError, Estimate
from .calibration import WrenchCalibration
from .status import WrenchStatus
from .wrench import axes, rows_of, sigma_of, turns_of

ABOVE_NOISE = 50.0  # forces over their noise: noise in forces then draws the arm to zero by 1/2500 at most
PASSES = 3  # the noise of a torque depends on the arm, weakly


@dataclass(frozen=True, eq=False)
class LeverArm:
    """estimate: of arm_x, arm_y, arm_z [m], sensor's origin to the point of the forces, in the sensor's frame; None
    where status is not OK. status: NO_FORCE, or ONE_DIRECTION where the pushes do not tell the arm along them.
    """

    estimate: Estimate | None
    status: WrenchStatus


def lever_arm(
    forces: ArrayLike,
    moments: ArrayLike,
    *,
    sigma_force: float,
    sigma_moment: float,
    calibration: WrenchCalibration | None = None,
    turns: ArrayLike | None = None,
) -> LeverArm:
    """The point at which pure forces act, from wrenches without bias and weight: moment = arm x force.

    Args:
        forces, moments: (pushes, 3) [N], [N m] in the sensor's frame, in two directions at least, for instance pushes
            of a fixed point against the tip; as `WrenchCalibration.contact` returns them.
        sigma_force, sigma_moment: standard deviation of one reading [N], [N m].
        calibration: by which bias and weight were taken off, and turns (pushes, 3, 3) of the sensor in the world frame
            at each push: the error of the calibration, alike in all pushes, then widens the intervals.

    Least squares of the moments, weighted with the noise of both (that of the forces acts through the arm). Forces must
    exceed 50 sigma_force (root mean square, across any one direction too), else the status says so. Raises
    ArgumentError for other shapes, numbers that are not finite, standard deviations that are not positive, and a
    calibration without turns.

    >>> pushes = np.array([[20.0, 0.0, 0.0], [0.0, 20.0, 0.0], [0.0, 0.0, 20.0]])
    >>> arm = gt.control.lead_through.lever_arm(
    ...     pushes, np.cross([0.0, 0.05, 0.2], pushes), sigma_force=0.05, sigma_moment=0.002)
    >>> arm.status.name, arm.estimate.values.round(6)
    ('OK', array([0.  , 0.05, 0.2 ]))
    >>> gt.control.lead_through.lever_arm(pushes[:1], pushes[:1], sigma_force=0.05, sigma_moment=0.002).status.name
    'ONE_DIRECTION'
    """
    f = rows_of(forces, "forces")
    m = rows_of(moments, "moments", len(f))
    sigma_of(sigma_force, "sigma_force")
    sigma_of(sigma_moment, "sigma_moment")
    A = -cross_matrix(f)
    least = len(f) * (ABOVE_NOISE * sigma_force) ** 2
    if np.sum(f**2) < least:
        return LeverArm(None, WrenchStatus.NO_FORCE)
    if np.linalg.eigvalsh(np.einsum("nij,nik->jk", A, A))[0] < least:
        return LeverArm(None, WrenchStatus.ONE_DIRECTION)
    if (calibration is None) != (turns is None):
        raise ArgumentError("calibration and turns are given together", "turns")
    arm, estimate, white = np.zeros(3), None, np.eye(3)
    for _ in range(PASSES):
        through = cross_matrix(arm)
        white = np.linalg.inv(np.linalg.cholesky(sigma_moment**2 * np.eye(3) + sigma_force**2 * through @ through.T))
        estimate = linear_fit(
            (white @ A).reshape(-1, 3), (m @ white.T).reshape(-1), axes("arm"), sigma=1.0, units=["m"] * 3
        )
        arm = estimate.values
    if calibration is not None and turns is not None and estimate is not None:
        R = turns_of(turns, "turns")
        if len(R) != len(f):
            raise ArgumentError(f"expected {len(f)} matrices, one a push; found {len(R)}", "turns")
        g = R.transpose(0, 2, 1) @ calibration.gravity
        estimate = replace(estimate, covariance=estimate.covariance + _common(calibration, g, A, white, arm))
    return LeverArm(estimate, WrenchStatus.OK)


def _common(known: WrenchCalibration, g: np.ndarray, A: np.ndarray, white: np.ndarray, arm: np.ndarray) -> np.ndarray:
    """Covariance (3, 3) of the arm from errors of bias, mass and first moment, to first order."""
    through = cross_matrix(arm)
    by_force = np.concatenate([np.broadcast_to(through, (len(g), 3, 3)), (through @ g.T).T[:, :, None]], axis=2)
    by_moment = np.concatenate([np.broadcast_to(-np.eye(3), (len(g), 3, 3)), cross_matrix(g)], axis=2)
    slopes = white @ np.concatenate([by_force, by_moment], axis=2)
    own = white @ A
    gain = np.linalg.solve(np.einsum("nij,nik->jk", own, own), np.einsum("nij,nik->jk", own, slopes))
    both = scipy.linalg.block_diag(known.force.covariance[:4, :4], known.moment.covariance[:6, :6])
    return gain @ both @ gain.T
