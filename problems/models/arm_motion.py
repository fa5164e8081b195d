"""The fastest motion of a six-axis arm between two joint poses, within the limits of its URDF."""

from pathlib import Path

import numpy as np

import gtmodel as gt
from gtmodel import der

ARM = gt.robots.from_urdf(Path(__file__).with_name("arm.urdf"))
START = np.radians([-60, 20, 70, 0, 60, 0])
GOAL = np.radians([60, 50, 20, 45, 30, 90])


class ArmMotion(gt.Optimization):
    """From rest to rest in the least time, plus a small cost of effort: without it many motions are equally fast."""

    final_time = gt.free(1.0, min=0.1, unit="s")
    weight = gt.parameter(0.2, unit="1")
    effort = gt.parameter(ARM.effort_limits, unit="N.m")
    arm = gt.part(ARM)

    def objective(self):
        shares = [self.arm.tau[k] / self.effort[k] for k in range(6)]
        return self.final_time + self.weight * gt.integral(sum(share**2 for share in shares))

    def constraints(self):
        q, tau = self.arm.q, self.arm.tau  # the position limits of the URDF are bounds of q already
        for k in range(6):
            yield gt.between(-ARM.effort_limits[k], tau[k], ARM.effort_limits[k])
            yield gt.between(-ARM.speed_limits[k], der(q[k]), ARM.speed_limits[k])
            for time, pose in ((self.start_time, START), (self.final_time, GOAL)):
                yield q[k].at(time) == pose[k]
                yield der(q[k]).at(time) == 0
