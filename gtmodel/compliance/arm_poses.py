"""Poses of a serial arm and its Jacobians there, from its own equations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..results import Status
from .static_tests import StaticTests, at_tool


@dataclass(frozen=True, eq=False)
class ArmPoses:
    """n poses of an arm with k joints, world coordinates.

    q (n, k) [rad]; tool centre point T (n, 3) [m] and its geometric Jacobian J (n, 6, k), linear rows [m] before
    angular ones; wrist centre W (n, 3) [m] with J_wrist (n, 3, k); origins of the joints (n, k, 3) [m]; rotation R (n,
    3, 3) of the flange.
    """

    q: np.ndarray
    T: np.ndarray
    J: np.ndarray
    W: np.ndarray
    J_wrist: np.ndarray
    origins: np.ndarray
    R: np.ndarray

    def tests(
        self,
        wrenches: ArrayLike,
        *,
        sigma: ArrayLike,
        wrist_sigma: float | None = None,
        K_c: np.ndarray | None = None,
    ) -> StaticTests:
        """Tests at these poses under wrenches (n, 6) [N, N.m] at T, with displacements of zero: planned, not measured.

        sigma (6,): standard deviations of the displacement [m, rad]; wrist_sigma [m] where the wrist centre has a
        target of its own. Raises ValueError for wrong shapes.
        """
        n = len(self.q)
        wrenches = np.asarray(wrenches, float)
        return StaticTests(
            self.J,
            self.J_wrist,
            wrenches,
            np.zeros((n, 6)),
            np.tile(np.diag(np.broadcast_to(np.asarray(sigma, float), (6,)) ** 2), (n, 1, 1)),
            self.W - self.T,
            None if wrist_sigma is None else np.zeros((n, 3)),
            None if wrist_sigma is None else np.tile(wrist_sigma**2 * np.eye(3), (n, 1, 1)),
            K_c,
        )


def arm_poses(model: Any, q: ArrayLike, tool: ArrayLike = (0.0, 0.0, 0.0)) -> ArmPoses:
    """Tool centre point, Jacobians and wrist centre of a serial arm at joint angles q (n, k) [rad]: `ArmPoses`.

    model: an arm with angles q, variables T, R, v, w, W, v_W and parts link, as `robots.SphericalWristArm`.
    tool (3,) [m]: tool centre point in flange coordinates. Raises ValueError for a pose at which the model cannot be
    evaluated.

    >>> poses = gt.compliance.arm_poses(gt.robots.kr500(), np.deg2rad([[0, -90, 90, 0, -60, 0]]), tool=[0.1, 0, 0.4])
    >>> poses.T.round(3), poses.J.shape
    (array([[1.957, 0.   , 2.838]]), (1, 6, 6))
    """
    q = np.atleast_2d(np.asarray(q, float))
    n, k = q.shape
    names = [f"link[{i}].joint.a.r" for i in range(k)]
    unit = np.tile(np.eye(k), (n, 1))
    # one function: its rows are the unit rates at each pose
    solution = model.causal(known="q", targets=["T", "R", "W", *names, "v", "w", "v_W"])(np.repeat(q, k, axis=0), unit)
    *placed, v, w, v_W, moving = solution
    T, R, W, *origins = (np.asarray(x)[::k] for x in placed)
    status = moving.reshape(n, k).max(axis=1)
    if np.any(status != Status.OK):
        bad = int(np.argmax(status != Status.OK))
        raise ValueError(f"pose {bad} cannot be evaluated: {Status(int(status[bad])).message}")
    columns = [np.swapaxes(x.reshape(n, k, 3), 1, 2) for x in (v, w, v_W)]
    arm = R @ np.asarray(tool, float)
    J = at_tool(np.concatenate(columns[:2], axis=1), arm)
    return ArmPoses(q, T + arm, J, W, columns[2], np.stack(origins, axis=1), R)
