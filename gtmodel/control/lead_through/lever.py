"""Where a force acts: the lever arm from the sensor to a tip or a grip, from wrenches of pushes without a torque."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ...inference import linear_fit
from ...results import Estimate
from .calibration import cross_matrices
from .status import WrenchStatus
from .wrench import axes, rows_of, sigma_of

ABOVE_NOISE = 50.0  # forces over their noise: noise in forces then draws the arm to zero by 1/2500 at most
PASSES = 3  # the noise of a torque depends on the arm, weakly


@dataclass(frozen=True, eq=False)
class LeverArm:
    """estimate: of arm_x, arm_y, arm_z [m], sensor's origin to the point of the forces, in the sensor's frame; None
    where status is not OK. status: NO_FORCE, or ONE_DIRECTION where the pushes do not tell the arm along them.
    """

    estimate: Estimate | None
    status: WrenchStatus


def lever_arm(forces: ArrayLike, moments: ArrayLike, *, sigma_force: float, sigma_moment: float) -> LeverArm:
    """The point at which pure forces act, from wrenches without bias and weight: moment = arm x force.

    Args:
        forces, moments: (pushes, 3) [N], [N m] in the sensor's frame, in two directions at least, for instance pushes
            of a fixed point against the tip; as `WrenchCalibration.contact` returns them.
        sigma_force, sigma_moment: standard deviation of one reading [N], [N m].

    Least squares of the moments, weighted with the noise of both (that of the forces acts through the arm). Forces must
    exceed 50 sigma_force (root mean square, across any one direction too), else the status says so. Raises
    ArgumentError for other shapes, numbers that are not finite, and standard deviations that are not positive.

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
    A = -cross_matrices(f)
    least = len(f) * (ABOVE_NOISE * sigma_force) ** 2
    if np.sum(f**2) < least:
        return LeverArm(None, WrenchStatus.NO_FORCE)
    if np.linalg.eigvalsh(np.einsum("nij,nik->jk", A, A))[0] < least:
        return LeverArm(None, WrenchStatus.ONE_DIRECTION)
    arm, estimate = np.zeros(3), None
    for _ in range(PASSES):
        through = cross_matrices(arm[None])[0]
        white = np.linalg.inv(np.linalg.cholesky(sigma_moment**2 * np.eye(3) + sigma_force**2 * through @ through.T))
        estimate = linear_fit(
            (white @ A).reshape(-1, 3), (m @ white.T).reshape(-1), axes("arm"), sigma=1.0, units=["m"] * 3
        )
        arm = estimate.values
    return LeverArm(estimate, WrenchStatus.OK)
