"""A serial arm on springs in its joints, over the vertical plane in which it stands."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..geometry.rotations import within_pi
from ..kinematics.section import SectionPlane
from ..kinematics.wrist_partition import WristPartition
from ..lang import Model
from ..results import ArgumentError, Status
from .arm_poses import ArmPoses, arm_poses
from .options import ArmSprings, Load
from .sprung_links import ComplianceAtPoses

Array = np.ndarray
OUTSIDE = "beyond the joints' limits"


class SprungArm:
    """A serial arm with a wrist in one point. Raises ArgumentError."""

    def __init__(self, model: Model, arm: ArmSprings, load: Load, pose: Sequence[float] | None) -> None:
        self.model, self.load = model, load
        if len(arm.joint) != 6:
            raise ArgumentError(f"has {len(arm.joint)} numbers; expected 6, one per joint", "springs.joint")
        self.compliance = 1 / np.asarray(arm.joint)
        self.tool = np.asarray(arm.tool)
        q = np.array([arm.pose])
        try:
            self.partition = WristPartition.of(model.origins, model.axes)  # pyright: ignore[reportAttributeAccessIssue]
            held = arm_poses(model, q, arm.tool)
        except (AttributeError, ValueError) as error:
            raise ArgumentError(f"expected a serial arm such as kr500; {error}", "robot") from error
        self.R = held.R[0]
        self.limits = getattr(model, "joint_limits", None)
        self.home = held.T[0] if pose is None else np.asarray(pose, float)
        branches = self.partition.inverse(held.T - self.R @ self.tool, self.R[None]).q[0]
        self.branch = int(np.nanargmin(np.abs(within_pi(branches - q[0])).sum(axis=1)))
        across = np.array([np.cos(-q[0, 0]), np.sin(-q[0, 0]), 0.0])
        normal = np.cross(across, [0.0, 0.0, 1.0])
        self.section = SectionPlane((self.home @ normal) * normal, across, np.array([0.0, 0.0, 1.0]), normal)
        self.marks = np.zeros((0, 2))

    @property
    def window(self) -> tuple[Array, Array]:
        far = sum(self.partition.reach[1:]) + abs(self.partition.base[0]) + self.partition.flange
        far += float(np.linalg.norm(self.tool))
        return np.array([0.0, self.partition.base[1] - far]), np.array([far, self.partition.base[1] + far])

    @property
    def assumptions(self) -> list[str]:
        endless = ["no joint limits are known of this robot: poses beyond them count as reachable"]
        return [
            "joints are compliant about their axes alone, motors hold still; links and bearings are rigid",
            "the tool keeps the orientation of arm.pose_deg, the arm its branch",
            *(endless if self.limits is None else []),
        ]

    def __call__(self, T: Array) -> ComplianceAtPoses:
        T = np.atleast_2d(np.asarray(T, float))
        n = len(T)
        branches = self.partition.inverse(T - self.R @ self.tool, np.tile(self.R, (n, 1, 1)))
        q, status = branches.q[:, self.branch], branches.status[:, self.branch]
        reason = ["" if code == Status.OK else Status(int(code)).message for code in status]
        if self.limits is not None:
            low, high = self.limits.T
            turned = q + 2 * np.pi * np.ceil((low - q - 1e-9) / (2 * np.pi))
            out = np.any(turned > high + 1e-9, axis=1)
            reason = [r or (OUTSIDE if o else "") for r, o in zip(reason, out, strict=True)]
        good = np.array([not r for r in reason])
        C, moved, work = np.full((n, 6, 6), np.nan), np.full((n, 6), np.nan), np.full((n, 6), np.nan)
        load = np.array([*self.load.force, *self.load.moment])
        if good.any():
            poses: ArmPoses = arm_poses(self.model, q[good], self.tool)
            C[good] = (poses.J * self.compliance) @ np.swapaxes(poses.J, 1, 2)
            torque = np.einsum("nij,i->nj", poses.J, load)
            turned = self.compliance * torque
            moved[good] = np.einsum("nij,nj->ni", poses.J, turned)
            work[good] = torque * turned / 2
        shares = None
        if np.any(load):
            shares = {f"joint_{k + 1}": w for k, w in enumerate((work / work.sum(axis=1, keepdims=True)).T)}
        return ComplianceAtPoses(C, moved, reason, shares=shares)
