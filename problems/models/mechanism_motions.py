"""The fastest motions of three parallel robots from rest to rest, within the torques of their motors."""

from mechanisms import Delta, FiveBar, ThreeArms

import gtmodel as gt
from gtmodel import der


class Fastest(gt.Optimization):
    """Least time between two poses, plus a small cost of effort: without it many motions are equally fast."""

    robot: gt.Model
    final_time = gt.free(0.4, min=0.05, unit="s")
    torque = gt.parameter(20.0, unit="N.m", positive=True)
    speed = gt.parameter(12.0, unit="rad/s", positive=True)
    weight = gt.parameter(0.05, unit="1")
    start: tuple[float, ...]
    goal: tuple[float, ...]

    def pose(self):
        """Coordinates of the pose: the position of a planar tool."""
        return [self.robot.x[0], self.robot.x[1]]

    def objective(self):
        tau = self.robot.tau
        effort = sum((tau[k] / self.torque) ** 2 for k in range(tau.shape[0]))
        return self.final_time + self.weight * gt.integral(effort)

    def constraints(self):
        for k in range(self.robot.q.shape[0]):
            yield gt.between(-self.torque, self.robot.tau[k], self.torque)
            yield gt.between(-self.speed, der(self.robot.q[k]), self.speed)
        for time, values in ((self.start_time, self.start), (self.final_time, self.goal)):
            for x, value in zip(self.pose(), values, strict=True):
                yield x.at(time) == value
                yield der(x).at(time) == 0


class DeltaMotion(Fastest):
    robot = gt.part(Delta)
    start, goal = (-0.2, 0.0, -0.8), (0.2, 0.1, -0.7)

    def pose(self):
        return [self.robot.T[k] for k in range(3)]


class FiveBarMotion(Fastest):
    robot = gt.part(FiveBar)
    torque = gt.parameter(12.0, unit="N.m", positive=True)
    start, goal = (0.0, 0.55), (0.45, 0.65)


class ThreeArmsMotion(Fastest):
    robot = gt.part(ThreeArms)
    torque = gt.parameter(5.0, unit="N.m", positive=True)
    start, goal = (0.35, 0.2, 0.0), (0.45, 0.3, 0.4)

    def pose(self):
        return [*super().pose(), self.robot.angle]
