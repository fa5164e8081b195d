"""A linear delta printer: three vertical towers, a carriage on each, an arm from each carriage to the nozzle.

Geometry and names follow Klipper (Delta_Calibrate.md, kinematics/delta.py). The closure equations are
|T - c_k|^2 = arm_k^2 with the carriage joints c_k. Nominal dimensions of the FLSun V400, rounded to full millimetres.
"""

import numpy as np

import gtmodel as gt
from gtmodel.mechanics import PointFrame


class Tower(gt.Model):
    """A carriage that has travelled q down from its end stop, and the arm to `tip`."""

    radius = gt.parameter(unit="m", positive=True, description="radius of the circle of the three towers")
    angle = gt.parameter(unit="rad", description="angle of the tower on the circle, from x")
    arm = gt.parameter(unit="m", positive=True, description="length between the joints")
    end = gt.parameter(unit="m", description="nozzle height with all carriages at an end stop of this height")
    q = gt.variable(unit="m", description="travel of the carriage, from the end stop down")
    tip = gt.port(PointFrame)

    def equations(self):
        height = self.end + gt.sqrt(self.arm**2 - self.radius**2) - self.q
        at = [self.radius * gt.cos(self.angle), self.radius * gt.sin(self.angle), height]
        d = [self.tip.r[k] - at[k] for k in range(3)]
        yield gt.dot(d, d) == self.arm**2
        yield gt.branch("below", height - self.tip.r[2])


class Delta(gt.Model):
    """Carriages q [m], nozzle T [m] above the bed: radius, three angles, arms and end stops.

    With the nozzle at the centre, the vertical extent of an arm is sqrt(arm^2 - radius^2), so T[2] = end - q for equal
    towers. The angle of the third tower defines the frame, so it must stay fixed in a calibration.
    """

    radius = gt.parameter(0.160, unit="m", positive=True, description="radius of the circle of the towers")
    angle = gt.parameter(np.radians([210.0, 330.0, 90.0]), unit="rad", description="angles of the towers, from x")
    arm = gt.parameter([0.345] * 3, unit="m", positive=True, description="lengths of the arms")
    end = gt.parameter([0.418] * 3, unit="m", description="heights of the nozzle at the end stops")
    q = gt.variable(3, unit="m", description="travels of the carriages, from their end stops down")
    T = gt.variable(3, unit="m", start=[0.0, 0.0, 0.016], prefer=1, description="nozzle")
    tower = gt.parts(3, Tower, radius=lambda self: [self.radius] * 3, angle=angle, arm=arm, end=end)

    def equations(self):
        for k, tower in enumerate(self.tower):
            yield tower.q == self.q[k]
            yield tower.tip.r == self.T
