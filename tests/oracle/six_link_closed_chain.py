"""The six-link Gantry-Tau as a closed chain in pinocchio: three carts, six uniform rods, one plate."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from tests.oracle.six_link import SixLinkByHand


class ClosedChain:
    """Three carts, six rods, one plate in pinocchio; accelerations (qdd, Tdd, dw/dt) by a KKT system."""

    def __init__(self, hand: SixLinkByHand) -> None:
        self.hand = hand
        model = pin.Model()
        identity = pin.SE3.Identity()
        self.ends, self.sockets = [], []
        carts = []
        for i in range(3):
            v = hand.v[hand.arm == i]
            assert np.ptp(v, axis=0).max() == 0, "a prismatic joint has one direction for all links"
            scale = np.linalg.norm(v[0])
            assert scale == 1.0
            carts.append(model.addJoint(0, pin.JointModelPrismaticUnaligned(*v[0]), identity, f"cart_{i}"))
            model.appendBodyToJoint(carts[i], pin.Inertia(float(hand.m_c[i]), np.zeros(3), np.zeros((3, 3))), identity)
        rods = []
        for k in range(6):
            at = pin.SE3(np.eye(3), hand.A[k])
            first = model.addJoint(carts[hand.arm[k]], pin.JointModelRY(), at, f"rod_{k}_y")
            rods.append(model.addJoint(first, pin.JointModelRZ(), identity, f"rod_{k}_z"))
            m, L = hand.m_a[k], hand.L[k]
            inertia = np.diag([0.0, m * L**2 / 12, m * L**2 / 12])
            model.appendBodyToJoint(rods[k], pin.Inertia(float(m), np.array([L / 2, 0, 0]), inertia), identity)
        plate = model.addJoint(0, pin.JointModelFreeFlyer(), identity, "plate")
        model.appendBodyToJoint(plate, pin.Inertia(float(hand.m_p), hand.c_p, hand.I_p), identity)
        for k in range(6):
            end = pin.SE3(np.eye(3), np.array([hand.L[k], 0, 0]))
            self.ends.append(model.addFrame(pin.Frame(f"end_{k}", rods[k], 0, end, pin.FrameType.OP_FRAME)))
            socket = pin.SE3(np.eye(3), hand.B[k])
            self.sockets.append(model.addFrame(pin.Frame(f"socket_{k}", plate, 0, socket, pin.FrameType.OP_FRAME)))
        self.model, self.data = model, model.createData()

    def accelerations(self, q, T, R, qd, tau):
        model, data, n = self.model, self.data, self.model.nv
        u = self.hand.links(q, T, R) / self.hand.L[:, None]
        angles = np.column_stack([np.arctan2(-u[:, 2], u[:, 0]), np.arcsin(u[:, 1])]).reshape(-1)
        x = np.concatenate([q, angles, T, pin.Quaternion(R).coeffs()])
        pin.computeJointJacobians(model, data, x)
        pin.updateFramePlacements(model, data)
        frame = pin.LOCAL_WORLD_ALIGNED
        gap = [data.oMf[a].translation - data.oMf[b].translation for a, b in zip(self.ends, self.sockets, strict=True)]
        assert np.max(np.abs(gap)) < 1e-12
        J = np.vstack(
            [
                (pin.getFrameJacobian(model, data, a, frame) - pin.getFrameJacobian(model, data, b, frame))[:3]
                for a, b in zip(self.ends, self.sockets, strict=True)
            ]
        )
        velocity = np.concatenate([qd, np.linalg.lstsq(J[:, 3:], -J[:, :3] @ qd, rcond=None)[0]])
        assert np.max(np.abs(J @ velocity)) < 1e-11
        pin.forwardKinematics(model, data, x, velocity, np.zeros(n))
        drift = np.concatenate(
            [
                (
                    pin.getFrameClassicalAcceleration(model, data, a, frame)
                    - pin.getFrameClassicalAcceleration(model, data, b, frame)
                ).linear
                for a, b in zip(self.ends, self.sockets, strict=True)
            ]
        )
        # by unit accelerations: which triangle crba fills differs between versions of pinocchio
        rest, bias = (pin.rnea(model, data, x, v, np.zeros(n)).copy() for v in (np.zeros(n), velocity))
        M = np.column_stack([pin.rnea(model, data, x, np.zeros(n), unit) - rest for unit in np.eye(n)])
        force = np.concatenate([tau, np.zeros(n - 3)]) - bias
        kkt = np.block([[M, J.T], [J, np.zeros((18, 18))]])
        a = np.linalg.solve(kkt, np.concatenate([force, -drift]))[:n]
        plate, twist = a[-6:], velocity[-6:]
        return np.concatenate([a[:3], R @ (plate[:3] + np.cross(twist[3:], twist[:3])), R @ plate[3:]])
