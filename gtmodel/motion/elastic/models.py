"""Optimal point-to-point motions of a three-link robot with its tool rigid, and on a spring."""

from __future__ import annotations

import numpy as np

from ... import lang as gt
from ...mechanics import PointMass, PointSpringDamper
from ...robots import GantryTau


class RigidMotion(GantryTau, gt.Optimization):
    """The optimal motion from rest to rest between two points: time plus energy, motor forces within +-F_max.

    `ElasticTask.models` makes it of a robot that carries the tool as payload.

    >>> from gtmodel.motion.elastic import ElasticCost, ElasticSolver, ElasticTask, ElasticTool
    >>> tool = ElasticTool(mass=5.0, frequency=6.0, damping=0.02)
    >>> task = ElasticTask(
    ...     robot=gt.robots.gantry_tau("l1_tape"), start=[0.0, -0.9, 0.1], goal=[0.2, -0.9, 0.2],
    ...     tool=tool, force=700.0, cost=ElasticCost(), solver=ElasticSolver(),
    ... )
    >>> rigid, _ = task.models
    >>> round(gt.solve(rigid, gt.Mesh(8)).final_time, 2)  # [s]
    0.37
    """

    final_time = gt.free(guess=1.2, min=0.2, unit="s")
    F_max = gt.parameter(unit="N", positive=True, description="largest force of a motor")
    weight = gt.parameter(0.0, unit="1", description="of the energy in the cost")
    F_unit = gt.parameter(unit="N", positive=True, description="force that counts 1 in the energy")
    start = gt.parameter(shape=3, unit="m", description="tool centre point at first")
    goal = gt.parameter(shape=3, unit="m", description="tool centre point in the end")

    def objective(self):
        return self.final_time + self.weight * gt.integral(gt.dot(self.tau, self.tau) / self.F_unit**2)

    def constraints(self):
        yield gt.between(-self.F_max, self.tau, self.F_max)
        for instant, place in ((0, self.start), (self.final_time, self.goal)):
            yield self.T.at(instant) == place
            yield gt.der(self.T).at(instant) == np.zeros(3)


class ElasticMotion(RigidMotion):
    """The motion of `RigidMotion` with a mass on a spring at the plate; the mass hangs at rest at the start and at the
    end.

    Raises ModelError for a negative mass, and for a stiffness or damping that is not positive semidefinite.

    >>> from gtmodel.motion.elastic import ElasticCost, ElasticSolver, ElasticTask, ElasticTool
    >>> tool = ElasticTool(mass=5.0, frequency=6.0, damping=0.02)
    >>> task = ElasticTask(
    ...     robot=gt.robots.gantry_tau("l1_tape"), start=[0.0, -0.9, 0.1], goal=[0.2, -0.9, 0.2],
    ...     tool=tool, force=700.0, cost=ElasticCost(), solver=ElasticSolver(),
    ... )
    >>> rigid, elastic = task.models
    >>> solution = gt.solve(elastic, gt.Mesh(8), guess=gt.solve(rigid, gt.Mesh(8)).trajectory)
    >>> round(1e3 * float(solution.trajectory["spring.offset"][-1, 2]), 1)  # [mm]: the tool hangs by its weight
    -6.9
    """

    mass = gt.parameter(unit="kg", positive=True, description="mass on the spring")
    K = gt.parameter(shape=(3, 3), unit="N/m", kind="semidefinite", description="its stiffness, world axes")
    D = gt.parameter(np.zeros((3, 3)), unit="N.s/m", kind="semidefinite", description="its damping, world axes")
    spring = gt.part(PointSpringDamper, K=K, D=D)
    tool = gt.part(PointMass, m=mass)

    def equations(self):
        yield from super().equations()
        yield gt.connect(self.spring.a, self.plate.frame)
        yield gt.connect(self.spring.b, self.tool.frame)

    def constraints(self):
        yield from super().constraints()
        weight = self.mass * self.tool.world.g
        for instant in (0, self.final_time):
            yield (self.K @ self.spring.offset).at(instant) == weight
            yield gt.der(self.spring.offset).at(instant) == np.zeros(3)
