"""Rigid connections by the numbers in which serial arms are published: xyz and rpy of URDF, Denavit and Hartenberg."""

from __future__ import annotations

import numpy as np

from .. import lang as gt
from .fixed import rigid
from .frames import Frame
from .rotation import rotation_about

X, Y, Z = np.eye(3)


class _Placement(gt.Model):
    """Frame b fixed to frame a, massless: subclasses say where."""

    a = gt.port(Frame)
    b = gt.port(Frame)


class FixedRpy(_Placement):
    """Frame b at `xyz` [m] in a, turned by `rpy` [rad]: Rz(yaw) Ry(pitch) Rx(roll), the origin of a joint in URDF.

    >>> bench = gt.Builder("bench")
    >>> ground, load = bench.part("ground", gt.mechanics.Ground()), bench.part("load", gt.mechanics.FrameLoad())
    >>> arm = bench.part("arm", gt.mechanics.FixedRpy(xyz=[0.5, 0.0, 0.0], rpy=[0.0, 0.0, np.pi / 2]))
    >>> tool = bench.part("tool", gt.mechanics.FixedTranslation(d=[0.2, 0.0, 0.0]))
    >>> bench.add(gt.connect([ground.frame, arm.b, tool.b], [arm.a, tool.a, load.frame]))
    >>> r, status = bench.causal(known=["load.force", "load.torque"], targets="tool.b.r")()
    >>> r.round(6)
    array([0.5, 0.2, 0. ])
    """

    xyz = gt.parameter([0.0, 0.0, 0.0], unit="m", description="origin of b, coordinates of a")
    rpy = gt.parameter([0.0, 0.0, 0.0], unit="rad", description="roll, pitch, yaw about the fixed axes x, y, z of a")

    def equations(self):
        displacement = self.xyz
        roll, pitch, yaw = (self.rpy[k] for k in range(3))
        rotation = rotation_about(Z, yaw) @ rotation_about(Y, pitch) @ rotation_about(X, roll)
        yield from rigid(self.a, self.b, displacement, rotation)


class _DenavitHartenberg(_Placement):
    theta = gt.parameter(0.0, unit="rad", description="angle about z, added to the joint's")
    d = gt.parameter(0.0, unit="m", description="distance along z")
    a_x = gt.parameter(0.0, unit="m", description="link length a, distance along x")
    alpha = gt.parameter(0.0, unit="rad", description="twist, angle about x")
    beta = gt.parameter(0.0, unit="rad", description="Hayati's angle about y, for an axis nearly parallel to the next")


class FixedDH(_DenavitHartenberg):
    """Frame b by the standard Denavit-Hartenberg numbers, Rz(theta) Tz(d) Tx(a) Rx(alpha) Ry(beta) from frame a.

    A joint about or along z of a comes before it. `a_x` is the length called a. Where the next axis is nearly
    parallel, d and theta of two links cannot be distinguished and a small tilt moves the common normal far: leave d
    as it is there and let Hayati's beta turn; it is 0 elsewhere.

    >>> bench = gt.Builder("bench")
    >>> ground, load = bench.part("ground", gt.mechanics.Ground()), bench.part("load", gt.mechanics.FrameLoad())
    >>> link = bench.part("link", gt.mechanics.FixedDH(theta=np.pi / 2, d=0.4, a_x=0.3, alpha=np.pi / 2))
    >>> bench.add(gt.connect(ground.frame, link.a), gt.connect(link.b, load.frame))
    >>> f = bench.causal(known=["load.force", "load.torque"], targets=["link.b.r", "link.b.R"])
    >>> r, R, status = f()
    >>> print(r.round(6) + 0.0, R[:, 2].round(6) + 0.0)  # origin and z of the next frame
    [0.  0.3 0.4] [1. 0. 0.]
    """

    def equations(self):
        displacement = gt.vector([self.a_x * gt.cos(self.theta), self.a_x * gt.sin(self.theta), self.d])
        rotation = rotation_about(Z, self.theta) @ rotation_about(X, self.alpha) @ rotation_about(Y, self.beta)
        yield from rigid(self.a, self.b, displacement, rotation)


class FixedModifiedDH(_DenavitHartenberg):
    """Frame b by modified Denavit-Hartenberg numbers (Craig), Tx(a) Rx(alpha) Ry(beta) Rz(theta) Tz(d) from frame a.

    A joint about or along z of b comes after it; a, alpha and Hayati's beta lead from the axis before to this one.

    >>> bench = gt.Builder("bench")
    >>> ground, load = bench.part("ground", gt.mechanics.Ground()), bench.part("load", gt.mechanics.FrameLoad())
    >>> link = bench.part("link", gt.mechanics.FixedModifiedDH(a_x=0.3, alpha=-np.pi / 2, d=0.4))
    >>> bench.add(gt.connect(ground.frame, link.a), gt.connect(link.b, load.frame))
    >>> r, status = bench.causal(known=["load.force", "load.torque"], targets="link.b.r")()
    >>> r.round(6)
    array([0.3, 0.4, 0. ])
    """

    def equations(self):
        turned = rotation_about(X, self.alpha) @ rotation_about(Y, self.beta)
        displacement = self.a_x * X + self.d * (turned @ Z)
        rotation = rotation_about(X, self.alpha) @ rotation_about(Y, self.beta) @ rotation_about(Z, self.theta)
        yield from rigid(self.a, self.b, displacement, rotation)
