"""Where a serial arm stands and how it moves there, from its own equations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..results import Status
from .static_tests import StaticTests, at_tool


@dataclass(frozen=True, eq=False)
class ArmPoses:
    """n poses q (n, k) [rad]: tool centre point T (n, 3) [m], its Jacobian J (n, 6, k), wrist centre W (n, 3) with
    J_wrist (n, 3, k), origins of the joints (n, k, 3), rotation R (n, 3, 3) of the flange; world coordinates."""

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
    """Of a model with angles q and variables T, R, v, w, W, v_W and parts link, as `robots.SphericalWristArm`.

    q (n, k) [rad]; tool (3) [m]: tool centre point in flange coordinates. Raises ValueError for a pose that the model
    cannot be evaluated at.
    """
    q = np.atleast_2d(np.asarray(q, float))
    n, k = q.shape
    names = [f"link[{i}].joint.a.r" for i in range(k)]
    unit = np.tile(np.eye(k), (n, 1))
    # one function: its rows are the unit rates at each pose
    found = model.causal(known="q", targets=["T", "R", "W", *names, "v", "w", "v_W"])(np.repeat(q, k, axis=0), unit)
    *placed, v, w, v_W, moving = found
    T, R, W, *origins = (np.asarray(x)[::k] for x in placed)
    status = moving.reshape(n, k).max(axis=1)
    if np.any(status != Status.OK):
        bad = int(np.argmax(status != Status.OK))
        raise ValueError(f"pose {bad} cannot be evaluated: {Status(int(status[bad])).sentence}")
    columns = [np.swapaxes(x.reshape(n, k, 3), 1, 2) for x in (v, w, v_W)]
    arm = R @ np.asarray(tool, float)
    J = at_tool(np.concatenate(columns[:2], axis=1), arm)
    return ArmPoses(q, T + arm, J, W, columns[2], np.stack(origins, axis=1), R)
