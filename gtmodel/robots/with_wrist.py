"""A three-link Gantry-Tau with the two-axis serial wrist of D1 and L1: five degrees of freedom."""

from __future__ import annotations

from typing import Any

import numpy as np

from .. import lang as gt
from ..mechanics import Frame, PointFrame, Wrist
from . import catalogue
from .three_link import GantryTau

WRIST_START = (0.0, 0.5)  # away from the singularity at which the first angle has no effect


class HeldPlate(gt.Model):
    """A massless plate that the link clusters keep at the orientation R: its `frame` moves with `point`.

    The clusters bear any torque, so the model has no torque balance.
    """

    R = gt.parameter(np.eye(3), unit="1", kind="rotation", description="rotation from plate to world coordinates")
    point = gt.port(PointFrame)
    frame = gt.port(Frame)

    def equations(self):
        yield gt.tree_root(self.frame)
        yield self.frame.r == self.point.r
        yield self.R == self.frame.R
        yield self.frame.w == np.zeros(3)
        yield self.point.f + self.frame.f == 0


class GantryTauWrist(GantryTau):
    """Gantry-Tau with a serial wrist on its plate: axes (5), tool point P [m] and tool orientation R_tool.

    axes[0:3] are the carts q [m], axes[3:5] the wrist angles [rad]; `direction` is the tool's z axis in the world. T is
    the point of the plate that carries the wrist; the plate has the constant orientation R_plate. No dimensions are
    printed: those of Wrist are an EXAMPLE OF OURS. Inverse kinematics has a closed form for known P and wrist angles.
    For known P, direction[0] and direction[1] it is a Newton iteration in the two angles, singular if the tool points
    along the first axis.

    Axes that put the tool at a point with its z axis at 30 degrees to the vertical:

    >>> robot = gt.robots.gantry_tau_wrist("l1_tape")
    >>> ik = robot.causal(known=["P", "direction[0]", "direction[1]"], targets="axes")
    >>> axes, status = ik([0.9, -0.9, 0.3], 0.5, 0.0)
    >>> print(axes.round(3), status)
    [-0.678 -0.794 -0.552  0.     0.524] OK
    """

    R_plate = gt.parameter(np.eye(3), unit="1", kind="rotation", description="the plate's constant orientation")
    axes = gt.variable(5, description="carts [m], wrist angles [rad]")
    P = gt.variable(3, unit="m", description="tool point")
    R_tool = gt.variable((3, 3), unit="1", prefer=-4, description="rotation from tool to world coordinates")
    direction = gt.variable(3, unit="1", description="z axis of the tool, world coordinates")
    held = gt.part(HeldPlate, R=R_plate)
    wrist = gt.part(Wrist, q=dict(start=list(WRIST_START)))

    def equations(self):
        yield from super().equations()
        yield gt.connect(self.plate.frame, self.held.point)
        yield gt.connect(self.held.frame, self.wrist.mount)
        for i in range(3):
            yield self.axes[i] == self.q[i]
        for i in range(2):
            yield self.axes[3 + i] == self.wrist.q[i]
        yield self.P == self.wrist.tool.r
        yield self.R_tool == self.wrist.tool.R
        for i in range(3):
            yield self.direction[i] == self.wrist.tool.R[i, 2]


def gantry_tau_wrist(name: str = "l1_tape", **modifiers: Any) -> GantryTauWrist:
    """Return a three-link robot of the catalogue with the wrist, whose dimensions are an example of ours (see Wrist).

    modifiers: any parameter of GantryTauWrist. Raises ModelError for an unknown name.

    Tool point and z axis of the tool from carts [m] and wrist angles [rad]:

    >>> robot = gt.robots.gantry_tau_wrist("l1_tape")
    >>> fk = robot.causal(known="axes", targets=["P", "direction"])
    >>> P, direction, status = fk([-0.7, -0.8, -0.6, 0.0, np.pi / 6])
    >>> print(P.round(3), direction.round(3) + 0.0)
    [ 0.871 -0.883  0.273] [0.5   0.    0.866]
    """
    robot = catalogue.gantry_tau(name)
    return GantryTauWrist(**{**robot._modifiers, **modifiers})
