"""A serial wrist with two revolute joints."""

from __future__ import annotations

from .. import lang as gt
from .bodies import RigidBody
from .drives import TorqueMotor
from .frames import Frame
from .friction_rotational import RotationalTanhFriction
from .joints import Revolute
from .placements import FixedTranslation


class WristAxis(gt.Model):
    """One driven revolute axis with the body that it turns; `tip` is parallel to the body, displaced by d.

    Motor torque that holds a forearm of 0.3 m level, with the axis along y:

    >>> bench = gt.Builder("bench")
    >>> body = dict(m=2.0, c=[0.15, 0.0, 0.0], I=0.01 * np.eye(3))
    >>> axis = gt.mechanics.WristAxis(axis=[0.0, 1.0, 0.0], d=[0.3, 0.0, 0.0], body=body)
    >>> ground = bench.part("ground", gt.mechanics.Ground())
    >>> forearm = bench.part("forearm", axis)
    >>> bench.add(gt.connect(ground.frame, forearm.mount))
    >>> f = bench.causal(known="forearm.joint.shaft.phi", targets=["forearm.tip.r", "forearm.motor.torque"])
    >>> r, torque, status = f(0.0, 0.0, 0.0)
    >>> print(r + 0.0, round(torque, 6))
    [0.3 0.  0. ] -2.943
    """

    axis = gt.parameter(
        shape=3, unit="1", kind="direction", description="direction of the axis, coordinates of the mount"
    )
    d = gt.parameter(shape=3, unit="m", description="displacement from the axis to the tip, body coordinates")
    mount = gt.port(Frame)
    tip = gt.port(Frame)
    joint = gt.part(Revolute, axis=axis)
    body = gt.part(RigidBody)
    reach = gt.part(FixedTranslation, d=d)
    motor = gt.part(TorqueMotor)
    friction = gt.part(RotationalTanhFriction)

    def equations(self):
        yield gt.connect(self.mount, self.joint.a)
        yield gt.connect(self.joint.b, self.body.frame)
        yield gt.connect(self.joint.b, self.reach.a)
        yield gt.connect(self.reach.b, self.tip)
        yield gt.connect(self.joint.shaft, self.motor.shaft)
        yield gt.connect(self.joint.shaft, self.friction.shaft)


class Wrist(gt.Model):
    """Two-DOF serial wrist, as mounted on the plates of D1 and L1 (Dressler 2012, section 2.3): angles q [rad], motor
    torques tau [N.m].

    The first axis is along z of the mount, the second along y of the first body. No dimensions are printed: the
    defaults are an EXAMPLE OF OURS, slender steel bodies of 0.12 m and 0.08 m.

    At q = 0 the tool points down; with the second axis at 90 degrees it points along -x of the mount:

    >>> bench = gt.Builder("bench")
    >>> ground = bench.part("ground", gt.mechanics.Ground())
    >>> wrist = bench.part("wrist", gt.mechanics.Wrist())
    >>> load = bench.part("load", gt.mechanics.FrameLoad())
    >>> bench.add(gt.connect(ground.frame, wrist.mount), gt.connect(wrist.tool, load.frame))
    >>> f = bench.causal(known=["wrist.q", "load.force", "load.torque"], targets=["wrist.tool.r", "wrist.tau"])
    >>> rest = np.zeros(2)
    >>> r, tau, status = f([0.0, np.pi / 2], rest, rest, np.zeros(3), np.zeros(3))
    >>> print(r.round(6) + 0.0, tau.round(3) + 0.0)
    [-0.08  0.   -0.12] [0.    0.471]
    """

    axis = gt.parameter(
        [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]], unit="1", kind="direction", description="axes, one row each"
    )
    d = gt.parameter([[0.0, 0.0, -0.12], [0.0, 0.0, -0.08]], unit="m", description="from each axis to the next frame")
    m = gt.parameter([2.0, 1.2], unit="kg", min=0.0, description="masses of the two bodies")
    c = gt.parameter([[0.0, 0.0, -0.06], [0.0, 0.0, -0.04]], unit="m", description="centres of mass")
    J = gt.parameter(
        [[3e-3, 3e-3, 1e-3], [1e-3, 1e-3, 5e-4]],
        unit="kg.m2",
        min=0.0,
        description="principal moments of inertia, body axes",
    )
    mount = gt.port(Frame)
    tool = gt.port(Frame)
    q = gt.variable(2, unit="rad", start=[0.0, 0.0], prefer=1, description="joint angles")
    tau = gt.input(2, unit="N.m", nominal=10.0, description="motor torques")
    link = gt.parts(
        2,
        WristAxis,
        axis=axis,
        d=d,
        body=lambda self: [dict(m=self.m[i], c=self.c[i], I=_diagonal(self.J[i])) for i in range(2)],
    )

    def equations(self):
        first, second = self.link
        yield gt.connect(self.mount, first.mount)
        yield gt.connect(first.tip, second.mount)
        yield gt.connect(second.tip, self.tool)
        for i, link in enumerate(self.link):
            yield self.q[i] == link.joint.shaft.phi
            yield self.tau[i] == link.motor.torque


def _diagonal(x):
    return [[x[0], 0.0, 0.0], [0.0, x[1], 0.0], [0.0, 0.0, x[2]]]
