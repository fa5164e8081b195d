"""The L1 prototype in a cell: a goal, the force that its motors have, and a wall at x that may come closer."""

import gtmodel as gt
from gtmodel.lang.model import dependent


class Cell(gt.Optimization):
    """The tool goes to `goal`. Goal, force limit and wall are parameters, which a predictive controller takes in each
    cycle; `load` is to stay within -1 and 1, `room` above 0."""

    robot = gt.part(dependent(gt.robots.gantry_tau("l1_tape", inertia="model_2", velocity_scale=0.1)))
    goal = gt.parameter([0.5, -0.9, 0.3], unit="m")
    force_limit = gt.parameter(700.0, unit="N", positive=True)
    wall = gt.parameter(2.0, unit="m", description="largest x of the tool")
    load = gt.variable(3, description="motor forces over their limit")
    room = gt.variable(unit="m", description="distance to the wall")
    place = gt.parameter(0.002, unit="m", description="deviation from the goal that counts 1")
    speed = gt.parameter(0.5, unit="m/s", description="speed that counts 1")
    acceleration = gt.parameter(15.0, unit="m/s2", description="acceleration that counts 1")

    def equations(self):
        for k in range(3):
            yield self.load[k] * self.force_limit == self.robot.tau[k]
        yield self.room == self.wall - self.robot.T[0]

    def objective(self):
        T, entries = self.robot.T, range(3)
        away = sum(((T[k] - self.goal[k]) / self.place) ** 2 for k in entries)
        moving = sum((gt.der(T[k]) / self.speed) ** 2 for k in entries)
        return gt.integral(away + moving + sum((gt.der(T[k], 2) / self.acceleration) ** 2 for k in entries))
