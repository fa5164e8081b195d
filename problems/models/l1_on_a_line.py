"""The L1 prototype restricted to a line: one input, the second derivative of the path coordinate."""

import gtmodel as gt
from gtmodel.lang.model import dependent


class OnALine(gt.Model):
    """T = begin + s * way; `drive` is the second derivative of s. The motor forces follow."""

    robot = gt.part(dependent(gt.robots.gantry_tau("l1_tape", inertia="model_2", velocity_scale=0.1), "tau"))
    begin = gt.parameter([0.2, -0.9, 0.2], unit="m")
    way = gt.parameter([0.3, 0.05, 0.1], unit="m")
    s = gt.variable(start=0.0, prefer=2, description="path coordinate")
    drive = gt.input(unit="1/s2", nominal=10.0)

    def equations(self):
        yield self.robot.T == self.begin + self.s * self.way
        yield self.drive == gt.der(self.s, 2)
